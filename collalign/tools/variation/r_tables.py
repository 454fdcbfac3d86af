"""What R needs of surfaces in correspondence: points as TPS, sizes, scores, pairs, asymmetry and its ANOVA."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from collalign.analysis.procrustes import PrincipalComponents
from collalign.tools.export.specimen_names import without_blanks, written_names
from collalign.tools.export.tps import tps_text
from collalign.tools.variation.surface_symmetry import SurfaceSymmetry
from collalign.tools.variation.surface_variation import NUM_COMPONENTS, SurfaceVariation
from data_tools.arrays import FloatArray
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder

SCORES_FILE, POINTS_FILE = "scores.csv", "points.tps"
SYMMETRY_FOLDER = "symmetry"
Columns = Mapping[str, Sequence[str]]


def write_tables(variation: SurfaceVariation, columns: Columns, output: OutputFolder) -> None:
    """Write scores with centroid sizes, and evenly spread points of all specimens."""
    sizes = {"centroid_size": variation.centroid_sizes}
    _csv(output, [SCORES_FILE], score_rows(variation.names, columns, variation.components, sizes))
    _tps(output, [POINTS_FILE], variation.names, variation.points)


def write_symmetry_tables(
    names: Sequence[str], symmetry: SurfaceSymmetry, columns: Columns, output: OutputFolder
) -> None:
    """Write ``symmetry/``: asymmetries, both sets of scores, the ANOVA, and pairs of points with their numbers."""
    numbers = {"asymmetry": symmetry.asymmetry, "fluctuating": symmetry.fluctuating}
    symmetric = score_rows(names, columns, symmetry.symmetric_components, {})
    asymmetric = score_rows(names, columns, symmetry.asymmetric_components, numbers)
    _csv(output, [SYMMETRY_FOLDER, "symmetric.csv"], symmetric)
    _csv(output, [SYMMETRY_FOLDER, "asymmetric.csv"], asymmetric)
    _csv(output, [SYMMETRY_FOLDER, "procrustes_anova.csv"], anova_rows(symmetry))
    num = symmetry.pairs.shape[1] // 2
    pairs = [["left", "right"], *([at, num + at] for at in range(1, num + 1))]
    _csv(output, [SYMMETRY_FOLDER, "land_pairs.csv"], pairs)
    _tps(output, [SYMMETRY_FOLDER, POINTS_FILE], names, symmetry.pairs)


def score_rows(
    names: Sequence[str], columns: Columns, components: PrincipalComponents, numbers: Mapping[str, FloatArray]
) -> list[list[object]]:
    """Return a row per specimen: labels, numbers, scores on the components (lengths in radii of the mean)."""
    count = min(NUM_COMPONENTS, len(components.shares))
    rows: list[list[object]] = [["name", *columns, *numbers, *(f"PC{at}" for at in range(1, count + 1))]]
    for at, name in enumerate(names):
        values = [*(one[at] for one in numbers.values()), *components.scores[at, :count]]
        rows.append([name, *(labels[at] for labels in columns.values()), *map(float, values)])
    return rows


def anova_rows(symmetry: SurfaceSymmetry) -> list[list[object]]:
    """Return the Procrustes ANOVA with mean squares and parts of the total."""
    total = symmetry.anova[-1].sum_of_squares
    rows: list[list[object]] = [["effect", "Df", "SS", "MS", "Rsq", "F", "P"]]
    for row in symmetry.anova:
        share = row.sum_of_squares / total if total > 0 else float("nan")
        mean_square = row.sum_of_squares / row.df if row.df > 0 else float("nan")
        rows.append([row.effect, row.df, row.sum_of_squares, mean_square, share, row.f, row.p])
    return rows


def _csv(output: OutputFolder, path: Sequence[str], rows: list[list[object]]) -> None:
    write_atomic(output.stage(*path), csv_text(rows).encode())


def _tps(output: OutputFolder, path: Sequence[str], names: Sequence[str], points: FloatArray) -> None:
    write_atomic(output.stage(*path), tps_text(written_names(names, without_blanks), points).encode())
