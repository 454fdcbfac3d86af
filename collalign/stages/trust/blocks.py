"""Blocks of shapes that one wrong rotation would keep together."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray

#: What is added up over pairs.
RISE, COST, COUNT = range(3)


def block_margins(rises: FloatArray, costs: FloatArray) -> FloatArray:
    """Return how clearly the most doubtful block of each shape has its pose, shape (n,); infinite if nothing says.

    The shapes of a block support one another in a wrong pose as well as in the right one. Only their pairs with the
    other shapes can tell. Blocks are the clusters of average linkage, from single shapes to all but one: first those
    join that the rotation would separate at the highest cost.

    The margin of a block is what it costs more against the others after its rotation, or these after theirs, less how
    distinct it is: what its pairs with the others cost more than pairs on either side. Where half of the shapes have
    a feature on the other side, the poses make either this feature agree or the rest; whichever it is, the pairs
    between the halves fit worse than those within. A margin below that is no evidence of the pose.

    The margin counts for the smaller side, because poses are right if they agree with most others.

    Parameters
    ----------
    rises : ndarray, shape (n, n)
        The logarithm of what shape i costs against j after one rotation of the common frame over what it costs
        before; NaN where it was not tried.
    costs : ndarray, shape (n, n)
        The logarithm of what it costs before.
    """
    num = len(rises)
    margins = np.full(num, np.inf)
    tried = ~np.isnan(rises)
    np.fill_diagonal(tried, False)
    if not tried.any():
        return margins
    sums = np.where(tried, np.stack([rises, costs, np.ones_like(rises)]), 0.0)
    rows, columns, total = sums.sum(axis=2), sums.sum(axis=1), sums.sum(axis=(1, 2))
    for block, inside in _clusters(np.where(tried, rises, rises[tried].mean()), sums):
        there, back = (of_side[:, block].sum(axis=1) - inside for of_side in (rows, columns))
        between = there + back
        within = total - between
        if not between[COUNT]:
            continue
        margin = min(side[RISE] / side[COUNT] for side in (there, back) if side[COUNT])
        if within[COUNT]:
            margin -= max(between[COST] / between[COUNT] - within[COST] / within[COUNT], 0.0)
        is_inside = np.zeros(num, dtype=np.bool_)
        is_inside[block] = True
        for side in (is_inside, ~is_inside):
            if 2 * side.sum() <= num:
                margins[side] = np.minimum(margins[side], margin)
    return margins


def _clusters(rises: FloatArray, sums: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield the shapes of each cluster of average linkage but the last, and the sums (3, n, n) over pairs within."""
    both = rises + rises.T
    distances = both.max() - both
    np.fill_diagonal(distances, 0.0)
    merges = scipy.cluster.hierarchy.linkage(
        scipy.spatial.distance.squareform(distances, checks=False), method="average"
    )[:, :2].astype(np.intp)
    clusters = [(np.array([shape]), np.zeros(len(sums))) for shape in range(len(rises))]
    for first, second in merges:
        yield from (clusters[first], clusters[second])
        (one, inside), (other, inside_other) = clusters[first], clusters[second]
        across = sums[:, one[:, None], other] + np.swapaxes(sums[:, other[:, None], one], 1, 2)
        clusters.append(
            (np.concatenate([one, other]), inside + inside_other + across.sum(axis=(1, 2)))
        )
