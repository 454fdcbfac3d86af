"""Many folders from one file: what each job aligns, with which options, and what it will cost before it starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from collalign.engine.run_options import RunOptions
from collalign.engine.store import Store
from collalign.engine.store_file import STORE_FILE
from collalign.options import AlignOptions
from collalign.stages.choose_pairs import planned_edges
from collalign.stages.forecast import RunEstimate, forecast, try_shapes
from collalign.stages.match_pairs import pair_key
from collalign.stages.shape_stage import wanted_shapes
from data_tools.checks import as_options
from data_tools.errors import InputError, OptionsError
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
    options : AlignOptions
    """

    folders: tuple[Path, ...]
    out: Path
    recursive: bool
    parts: bool
    include: tuple[str, ...]
    options: AlignOptions


def read_batch(path: str | Path) -> tuple[BatchJob, ...]:
    """Read a batch file.

    It is TOML with a table ``[options]`` for all jobs (as in a configuration file of ``collalign align``) and one
    ``[[jobs]]`` per folder with ``folder`` (or a list of several), ``out``, perhaps ``recursive = true``,
    ``parts = true`` or ``include = ["*.csv"]`` and, where they differ, ``[jobs.options]``. Paths are relative to the
    file.

    Raises
    ------
    InputError
        If the file cannot be read, names nothing to do, or two jobs share an ``out``.
    OptionsError
        If an option is unknown or impossible.
    """
    path = Path(path)
    content = read_toml(path)
    unknown = sorted(content.keys() - {"options", "jobs"})
    if unknown:
        raise InputError(f"{path}: unknown entry {unknown[0]!r}; expected [options] and [[jobs]]")
    entries = content.get("jobs")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: no [[jobs]], nothing to do")
    shared = content.get("options", {})
    if not isinstance(shared, dict):
        raise InputError(f"{path}: [options] must be a table")
    jobs = tuple(_job(path, number, entry, shared) for number, entry in enumerate(entries, 1))
    outs = [resolved(job.out) for job in jobs]
    if len(set(outs)) < len(outs):
        raise InputError(f"{path}: two jobs write to the same folder")
    return jobs


@one_blas_thread()
def estimate_job(job: BatchJob, run: RunOptions) -> RunEstimate:
    """Estimate what a job will take, all its stages, from its store and a trial with a few of its shapes.

    Where the group is "auto", as if no shape had to be mirrored.

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
        start_s=trial.start_s,
        sizes=trial.sizes,
    )


def _workload(
    listing: FolderListing, job: BatchJob, run: RunOptions
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the numbers of shapes and pairs, each with what the store lacks, counted as if no shape were bad."""
    wanted, _ = wanted_shapes(listing, job.options, {})
    keys = [one.key for one in wanted.values()]
    edges = planned_edges(len(keys), job.options)
    shapes, pairs, store = frozenset[str](), frozenset[str](), run.store or job.out / STORE_FILE
    if store.exists():
        with Store.open(store, read_only=True) as opened:
            shapes, pairs = opened.keys("shapes"), opened.keys("pairs")
    done = sum(pair_key(keys[i], keys[j], job.options) in pairs for i, j in edges.tolist())
    return (len(listing.names), len(set(keys) - shapes)), (len(edges), len(edges) - done)


def _job(path: Path, number: int, entry: Any, shared: Mapping[str, Any]) -> BatchJob:
    name = f"{path}: job {number}"
    known = {"folder", "out", "recursive", "parts", "include", "options"}
    if not isinstance(entry, dict) or not {"folder", "out"} <= entry.keys() <= known:
        raise InputError(
            f"{name}: expected 'folder', 'out' and perhaps 'recursive', 'parts', 'include' and 'options'"
        )
    places = entry["folder"] if isinstance(entry["folder"], list) else [entry["folder"]]
    if not places or not all(isinstance(place, str) for place in (*places, entry["out"])):
        raise InputError(
            f"{name}: 'folder' and 'out' must be paths in quotes, 'folder' perhaps a list"
        )
    how = {key: entry.get(key, False) for key in ("recursive", "parts")}
    if not all(isinstance(value, bool) for value in how.values()):
        raise InputError(f"{name}: 'recursive' and 'parts' must be true or false")
    include = entry.get("include", [])
    if not isinstance(include, list) or not all(isinstance(one, str) for one in include):
        raise InputError(f"{name}: 'include' must be a list of patterns in quotes")
    special = entry.get("options", {})
    if not isinstance(special, dict):
        raise InputError(f"{name}: [jobs.options] must be a table")
    try:
        options = as_options("options", _merged(shared, special), AlignOptions)
    except OptionsError as error:
        raise OptionsError(f"{name}: {error}") from None
    folders = tuple(
        Path(f"@{path.parent / place[1:]}") if place.startswith("@") else path.parent / place
        for place in places
    )
    return BatchJob(
        folders=folders,
        out=path.parent / entry["out"],
        include=tuple(include),
        options=options,
        **how,
    )


def _merged(general: Mapping[str, Any], special: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(general)
    for name, value in special.items():
        both = isinstance(value, dict) and isinstance(merged.get(name), dict)
        merged[name] = _merged(merged[name], value) if both else value
    return merged
