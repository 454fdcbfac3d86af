"""Which shape of a collection lends its triangles to the mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray


def medoid(clouds: Sequence[FloatArray]) -> int:
    """Return the cloud whose summed distances to all others are least; the first of several.

    The distance of two posed clouds is the mean distance of points to the nearest of the other, both ways. The medoid
    is the best start for a mean: no shape is very far from it.
    """
    trees = [cKDTree(cloud) for cloud in clouds]
    one_way = np.array([[tree.query(cloud)[0].mean() for cloud in clouds] for tree in trees])
    return int((one_way + one_way.T).sum(axis=0).argmin())
