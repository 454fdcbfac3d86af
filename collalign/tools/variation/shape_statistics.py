"""The tests that people publish: shape against size, covariates and groups, as tables for the page and for files."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypedDict

import numpy as np

from collalign.analysis.procrustes import PrincipalComponents, principal_components
from collalign.analysis.shape_tests import (
    AnovaRow,
    compare_groups,
    compare_held,
    compare_slopes,
    procrustes_anova,
)
from collalign.analysis.symmetry import ObjectSymmetry
from collalign.tools.variation.shape_model import (
    SIZE,
    SIZE_TERM,
    Column,
    ShapeTestOptions,
    missing_notes,
    model_terms,
    parse_model,
    read_column,
    settled_columns,
)
from collalign.tools.variation.surface_variation import NUM_COMPONENTS, SurfaceVariation
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.io.output_folder import OutputFolder
from data_tools.notes import Note, listed
from data_tools.surface.outliers import odd_ratios

SCORES_FILE, SYMMETRY_FOLDER = "scores.csv", "symmetry"
ANOVA_HEADING = ("effect", "Df", "SS", "MS", "Rsq", "F", "Z", "P")
Columns = Mapping[str, Sequence[str]]
Rows = list[list[object]]


def write_tables(
    variation: SurfaceVariation, columns: Columns, tests: Mapping[str, Rows], output: OutputFolder
) -> None:
    """Write scores with centroid sizes, and ``statistics/``."""
    sizes = {"centroid_size_surface": variation.centroid_sizes}
    output.stage_table(
        score_rows(variation.names, columns, variation.components, sizes), SCORES_FILE
    )
    for name, rows in tests.items():
        output.stage_table(rows, "statistics", f"{name}.csv")


def write_symmetry_tables(
    names: Sequence[str], symmetry: ObjectSymmetry, columns: Columns, output: OutputFolder
) -> None:
    """Write ``symmetry/``: asymmetries, both sets of scores, and the ANOVA."""
    numbers = {"asymmetry": symmetry.asymmetry, "fluctuating": symmetry.fluctuating}
    symmetric = score_rows(names, columns, principal_components(symmetry.symmetric), {})
    asymmetric = score_rows(names, columns, principal_components(symmetry.asymmetric), numbers)
    output.stage_table(symmetric, SYMMETRY_FOLDER, "symmetric.csv")
    output.stage_table(asymmetric, SYMMETRY_FOLDER, "asymmetric.csv")
    output.stage_table(symmetry_rows(symmetry.anova), SYMMETRY_FOLDER, "procrustes_anova.csv")


def score_rows(
    names: Sequence[str],
    columns: Columns,
    components: PrincipalComponents,
    numbers: Mapping[str, FloatArray],
) -> Rows:
    """Return a row per specimen: labels, numbers (N,), scores on the components (Procrustes distances)."""
    count = min(NUM_COMPONENTS, len(components.shares))
    rows: Rows = [["name", *columns, *numbers, *(f"PC{at}" for at in range(1, count + 1))]]
    for at, name in enumerate(names):
        values = [
            *(one[at] for one in numbers.values()),
            *procrustes_scores(components)[at, :count],
        ]
        rows.append([name, *(labels[at] for labels in columns.values()), *map(float, values)])
    return rows


def procrustes_scores(components: PrincipalComponents) -> FloatArray:
    """Return scores of surfaces whose lengths are in root mean square radii, at unit centroid size, shape (N, m)."""
    return np.asarray(components.scores / np.sqrt(len(components.mean)))


def anova_rows(anova: Sequence[AnovaRow]) -> Rows:
    """Return a Procrustes ANOVA with mean squares and parts of the total, under :data:`ANOVA_HEADING`."""
    total = anova[-1].sum_of_squares
    rows: Rows = []
    for row in anova:
        share = row.sum_of_squares / total if total > 0 else float("nan")
        mean_square = row.sum_of_squares / row.df if row.df > 0 else float("nan")
        rows.append(
            [row.effect, row.df, row.sum_of_squares, mean_square, share, row.f, row.z, row.p]
        )
    return rows


def symmetry_rows(anova: Sequence[AnovaRow]) -> Rows:
    """Return the ANOVA of asymmetry with its heading: degrees of freedom of configurations, and of coordinates.

    Mean squares and F are by those of coordinates (Klingenberg, Barluenga and Meyer 2002).
    """
    heading: list[object] = ["effect", "Df", "Df_coordinates", *ANOVA_HEADING[2:]]
    rows = zip(anova, anova_rows(anova), strict=True)
    return [heading, *([one.effect, one.plain_df, *row[1:]] for one, row in rows)]


_ANOVA_TABLE: list[object] = ["model", "sums_of_squares", "shapes", *ANOVA_HEADING]
_PAIRS_TABLE: list[object] = [
    *("column", "first", "second", "held_constant", "distance", "Z", "P", "P_Holm"),
    *("disparity_difference", "disparity_Z", "disparity_P", "disparity_P_Holm"),
    *("slope_angle_deg", "slope_difference", "slope_Z", "slope_P", "slope_P_Holm"),
]


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeTests:
    """Tables of tests, each with its heading, and what a reader must know of them.

    Attributes
    ----------
    tables : mapping of str to rows
        ``anova``, ``groups``, ``pairs`` and ``allometry``.
    notes : tuple of Note
        Who or what was not tested, and why.
    options : ShapeTestOptions
        How it was tested.
    factors : tuple of str
        The columns of labels that are groups; the others are covariates.
    """

    tables: Mapping[str, Rows]
    options: ShapeTestOptions
    factors: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()


class _How(TypedDict):
    permutations: int
    seed: int


def shape_tests(
    variation: SurfaceVariation,
    columns: Columns,
    options: ShapeTestOptions = ShapeTestOptions(),  # noqa: B008
) -> ShapeTests:
    """Test shape by the model asked for, which comes first, and against size and every column of labels.

    Columns are covariates or factors, see :func:`collalign.tools.variation.shape_model.settled_columns`. Shapes
    without a value, or alone in their group, do not count in the tests of a column. Where the files of some shapes
    are probably in another unit, nothing is tested against size.

    Parameters
    ----------
    variation : SurfaceVariation
    columns : mapping of str to sequence of str
        Labels of the shapes, ``""`` where unknown.
    options : ShapeTestOptions

    Raises
    ------
    InputError
        As :func:`check_tests`, or if the model leaves nothing to compare.
    """
    shapes, sizes = procrustes_scores(variation.components), np.log(variation.centroid_sizes)
    whole = dict(zip(variation.names, variation.centroid_sizes.tolist(), strict=True))
    options = settled_columns(options, columns, variation.names)
    own_model, odd = check_tests(options, columns, whole)
    read = {
        name: read_column(name, values, variation.names, as_factor=name in options.factors)
        for name, values in columns.items()
    }
    tester = _Tester(shapes, sizes, variation.names, read, options, with_size=not odd)
    asked_for = tester.of_model(own_model) if own_model else []
    anova: Rows = [_ANOVA_TABLE, *asked_for, *tester.anova([(SIZE_TERM,)])]
    groups: Rows = [["column", "group", "shapes", "disparity"]]
    pairs: Rows = [_PAIRS_TABLE]
    for name, column in read.items():
        models, disparities = tester.usual_models(column), dict[str, float]()
        for usual in models:
            anova += tester.anova(usual)
        if column.numbers is None:
            if len(column.groups) > 1:
                disparities, rows = tester.pairs(column)
                pairs += rows
            kinds, counts = np.unique(np.array(column.values, dtype=str), return_counts=True)
            groups += [
                [name, kind or "(none)", count, disparities.get(kind, "not tested")]
                for kind, count in zip(kinds.tolist(), counts.tolist(), strict=True)
            ]
    notes = [note for column in read.values() for note in column.notes]
    if odd:
        times = tuple(map(float, odd.values()))
        notes.insert(0, Note("size-not-tested", tuple(odd), {"times": times}))
    factors = tuple(name for name, column in read.items() if column.numbers is None)
    tables = {
        "anova": anova,
        "groups": groups,
        "pairs": pairs,
        "allometry": _allometry(variation, columns, shapes),
    }
    return ShapeTests(
        tables=tables, options=options, factors=factors, notes=(*notes, *tester.notes)
    )


def check_tests(
    options: ShapeTestOptions, columns: Collection[str], sizes: Mapping[str, float]
) -> tuple[tuple[tuple[str, ...], ...], dict[str, float]]:
    """Return the terms of the model asked for, and the shapes whose files are probably in another unit.

    Parameters
    ----------
    options : ShapeTestOptions
    columns : collection of str
        Names of the columns of labels.
    sizes : mapping of str to float
        Of every shape that counts, up to one factor.

    Returns
    -------
    model : tuple of tuple of str
        See :func:`collalign.tools.variation.shape_model.parse_model`; empty where none is asked for.
    odd : dict of str to float
        See :func:`data_tools.surface.outliers.odd_ratios`.

    Raises
    ------
    InputError
        If ``model`` names no column, or has size, which is in several units.
    """
    model = parse_model(options.model, columns) if options.model else ()
    odd = odd_ratios(sizes)
    if odd and any(SIZE_TERM in term for term in model):
        names = " ".join(map(shlex.quote, odd))
        raise InputError(
            f"model: size cannot be tested, because files are probably in another unit: {listed([*odd])}. Convert "
            f"them and align again, or leave them out (--exclude {names})"
        )
    return model, odd


class _Tester:
    """Runs tests of one set of shapes with the same options."""

    def __init__(
        self,
        shapes: FloatArray,
        sizes: FloatArray,
        names: Sequence[str],
        columns: Mapping[str, Column],
        options: ShapeTestOptions,
        *,
        with_size: bool,
    ) -> None:
        self._shapes, self._sizes, self._names, self._columns = shapes, sizes, names, columns
        self._options, self._with_size = options, with_size
        self._how: _How = {"permutations": options.permutations, "seed": options.seed}
        self.notes: list[Note] = []

    def usual_models(self, column: Column) -> list[list[tuple[str, ...]]]:
        """Return a column's models: alone, beyond size, and where groups are large enough with their interaction."""
        if column.numbers is None and len(column.groups) < 2:
            return []
        own, size = (column.name,), (SIZE_TERM,)
        if column.numbers is not None:
            return [[own], [size, own]]
        counts = [sum(value == group for value in column.values) for group in column.groups]
        slopes = [(SIZE_TERM, column.name)] if _tell_slopes(counts) else []
        return [[own], [size, own, *slopes]]

    def anova(self, model: Sequence[tuple[str, ...]]) -> Rows:
        """Return the rows of one model; none where it has too few shapes, or size, which is not tested."""
        if not self._with_size and any(SIZE_TERM in term for term in model):
            return []
        terms, chosen = model_terms(model, self._columns, self._sizes)
        if chosen.sum() < 2 + sum(columns.shape[1] for columns in terms.values()):
            return []
        return self._rows(terms, self._shapes[chosen])

    def of_model(self, model: Sequence[tuple[str, ...]]) -> Rows:
        """Return the rows of the model that was asked for, whose absent shapes are named."""
        what = " + ".join(":".join(term) for term in model)
        terms, chosen = model_terms(model, self._columns, self._sizes)
        if chosen.sum() < 3:
            raise InputError(
                f"model: {int(chosen.sum())} shapes have a value in all columns of {what}"
            )
        for name, columns in terms.items():
            if (
                columns.shape[1] < 2
                and name in self._columns
                and self._columns[name].numbers is None
            ):
                raise InputError(
                    f"model: {name} has fewer than two groups of two specimens in {what}"
                )
        self.notes += missing_notes(what, self._names, chosen)
        return self._rows(terms, self._shapes[chosen])

    def pairs(self, column: Column) -> tuple[dict[str, float], Rows]:
        """Return the disparity of every group, and rows for every two of them: as they are, and with size held."""
        chosen = column.tested
        labels, shapes = np.array(column.values, dtype=str)[chosen].tolist(), self._shapes[chosen]
        disparities, *effects = compare_groups(shapes, labels, **self._how)
        none, ends = [""] * 5, [*combinations(disparities, 2)]
        numbers = np.column_stack(
            [n for one in effects for n in (one.values, one.z, one.p, one.holm)]
        ).tolist()
        rows: Rows = [
            [column.name, *two, "nothing", *row, *none]
            for two, row in zip(ends, numbers, strict=True)
        ]
        if self._with_size and len(shapes) > len(disparities) + 1:
            sizes = self._sizes[chosen]
            held = compare_held(shapes, labels, sizes[:, None], **self._how)
            slopes = [none] * len(ends)
            if _tell_slopes(labels.count(group) for group in disparities):
                found, angles = compare_slopes(shapes, labels, sizes, **self._how)
                slopes = np.column_stack(
                    [angles, found.values, found.z, found.p, found.holm]
                ).tolist()
            numbers = np.column_stack([held.values, held.z, held.p, held.holm]).tolist()
            rows += [
                [column.name, *two, SIZE, *row, *none[:4], *slope]
                for two, row, slope in zip(ends, numbers, slopes, strict=True)
            ]
        return disparities, rows

    def _rows(self, terms: Mapping[str, FloatArray], shapes: FloatArray) -> Rows:
        sums = self._options.sums_of_squares
        found = anova_rows(procrustes_anova(shapes, terms, sums=sums, **self._how))
        return [[" + ".join(terms), sums, len(shapes), *row] for row in found]


def _tell_slopes(counts: Iterable[int]) -> bool:
    """Return whether groups of so many shapes are large enough for their allometries to be compared."""
    return min(counts) >= 4


def _allometry(variation: SurfaceVariation, columns: Columns, shapes: FloatArray) -> Rows:
    """Return size and regression score of every shape: Drake and Klingenberg 2008."""
    sizes = np.log(variation.centroid_sizes)
    slope = (sizes - sizes.mean()) @ shapes
    scores = shapes @ slope / max(float(np.linalg.norm(slope)), np.finfo(float).tiny)
    rows: Rows = [["name", *columns, "log_centroid_size_surface", "regression_score"]]
    found = zip(variation.names, *columns.values(), sizes.tolist(), scores.tolist(), strict=True)
    return rows + [[*row] for row in found]
