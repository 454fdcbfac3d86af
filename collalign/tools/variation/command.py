"""``collalign variation``: how the surfaces of a result vary, as a page, meshes and tables."""

from __future__ import annotations

from dataclasses import replace as with_changes
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.analysis.label_table import read_labels
from collalign.cli.interruption import resumable
from collalign.cli.talk import say_files, warn
from collalign.engine.run_options import RunOptions
from collalign.engine.store.layout import STORE_FILE
from collalign.output.evidence.loading import load
from collalign.output.evidence.members import statistics_members
from collalign.tools.variation.files import DEFAULT_FOLDER, PAGE_FILE
from collalign.tools.variation.run import write_surface_variation
from data_tools.errors import InputError


def variation(
    result: Path,
    *,
    to: Path | None = None,
    labels: Path | None = None,
    landmarks: Annotated[list[Path] | None, Parameter(consume_multiple=True)] = None,
    symmetry: str | None = None,
    individuals: str | None = None,
    exclude: Annotated[list[str] | None, Parameter(consume_multiple=True)] = None,
    include_doubtful: Annotated[bool, Parameter(negative=())] = False,
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
) -> int:
    """Show how the surfaces of a result vary: principal components, groups, every specimen against the mean.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    to
        Folder for variation.html, meshes with offsets from the mean, scores and distances; by default ``variation``
        in the result.
    labels
        CSV file with one row per shape; every column is one way to group.
    landmarks
        Landmark files (.mrk.json, .fcsv, .csv), each called like the shape it belongs to, to be numbered on the mean.
    symmetry
        For bilateral shapes: symmetric and asymmetric components and their Procrustes ANOVA. Either ``auto``, or a
        CSV file with two landmarks, left and right, in each row; landmarks in none are on the midline.
    individuals
        Column of the labels that says whom each shape belongs to, where individuals were measured several times.
    exclude
        Names of shapes that do not count.
    include_doubtful
        Let shapes whose pose is in doubt count as well.
    """
    collection = load(result)
    columns = None if labels is None else read_labels(labels).columns_for(collection.names)
    if individuals is not None and individuals not in (columns or collection.labels):
        raise InputError(f"--individuals: no column of the labels is called {individuals!r}")
    owners = None if individuals is None else (columns or collection.labels)[individuals]
    to = result / DEFAULT_FOLDER if to is None else to
    store = run.store or result / STORE_FILE
    with resumable(store):
        write_surface_variation(
            result,
            to,
            labels=columns,
            landmarks=landmarks or (),
            symmetry=symmetry,
            individuals=owners,
            exclude=exclude or (),
            include_doubtful=include_doubtful,
            run=with_changes(run, store=store),
        )
    who = statistics_members(collection, exclude=exclude or (), include_doubtful=include_doubtful)
    if who.left_out:
        warn(who.sentence)
    say_files([to / PAGE_FILE])
    return 0
