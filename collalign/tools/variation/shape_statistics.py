"""The tests that people publish: shape against size and groups, as tables for the page and for files."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from collalign.analysis.shape_tests import compare_groups, procrustes_anova
from collalign.tools.variation.r_tables import ANOVA_HEADING, Columns, Rows, anova_rows, procrustes_scores
from collalign.tools.variation.surface_variation import SurfaceVariation
from data_tools.arrays import FloatArray

_SIZE = "log(centroid size)"
#: Fewest shapes of a group that is compared, and of every group whose allometries are.
_LEAST, _LEAST_FOR_SLOPES = 2, 4


def statistics_tables(variation: SurfaceVariation, columns: Columns) -> dict[str, Rows]:
    """Return the tables ``anova``, ``groups``, ``pairs`` and ``allometry``, each with its heading.

    Shapes without a label, or alone with theirs, do not count in the tests of a column, which ``groups`` says.
    """
    shapes = procrustes_scores(variation.components)
    sizes = np.log(variation.centroid_sizes)
    anova: Rows = [["model", *ANOVA_HEADING], *_anova(shapes, {_SIZE: sizes[:, None]})]
    groups: Rows = [["column", "group", "shapes", "disparity"]]
    pairs: Rows = [["column", "first", "second", "distance", "Z", "P", "P_Holm"]]
    pairs[0] += ["disparity_difference", "disparity_Z", "disparity_P", "disparity_P_Holm"]
    for column, values in columns.items():
        labels = np.array(values, dtype=str)
        kinds, counts = np.unique(labels, return_counts=True)
        tested = np.isin(labels, kinds[(kinds != "") & (counts >= _LEAST)])
        disparities: dict[str, float] = {}
        if len(set(labels[tested])) > 1:
            disparities, *effects = compare_groups(shapes[tested], labels[tested].tolist())
            numbers = np.column_stack([n for one in effects for n in (one.values, one.z, one.p, one.holm)])
            for ends, row in zip(combinations(disparities, 2), numbers.tolist(), strict=True):
                pairs.append([column, *ends, *row])
            group, size = (labels[tested, None] == np.array([*disparities])).astype(np.float64), sizes[tested, None]
            terms = {_SIZE: size, column: group}
            if group.sum(axis=0).min() >= _LEAST_FOR_SLOPES:
                terms[f"{_SIZE}:{column}"] = size * group
            anova += _anova(shapes[tested], {column: group}) + _anova(shapes[tested], terms)
        for kind, count in zip(kinds.tolist(), counts.tolist(), strict=True):
            groups.append([column, kind or "(none)", count, disparities.get(kind, "not tested")])
    slope = (sizes - sizes.mean()) @ shapes  # the regression score: Drake and Klingenberg 2008
    scores = shapes @ slope / max(float(np.linalg.norm(slope)), np.finfo(float).tiny)
    allometry: Rows = [["name", *columns, "log_centroid_size", "regression_score"]]
    allometry += [
        [*row] for row in zip(variation.names, *columns.values(), sizes.tolist(), scores.tolist(), strict=True)
    ]
    return {"anova": anova, "groups": groups, "pairs": pairs, "allometry": allometry}


def _anova(shapes: FloatArray, terms: Mapping[str, FloatArray]) -> Rows:
    """Return the rows of one model; none where there are too few shapes for it."""
    if len(shapes) < 2 + sum(columns.shape[1] for columns in terms.values()):
        return []
    return [[" + ".join(terms), *row] for row in anova_rows(procrustes_anova(shapes, terms))]
