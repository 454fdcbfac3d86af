"""Many folders from one file: what each job aligns, with which options, and what it will cost before it starts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from collalign.align import align_collection
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory
from collalign.engine.store import Store
from collalign.engine.store_file import STORE_FILE
from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.stages.choose_pairs import planned_edges
from collalign.stages.forecast import RunEstimate, forecast, try_shapes
from collalign.stages.kinds.plan import kinds_of
from collalign.stages.match_pairs import pair_key
from collalign.stages.shape_stage import wanted_shapes
from data_tools.checks import as_options, check_kinds
from data_tools.errors import CollalignError, InputError, OptionsError
from data_tools.io.files import read_toml, resolved
from data_tools.io.listing import FolderListing
from data_tools.io.objects import list_shapes
from data_tools.threads import one_blas_thread


@dataclass(frozen=True, kw_only=True)
class BatchJob:
    """One folder of a batch.

    Attributes
    ----------
    folders : tuple of Path
        What ``collalign align`` takes: folders, files, patterns, ``@FILE``.
    out : Path
    recursive, parts : bool
    include : tuple of str
    kinds_by : {"", "folder"}
    options : AlignOptions
    """

    folders: tuple[Path, ...]
    out: Path
    recursive: bool = False
    parts: bool = False
    include: tuple[str, ...] = ()
    kinds_by: Literal["", "folder"] = ""
    options: AlignOptions = field(default_factory=AlignOptions)

    def __post_init__(self) -> None:
        check_kinds(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchResult:
    """What became of one folder of a batch.

    Attributes
    ----------
    job : BatchJob
    collection : Collection or None
        The result, which is saved in ``job.out``; None where the folder failed.
    error : str
        Why it failed; empty where it did not.
    """

    job: BatchJob
    collection: Collection | None
    error: str = ""


def read_batch(path: str | Path) -> tuple[BatchJob, ...]:
    """Read a batch file.

    It is TOML with a table ``[options]`` for all jobs (as in a configuration file of ``collalign align``) and one
    ``[[jobs]]`` per folder with ``folder`` (or a list of several), ``out``, perhaps ``recursive = true``,
    ``parts = true``, ``include = ["*.csv"]`` or ``kinds_by = "folder"`` and, where they differ, ``[jobs.options]``.
    Paths are relative to the file. How many processes work is no part of it: that is ``--jobs`` of the command.

    Raises
    ------
    InputError
        If the file cannot be read, names nothing to do, or two jobs share an ``out``.
    OptionsError
        If an option is unknown or impossible.
    """
    path = Path(path)
    _refuse_processes(path)
    content = read_toml(path)
    unknown = sorted(content.keys() - {"options", "jobs"})
    if unknown:
        raise InputError(f"{path}: unknown entry {unknown[0]!r}; expected [options] and [[jobs]]")
    entries = content.get("jobs")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: no [[jobs]], nothing to do")
    shared = {"options": content.get("options", {})}
    jobs = tuple(_job(path, number, entry, shared) for number, entry in enumerate(entries, 1))
    outs = [resolved(job.out) for job in jobs]
    if len(set(outs)) < len(outs):
        raise InputError(f"{path}: two jobs write to the same folder")
    return jobs


def _refuse_processes(path: Path) -> None:
    """Say where the number of processes belongs: it decides no result, and a number of jobs may be no TOML."""
    text = path.read_bytes() if path.is_file() else b""
    if asked := re.search(rb"^[ \t]*jobs\s*=\s*(-?\d+)", text, re.MULTILINE):
        number = int(asked[1])
        raise InputError(
            f"{path}: jobs = {number}: how many processes work is an option of the command: `collalign batch "
            f"{path.name} --jobs {number}` (in Python run={{'jobs': {number}}}). Each folder is a table [[jobs]]"
        )


@one_blas_thread()
def run_batch(
    batch: str | Path | Sequence[BatchJob],
    *,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
) -> tuple[BatchResult, ...]:
    """Align many folders, one after the other, and save each result in its folder.

    A folder that fails does not stop the others. Each result folder keeps a store, out of which an interrupted batch
    goes on when it is called again; ``run.store`` names one for all folders instead.

    Parameters
    ----------
    batch : str, Path or sequence of BatchJob
        A file as :func:`read_batch` reads it, or what it returned.
    run : RunOptions or mapping, optional
        Processes, store, limits: how the work is done.
    progress : bool or callable
        As in :func:`collalign.align_collection`.

    Returns
    -------
    tuple of BatchResult
        One for each job, in order.

    Raises
    ------
    InputError
        If the file cannot be read, names nothing to do, or two jobs share a folder for results.
    OptionsError
        If an option is unknown or impossible.

    Examples
    --------
    >>> found = collalign.run_batch("batch.toml", run={"jobs": 1}, progress=False)  # of bones and of a folder "no"
    >>> [one.collection is not None for one in found]
    [True, False]
    >>> "no such folder" in found[1].error
    True
    """
    how = as_options("run", run, RunOptions)
    jobs = read_batch(batch) if isinstance(batch, str | Path) else tuple(batch)
    return tuple(_run_job(job, how, progress) for job in jobs)


def _run_job(job: BatchJob, run: RunOptions, progress: ProgressFactory | bool) -> BatchResult:
    """Align and save one folder; what fails is said."""
    try:
        job.out.mkdir(parents=True, exist_ok=True)
        found = align_collection(
            [*job.folders] if job.folders[1:] else job.folders[0],
            options=job.options,
            run=replace(run, store=run.store or job.out / STORE_FILE),
            recursive=job.recursive,
            parts=job.parts,
            include=job.include,
            kinds=job.kinds_by,
            progress=progress,
        )
        found.save(job.out)
    except (CollalignError, OSError) as error:
        return BatchResult(job=job, collection=None, error=str(error))
    return BatchResult(job=job, collection=found)


@one_blas_thread()
def estimate_job(job: BatchJob, run: RunOptions) -> RunEstimate:
    """Estimate what a job will take, all its stages, from its store and a trial with a few of its shapes.

    Where the group is "auto", as if no shape had to be mirrored. Kinds that the job names are matched one by one;
    where these are to be found, as if all shapes were of one kind.

    Raises
    ------
    CollalignError
        If the folder cannot be read or too few of the first shapes are usable.
    """
    is_auto = job.options.group == "auto"
    options = replace(job.options, group="SO") if is_auto else job.options
    listing = list_shapes(
        job.folders, recursive=job.recursive, parts=job.parts, include=job.include
    )
    trial = try_shapes(listing, options, run)
    shapes, pairs = _workload(listing, replace(job, options=options), run)
    asks_sides = is_auto and pairs[1] > pairs[0] // 2
    return forecast(
        trial.costs,
        shapes,
        pairs,
        options,
        run.num_workers,
        pilot=asks_sides,
        is_assembled=trial.is_assembled,
        start_s=trial.start_s,
        sizes=trial.sizes,
    )


def _workload(
    listing: FolderListing, job: BatchJob, run: RunOptions
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the numbers of shapes and pairs, each with what the store lacks, counted as if no shape were bad."""
    wanted, _ = wanted_shapes(listing, job.options, {})
    keys = [one.key for one in wanted.values()]
    labels = kinds_of(job.kinds_by, listing.names)
    kinds = [labels.get(name, "") for name in listing.names]
    members = [np.flatnonzero([one == kind for one in kinds]) for kind in dict.fromkeys(kinds)]
    edges = np.concatenate([own[planned_edges(len(own), job.options)] for own in members])
    shapes, pairs, store = frozenset[str](), frozenset[str](), run.store or job.out / STORE_FILE
    if store.exists():
        with Store.open(store, read_only=True) as opened:
            shapes, pairs = opened.keys("shapes"), opened.keys("pairs")
    done = sum(pair_key(keys[i], keys[j], job.options) in pairs for i, j in edges.tolist())
    return (len(listing.names), len(set(keys) - shapes)), (len(edges), len(edges) - done)


def _job(path: Path, number: int, entry: Any, shared: Mapping[str, Any]) -> BatchJob:
    name = f"{path}: job {number}"
    if not isinstance(entry, dict) or not {"folder", "out"} <= entry.keys():
        raise InputError(f"{name}: expected a table with 'folder' and 'out'")
    given = _merged(shared, entry)
    places, out, include = given.pop("folder"), given.pop("out"), given.get("include", [])
    places = places if isinstance(places, list) else [places]
    if not places or not all(isinstance(one, str) for one in (*places, out, *include)):
        raise InputError(
            f"{name}: 'folder' and 'out' must be paths in quotes, 'folder' perhaps a list"
        )
    if not isinstance(include, list):
        raise InputError(f"{name}: 'include' must be a list of patterns in quotes")
    folders = [
        Path(f"@{path.parent / place[1:]}") if place.startswith("@") else path.parent / place
        for place in places
    ]
    try:
        return as_options("job", {**given, "folders": folders, "out": path.parent / out}, BatchJob)
    except OptionsError as error:
        raise OptionsError(f"{name}: {error}") from None


def _merged(general: Mapping[str, Any], special: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(general)
    for name, value in special.items():
        both = isinstance(value, dict) and isinstance(merged.get(name), dict)
        merged[name] = _merged(merged[name], value) if both else value
    return merged
