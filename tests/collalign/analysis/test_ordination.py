import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform

from collalign.analysis.procrustes import classical_mds


def test_mds_recovers_points_of_a_plane(rng):
    points = rng.standard_normal((12, 2)) * [3, 1]
    distances = squareform(pdist(points))
    found, shares = classical_mds(distances)
    np.testing.assert_allclose(squareform(pdist(found)), distances, atol=1e-9)
    assert shares.sum() == pytest.approx(1)
    assert shares[0] > shares[1]


def test_the_largest_coordinate_of_each_axis_is_positive(rng):
    for points in rng.standard_normal((8, 6, 2)):
        found, _ = classical_mds(squareform(pdist(points)))
        assert (found.max(axis=0) == np.abs(found).max(axis=0)).all()
