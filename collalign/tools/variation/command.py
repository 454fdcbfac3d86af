"""``collalign variation``: how the surfaces of a result vary, as a page, meshes and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.analysis.label_table import read_labels
from collalign.console.help import Excluded, Flag
from collalign.console.interruption import resumable
from collalign.console.messages import add_to_summary, say, say_files, warn
from collalign.console.running import Run
from collalign.engine.run_options import RunOptions
from collalign.output.collection import Collection
from collalign.output.label_notes import (
    compare_members,
    with_label_notes,
    without_label_notes,
)
from collalign.output.loading import load
from collalign.output.members import statistics_members
from collalign.tools.variation.classification import (
    classify_leave_one_out,
    posed_clouds,
    surface_distances,
)
from collalign.tools.variation.files import DEFAULT_FOLDER, PAGE_FILE
from collalign.tools.variation.run import write_surface_variation
from collalign.tools.variation.shape_model import ShapeTestOptions
from collalign.wording import note_text
from data_tools.errors import OptionsError
from data_tools.landmark_tables import READABLE
from data_tools.names import known_names

#: Said below every classification.
_DISTANCES = "By distances of surfaces: closest points at the poses, refined for near neighbours."


def variation(
    result: Path,
    *,
    to: Path | None = None,
    labels: Path | None = None,
    classify: str | None = None,
    landmarks: Annotated[
        list[Path] | None,
        Parameter(
            consume_multiple=True,
            help=f"Landmark files ({READABLE}), each called like the shape it belongs to, to be numbered on the "
            "mean.",
        ),
    ] = None,
    symmetry: str | None = None,
    individuals: Annotated[str | None, Parameter(name=("--individuals", "--individual"))] = None,
    side: str | None = None,
    repeats: Annotated[list[Path] | None, Parameter(consume_multiple=True)] = None,
    tests: Annotated[
        ShapeTestOptions, Parameter(name="*", consume_multiple=True, negative=())
    ] = ShapeTestOptions(),  # noqa: B008
    exclude: Excluded = (),
    include_doubtful: Flag = False,
    without_posture: Flag = False,
    sources: Path | None = None,
    run: Run = RunOptions(),  # noqa: B008
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
        CSV file with one row per shape; every column is one way to group, or of numbers a covariate.
    classify
        Column of the labels: only give every shape the label of its nearest neighbour, and count how often that is
        right. Nothing is registered or written.
    symmetry
        For bilateral shapes: symmetric and asymmetric components and their Procrustes ANOVA. Either ``auto``, or a
        CSV file with two landmarks, left and right, in each row; landmarks in none are on the midline.
    individuals
        Column of the labels that says whom each shape belongs to, where individuals were measured several times:
        the repeatability of measurements. With ``--side``: left and right of each individual.
    side
        Column of the labels that says left and right, where these are shapes of their own: the Procrustes ANOVA of
        individuals, sides and both, and the asymmetry of each individual.
    repeats
        Landmark files of further digitisations, each in a folder of its own and called like its shape: the error of
        placing landmarks. With ``--side``, sides are compared by the landmarks.
    include_doubtful
        Let shapes whose pose is in doubt count as well.
    without_posture
        Of specimens aligned with --parts: bring each part to its mean place and direction among the others first.
    sources
        Folder of the original files where they have moved.
    """
    collection = load(result, sources=sources)
    if classify is not None:
        return _classify(
            collection, labels, classify, exclude=exclude, include_doubtful=include_doubtful
        )
    columns = collection.labels
    if labels is not None:
        columns = read_labels(labels).columns_for(collection.names)
    owners = _column("--individuals", individuals, columns)
    ways = _column("--side", side, columns)
    to = result / DEFAULT_FOLDER if to is None else to
    with resumable(run, result) as run:
        found = write_surface_variation(
            collection,
            to,
            labels=labels,
            tests=tests,
            landmarks=landmarks or (),
            symmetry=symmetry,
            individuals=owners,
            sides=ways,
            repeats=repeats or (),
            exclude=exclude,
            include_doubtful=include_doubtful,
            without_posture=without_posture,
            run=run,
        )
    for note in found.notes:
        warn(note_text(note))
    say_files([to / PAGE_FILE])
    return 0


def _column(
    option: str, asked: str | None, columns: Mapping[str, Sequence[str]]
) -> Sequence[str] | None:
    """Return the labels of the column that an option names; None where it names none."""
    if asked is None:
        return None
    return columns[known_names(option, [asked], columns, kind="column")[asked]]


def _classify(
    collection: Collection,
    labels: Path | None,
    by: str,
    *,
    exclude: Sequence[str],
    include_doubtful: bool,
) -> int:
    """Classify every shape by its nearest neighbour, leaving it out, and print how often that is right.

    The distance of two shapes is that of their surfaces, by closest points at their poses, of all pairs of near
    neighbours after turning, shifting and scaling to fit best. On 116 molars points in dense correspondence classify
    no better.
    """
    if labels is None:
        raise OptionsError("--classify takes a column of --labels; name the file")
    table = read_labels(labels)
    values = table.column(by, collection.names)
    checked = with_label_notes(without_label_notes(collection), {by: values}, numbers=())
    of_labels = (note for note in checked.notes if note not in collection.notes)
    for note in (*table.mismatches(collection.names), *of_labels):
        warn(note_text(note))
    who = statistics_members(
        collection,
        exclude=exclude,
        include_doubtful=include_doubtful,
        include_incomplete=include_doubtful,
        one_part=False,
    )
    _, differences = compare_members(collection, who, {by: values}, numbers=())
    clouds, chosen = posed_clouds(collection), who.chosen.tolist()
    found = classify_leave_one_out(
        surface_distances([clouds[at] for at in chosen], collection.part_numbers[chosen]),
        [values[at] for at in chosen],
        names=[collection.names[at] for at in chosen],
    )
    add_to_summary(**found.as_dict(), left_out=dict(who.left_out))
    notes = map(note_text, (*who.notes, *differences))
    say("\n".join(filter(None, [found.table(), _DISTANCES, *notes])))
    return 0
