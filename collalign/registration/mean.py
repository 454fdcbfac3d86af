"""Which shape of a collection lends its triangles to the mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray

#: Points of each cloud whose nearest points on the others are looked up.
_NUM_QUERIES = 300


def medoid(clouds: Sequence[FloatArray], candidates: Sequence[int] = ()) -> int:
    """Return the cloud, of the candidates if there are any, whose summed distances to all others are least.

    The distance of two posed clouds is the mean distance of points to the nearest of the other, both ways. The medoid
    is the best start for a mean: no shape is very far from it. Clouds should be far denser than the shapes differ:
    with 64 points, which of two middle skulls it is depends on where the points lie. Of several it is the first.
    """
    trees = [cKDTree(cloud) for cloud in clouds]
    queries = [cloud[:: max(len(cloud) // _NUM_QUERIES, 1)] for cloud in clouds]
    one_way = np.array([[tree.query(points)[0].mean() for points in queries] for tree in trees])
    sums = (one_way + one_way.T).sum(axis=0)
    return min(candidates or range(len(clouds)), key=lambda at: float(sums[at]))
