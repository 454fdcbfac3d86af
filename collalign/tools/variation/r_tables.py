"""Tables of surfaces in correspondence: sizes, scores, tests, asymmetry and its ANOVA."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from collalign.analysis.procrustes import PrincipalComponents, principal_components
from collalign.analysis.shape_tests import AnovaRow
from collalign.analysis.symmetry import ObjectSymmetry
from collalign.tools.variation.surface_variation import NUM_COMPONENTS, SurfaceVariation
from data_tools.arrays import FloatArray
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder

SCORES_FILE, SYMMETRY_FOLDER = "scores.csv", "symmetry"
ANOVA_HEADING = ("effect", "Df", "SS", "MS", "Rsq", "F", "Z", "P")
Columns = Mapping[str, Sequence[str]]
Rows = list[list[object]]


def write_tables(
    variation: SurfaceVariation, columns: Columns, tests: Mapping[str, Rows], output: OutputFolder
) -> None:
    """Write scores with centroid sizes, and ``statistics/``."""
    sizes = {"centroid_size": variation.centroid_sizes}
    _csv(output, [SCORES_FILE], score_rows(variation.names, columns, variation.components, sizes))
    for name, rows in tests.items():
        _csv(output, ["statistics", f"{name}.csv"], rows)


def write_symmetry_tables(
    names: Sequence[str], symmetry: ObjectSymmetry, columns: Columns, output: OutputFolder
) -> None:
    """Write ``symmetry/``: asymmetries, both sets of scores, and the ANOVA."""
    numbers = {"asymmetry": symmetry.asymmetry, "fluctuating": symmetry.fluctuating}
    symmetric = score_rows(names, columns, principal_components(symmetry.symmetric), {})
    asymmetric = score_rows(names, columns, principal_components(symmetry.asymmetric), numbers)
    _csv(output, [SYMMETRY_FOLDER, "symmetric.csv"], symmetric)
    _csv(output, [SYMMETRY_FOLDER, "asymmetric.csv"], asymmetric)
    _csv(output, [SYMMETRY_FOLDER, "procrustes_anova.csv"], symmetry_rows(symmetry.anova))


def score_rows(
    names: Sequence[str], columns: Columns, components: PrincipalComponents, numbers: Mapping[str, FloatArray]
) -> Rows:
    """Return a row per specimen: labels, numbers (N,), scores on the components (Procrustes distances)."""
    count = min(NUM_COMPONENTS, len(components.shares))
    rows: Rows = [["name", *columns, *numbers, *(f"PC{at}" for at in range(1, count + 1))]]
    for at, name in enumerate(names):
        values = [*(one[at] for one in numbers.values()), *procrustes_scores(components)[at, :count]]
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
        rows.append([row.effect, row.df, row.sum_of_squares, mean_square, share, row.f, row.z, row.p])
    return rows


def symmetry_rows(anova: Sequence[AnovaRow]) -> Rows:
    """Return the ANOVA of asymmetry with its heading: degrees of freedom of configurations, and of coordinates.

    Mean squares and F are by those of coordinates (Klingenberg, Barluenga and Meyer 2002).
    """
    heading: list[object] = ["effect", "Df", "Df_coordinates", *ANOVA_HEADING[2:]]
    rows = zip(anova, anova_rows(anova), strict=True)
    return [heading, *([one.effect, one.plain_df, *row[1:]] for one, row in rows)]


def _csv(output: OutputFolder, path: Sequence[str], rows: Rows) -> None:
    write_atomic(output.stage(*path), csv_text(rows).encode())
