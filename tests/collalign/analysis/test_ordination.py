import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform

from collalign.analysis.ordination import classical_mds, cophenetic_tree
from data_tools.errors import InputError


def test_mds_recovers_points_of_a_plane(rng):
    points = rng.standard_normal((12, 2)) * [3, 1]
    distances = squareform(pdist(points))
    found, shares = classical_mds(distances)
    np.testing.assert_allclose(squareform(pdist(found)), distances, atol=1e-9)
    assert shares.sum() == pytest.approx(1)
    assert shares[0] > shares[1]


def test_mds_of_two_and_of_equal_shapes():
    found, _ = classical_mds([[0, 3], [3, 0]])
    assert np.linalg.norm(found[0] - found[1]) == pytest.approx(3)
    found, shares = classical_mds(np.zeros((3, 3)))
    assert not found.any()
    assert not shares.any()


def test_tree_of_ultrametric_distances_is_exact():
    distances = np.array([[0, 1, 4, 4], [1, 0, 4, 4], [4, 4, 0, 2], [4, 4, 2, 0]], dtype=float)
    tree = cophenetic_tree(distances)
    assert tree.correlation == pytest.approx(1)
    assert sorted(tree.order) == [0, 1, 2, 3]
    np.testing.assert_allclose(sorted(tree.linkage[:, 2]), [1, 2, 4])


def test_correlation_tells_how_much_a_tree_can_show(rng):
    tree = cophenetic_tree(squareform(pdist(rng.standard_normal((20, 3)))))
    assert 0 < tree.correlation < 1


def test_bad_distances_are_refused():
    with pytest.raises(InputError, match="at least two"):
        cophenetic_tree([[0.0]])
    with pytest.raises(InputError, match="NaN"):
        cophenetic_tree([[0, np.nan], [np.nan, 0]])
