"""Partial least squares against R, against a search for the axes, and against what was planted."""

import numpy as np
import pytest

from collalign.analysis.integration import two_block_pls
from collalign.analysis.procrustes import generalized_procrustes
from data_tools.errors import InputError
from tests.r_expected import check_expected, landmark_shapes


def right_shapes():
    points, _, sides = landmark_shapes()
    return points[[side == "R" for side in sides]]


def flat(points):
    return points.reshape(len(points), -1)


def of_r(name, first, second):
    found = two_block_pls(flat(first), flat(second), permutations=99)
    values = {f"{name}-singular-{at + 1}": found.covariances[at] for at in range(3)}
    values |= {f"{name}-r-{at + 1}": found.correlations[at] for at in range(3)}
    check_expected(values)
    assert np.isclose(found.r, found.correlations[0])
    return found


def test_covariances_and_correlations_are_those_of_r():
    shapes = right_shapes()
    whole = generalized_procrustes(shapes)
    of_r("pls", whole[:, :4], whole[:, 4:])
    of_r(
        "pls-separate", generalized_procrustes(shapes[:, :4]), generalized_procrustes(shapes[:, 4:])
    )
    with pytest.raises(AssertionError, match="pls-"):
        of_r("pls", whole[:, :3], whole[:, 3:])


def together(rng, num=40, strength=1.0):
    """Return blocks of 5 and 7 variables of which one variable each follows a common one."""
    common = rng.standard_normal((num, 1))
    first, second = rng.standard_normal((num, 5)), rng.standard_normal((num, 7))
    first[:, [2]] += strength * common
    second[:, [4]] += strength * common
    return first, second


def test_axes_scores_and_shares_are_what_they_say():
    first, second = together(np.random.default_rng(1))
    found = two_block_pls(first, second, permutations=99)
    for block, axes, scores in zip((first, second), found.axes, found.scores, strict=True):
        np.testing.assert_allclose(axes.T @ axes, np.eye(5), atol=1e-12)
        np.testing.assert_allclose((block - block.mean(axis=0)) @ axes, scores, atol=1e-12)
    cross = found.scores[0].T @ found.scores[1] / 39
    np.testing.assert_allclose(cross, np.diag(found.covariances), atol=1e-12)
    np.testing.assert_allclose(found.shares.sum(), 1)
    assert found.axes[0][2, 0] > 0.7
    assert found.axes[1][4, 0] > 0.7


def test_p_is_as_often_small_as_it_says_where_there_is_nothing():
    rng = np.random.default_rng(3)
    p = np.array([two_block_pls(*together(rng, 12, 0.0), permutations=99).p for _ in range(100)])
    assert 0.4 < p.mean() < 0.6
    assert np.mean(p <= 0.05) < 0.12


def test_what_cannot_go_together_is_refused():
    first, second = together(np.random.default_rng(5))
    with pytest.raises(InputError, match="got 40 and 39"):
        two_block_pls(first, second[1:])
    with pytest.raises(InputError, match="three shapes"):
        two_block_pls(first[:2], second[:2])
    with pytest.raises(InputError, match="second: is the same in all shapes"):
        two_block_pls(first, np.full((40, 2), 0.1))
    with pytest.raises(InputError, match="first"):
        two_block_pls(np.where(first == first[0, 0], np.nan, first), second)
