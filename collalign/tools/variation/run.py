"""How the surfaces of an aligned collection vary, and the files that show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from collalign.analysis.label_table import read_labels
from collalign.analysis.left_out import HEADING
from collalign.analysis.symmetry import mirror_normal
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory
from collalign.output.collection import Collection
from collalign.output.label_notes import (
    compare_members,
    with_label_notes,
    without_label_notes,
)
from collalign.output.loading import load
from collalign.output.members import statistics_members
from collalign.output.provenance import result_place
from collalign.products.named_frame import NamedFrame
from collalign.template_landmarks.templates import shape_of
from collalign.tools.correspond import dense_correspondence
from collalign.tools.variation.files import write_variation
from collalign.tools.variation.landmark_blocks import integration_tests, read_blocks
from collalign.tools.variation.mean_landmarks import (
    digitised_again,
    landmarks_of_all,
    landmarks_on_mean,
    posed_landmarks,
)
from collalign.tools.variation.mirror import landmark_partners, mirror_map, read_landmark_pairs
from collalign.tools.variation.posture import at_mean_posture, parts_of_mean
from collalign.tools.variation.repeats import check_individuals, repeat_tests
from collalign.tools.variation.shape_model import ShapeTestOptions, settled_columns
from collalign.tools.variation.shape_statistics import Rows, check_tests, shape_tests
from collalign.tools.variation.surface_variation import (
    SurfaceVariation,
    mirror_error,
    shared_error_notes,
    surface_quality,
    surface_symmetry,
    surface_variation,
)
from collalign.wording import note_records
from data_tools.arrays import FloatArray
from data_tools.checks import as_options
from data_tools.errors import CollectionError, InputError
from data_tools.io.output_folder import refuse_overlap
from data_tools.landmark_files import Landmarks
from data_tools.notes import Note
from data_tools.surface.closest import SurfacePoints
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread


@one_blas_thread()
def write_surface_variation(
    result: Collection | str | Path,
    to: str | Path,
    *,
    labels: Mapping[str, Sequence[str]] | str | Path | None = None,
    tests: ShapeTestOptions | Mapping[str, Any] | None = None,
    landmarks: Mapping[str, Landmarks] | Sequence[str | Path] = (),
    symmetry: Literal["auto"] | str | Path | Sequence[tuple[str, str]] | None = None,
    individuals: Sequence[str] | None = None,
    sides: Sequence[str] | None = None,
    repeats: Sequence[Mapping[str, Landmarks]] | Sequence[str | Path] = (),
    exclude: Sequence[str] = (),
    include_doubtful: bool = False,
    without_posture: bool = False,
    sources: str | Path | None = None,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
) -> SurfaceVariation:
    """Show how the surfaces of a result vary: one page, meshes and tables.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote.
    to : path
        Folder for ``variation.html`` and the rest.
    labels : path, or mapping of str to sequence of str, optional
        A CSV file, or columns of labels, one per shape and "" where unknown. By default those the result came with.
    tests : ShapeTestOptions or mapping, optional
        What shape is tested against: covariates, factors, a model of your own; permutations and their seed.
    landmarks : mapping of name to Landmarks, or sequence of path
        Of some specimens, to be numbered on the mean.
    symmetry : "auto", path or sequence of pairs, optional
        For bilateral shapes: pairs of landmarks (or their CSV file), or "auto" for the mirror image that fits best.
    individuals : sequence of str, optional
        Whom each shape of the result belongs to, "" where unknown. Replicates tell the error of measurement.
    sides : sequence of str, optional
        Left or right of each shape, where these are shapes of their own: both sides of individuals are compared.
    repeats : sequence of mapping of name to Landmarks, or of path
        Further digitisations of the landmarks, a folder each, by which sides are compared.
    exclude : sequence of str
        Names of shapes that do not count.
    include_doubtful : bool
        Let shapes whose pose is in doubt count as well. Incomplete ones cannot: not all their places are known.
    without_posture : bool
        Bring each part (``parts`` of the alignment) to its mean place first: an open jaw is no difference of shape.
    sources : path, optional
        Folder that holds the original files now, where they have moved.
    run : RunOptions, optional
        With a store, finished registrations are kept.
    progress : bool or callable
        As in :func:`collalign.align_collection`.

    Returns
    -------
    SurfaceVariation
        Principal components of the surfaces in dense correspondence. ``left_out.csv`` names the shapes left out.

    Raises
    ------
    InputError
        If there is no result, foreign files are in the way, or symmetry, individuals or sides fit nothing.
    CollectionError
        If fewer than two shapes are complete and sure, or can be registered.

    Examples
    --------
    >>> found = collalign.statistics.write_surface_variation("aligned", "variation")
    >>> found.components.scores.shape  # three shapes have two components
    (3, 2)
    """
    collection, test_options = (
        load(result, sources=sources),
        as_options("tests", tests, ShapeTestOptions),
    )
    labelled, dropped = _labelled(collection, labels)
    if labels is not None:
        collection = without_label_notes(collection)
    grouped = {
        column: values
        for column, values in labelled.items()
        if individuals is None or tuple(values) != tuple(individuals)
    }
    test_options = settled_columns(test_options, grouped, collection.names)
    collection = with_label_notes(collection, labelled, numbers=test_options.numbers)
    first, again = _files_of(landmarks), _files_of(repeats)
    refuse_overlap(Path(to), {*collection.inputs, *first, *again})
    if twice := {one.resolve() for one in first} & {one.resolve() for one in again}:
        raise InputError(
            f"repeats: {min(twice)} is the first digitisation; name the files of another one"
        )
    who = statistics_members(collection, exclude=exclude, include_doubtful=include_doubtful)
    if who.too_few(2):
        raise CollectionError(f"variation: {who.too_few(2)}")
    names = [name for name, _ in who.left_out]
    compared, differences = compare_members(collection, who, grouped, numbers=test_options.numbers)
    sizes = dict(zip(collection.names, collection.centroid_sizes.tolist(), strict=True))
    counted = {name: size for name, size in sizes.items() if name not in names}
    points, posed, notes = posed_landmarks(collection, landmarks)
    blocks = read_blocks(test_options.blocks, points)
    digitised, measured = None, who.chosen.tolist()
    if repeats:
        digitised, said_again = digitised_again(collection, (points, posed), repeats, counted)
        notes = tuple(dict.fromkeys([*notes, *said_again]))
        measured = [collection.index(shape) for shape in digitised.shapes]
    check_individuals(
        *(_of_rows(values, measured) for values in (individuals, sides)),
        symmetric=symmetry is not None,
        repeated=bool(repeats),
    )
    check_tests(test_options, grouped, counted)  # before the registrations, which take minutes
    dense = dense_correspondence(collection, leave_out=names, run=run, progress=progress)
    who = who.without((name, "not-registered") for name, _ in dense.failed)
    rows = [collection.index(name) for name in dense.names]
    vertices = dense.vertices / collection.scales[rows][:, None, None]
    posture = []
    if without_posture:
        kinds, parts = parts_of_mean(collection, dense)
        vertices = at_mean_posture(vertices, parts)
        posture = [Note("posture-taken-out", values={"parts": ", ".join(kinds)})]
    found = surface_variation(dense.names, dense.faces, vertices)
    columns = {column: tuple(values[at] for at in rows) for column, values in labelled.items()}
    tested = shape_tests(found, {column: columns[column] for column in grouped}, test_options)
    how = {"permutations": test_options.permutations, "seed": test_options.seed}
    owners, ways = _of_rows(individuals, rows), _of_rows(sides, rows)
    tables, results = dict[str, Rows](), list[Note]()
    if digitised is not None:
        tables, results = repeat_tests(
            digitised.points,
            _of_rows(individuals, measured) or digitised.shapes,
            _of_rows(sides, measured),
            units=digitised.shapes,
            permutations=test_options.permutations,
            seed=test_options.seed,
        )
        tables["digitisation"] = [
            ["landmark", "error"],
            *map(list, zip(digitised.landmarks, digitised.errors.tolist(), strict=True)),
        ]
    elif owners is not None:
        tables, results = repeat_tests(
            vertices, owners, ways, permutations=test_options.permutations, seed=test_options.seed
        )
    tested = replace(tested, tables={**tested.tables, **tables})
    if compared:
        tested = replace(tested, tables={**tested.tables, "left_out": [[*HEADING], *compared]})
    marked = points, landmarks_on_mean(dense, found.mean, posed, len(points))
    if blocks:
        needed = [row for of_block in blocks.values() for row in of_block]
        places, carried = landmarks_of_all(
            found, vertices, {} if without_posture else posed, marked, needed
        )
        tables, integrated = integration_tests(found.names, places, blocks, **how)
        results += [*integrated, *carried]
        tested = replace(tested, tables={**tested.tables, **tables})
    before = [
        note for note in who.not_said_by(collection.notes) if note.code != "copies"
    ]  # of all shapes, not of those that count
    said = [
        *posture,
        *results,
        *who.notes,
        *differences,
        *(one.note for one in who.copies),
        *tested.notes,
        *dropped,
        *notes,
        *before,
    ]
    found = replace(
        found, notes=tuple(dict.fromkeys(said)), quality=surface_quality(collection, dense)
    )
    components = None
    if symmetry is not None:
        counterparts = _counterparts(found, symmetry, marked)
        components = surface_symmetry(
            vertices,
            counterparts,
            mirrored=collection.reflected[rows],
            individuals=owners,
            **how,
        )
        doubts = shared_error_notes(components, mirror_error(found.mean, counterparts))
        found = replace(found, notes=(*doubts, *found.notes))
    version = str(collection.run.versions.get("collalign", ""))
    terms = {term for row in tested.tables["anova"] for term in str(row[0]).split(" + ")}
    write_variation(
        found,
        Path(to),
        columns=columns,
        tests=tested,
        landmarks=marked,
        symmetry=components,
        frame=NamedFrame.of(collection.options),
        version=version,
        who=who,
        record={
            "result": result_place(collection, Path(to)),
            "tests": asdict(test_options),
            "symmetry": None if symmetry is None else str(symmetry),
            "individuals": owners,
            "sides": ways,
            "repeats": sorted(str(one) for one in repeats if not isinstance(one, Mapping)),
            "templates": sorted(map(str, landmarks)),
            "exclude": exclude,
            "include_doubtful": include_doubtful,
            "without_posture": without_posture,
            "labels": [column for column in grouped if column in terms],
            "left_out": who.left_out,
            "num_shapes": len(found.names),
            "num_vertices": len(found.mean),
            "notes": note_records(found.notes),
        },
    )
    return found


def _files_of(
    landmarks: Mapping[str, Landmarks] | Sequence[Mapping[str, Landmarks]] | Sequence[str | Path],
) -> list[Path]:
    return (
        []
        if isinstance(landmarks, Mapping)
        else [shape_of(one)[1] for one in landmarks if not isinstance(one, Mapping)]
    )


def _of_rows(values: Sequence[str] | None, rows: Sequence[int]) -> list[str] | None:
    return None if values is None else [values[at] for at in rows]


def _labelled(
    collection: Collection, labels: Mapping[str, Sequence[str]] | str | Path | None
) -> tuple[Mapping[str, Sequence[str]], list[Note]]:
    """Return the columns of labels of all shapes, and notes on rows and shapes that do not fit each other."""
    if labels is None:
        return collection.labels, []
    if isinstance(labels, Mapping):
        return labels, []
    table = read_labels(labels)
    table.check_fit(collection.names)
    return table.columns_for(collection.names), table.mismatches(collection.names)


def _counterparts(
    found: SurfaceVariation,
    symmetry: str | Path | Sequence[tuple[str, str]],
    marked: tuple[tuple[str, ...], FloatArray],
) -> SurfacePoints:
    """Find the other side of every vertex of the mean."""
    mean = Shape.from_arrays(found.mean, found.faces, name="the mean")
    if symmetry == "auto":
        return mirror_map(mean)
    names, points = marked
    if not names:
        raise InputError("symmetry: pairs are of landmarks; name files that have them (landmarks)")
    pairs = read_landmark_pairs(symmetry, names) if isinstance(symmetry, str | Path) else symmetry
    partner = landmark_partners(names, pairs)
    there = np.asarray(np.isfinite(points).all(axis=1))
    known = there & there[partner]
    numbers = np.cumsum(known) - 1
    centred = points[known] - points[known].mean(axis=0)
    return mirror_map(mean, normal=mirror_normal(centred, numbers[partner[known]]))
