"""What joins the pairs in a proof of all arrangements, checked against arrangements."""

import itertools

import numpy as np
import pytest

from data_tools.rotations import random_rotation
from pairwise.certificates.verify import gram_bound, gram_matrix


def multipliers(rng):
    edges = np.array(list(itertools.combinations(range(5), 2)))
    return edges, rng.standard_normal((10, 3, 3)), 3.0 * rng.standard_normal((5, 3, 3))


def test_no_poses_fall_below_the_gram_bound_whatever_the_diagonal_and_some_come_near_a_good_one():
    rng = np.random.default_rng(0)
    edges, tilts, diagonal = multipliers(rng)
    frames = np.array([[random_rotation(rng, group="O") for _ in range(5)] for _ in range(2000)])
    values = (tilts * (np.swapaxes(frames[:, edges[:, 0]], 2, 3) @ frames[:, edges[:, 1]])).sum(
        axis=(1, 2, 3)
    )
    assert gram_bound(edges, tilts, diagonal) <= values.min()
    known = frames[0]
    pulls = -np.swapaxes(known[edges[:, 0]], 1, 2) @ known[edges[:, 1]]
    tight = gram_bound(edges, pulls, np.tile(2.0 * np.eye(3), (5, 1, 1)))
    assert tight == pytest.approx(-30.0, abs=1e-9)
    nothing = gram_bound(edges, np.zeros_like(tilts), np.tile(np.eye(3) / 3.0, (5, 1, 1)))
    assert nothing < -5.0 < nothing + 1e-9, "rounding is allowed for"
    assert np.array_equal(
        gram_matrix(edges, tilts, diagonal), gram_matrix(edges, tilts, diagonal).T
    )
