"""Votes of pairs of points for poses of a part on its whole."""

import numpy as np

from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.local_surface import LocalSurface
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from pairwise.features.point_pairs import TUNED, pair_vote_poses

TURN, SHIFT = random_rotation(np.random.default_rng(4)), np.array([1.0, 2.0, -3.0])


def whole_and_part(seed):
    """Return a blob and a third of it, moved: its pose on the blob is TURN and SHIFT."""
    shape = blob(np.random.default_rng(seed), num_vertices=2000)
    whole = surface_cells(shape, 0.08 * centre_and_radius(shape)[1])
    kept = whole.points[:, 0] > np.quantile(whole.points[:, 0], 0.67)
    points, normals = (whole.points[kept] - SHIFT) @ TURN, whole.normals[kept] @ TURN
    return whole, LocalSurface.from_user(points, normals, whole.cell)


def are_near(rotations, shifts, part, cell):
    middle = part.points.mean(axis=0)
    off = np.linalg.norm(rotations @ middle + shifts - (TURN @ middle + SHIFT), axis=1)
    return (pose_angle_deg(rotations, TURN) < 25) & (off < 5 * cell)


def test_most_votes_are_for_the_pose_of_the_part():
    whole, part = whole_and_part(3)
    rotations, shifts, votes = pair_vote_poses(whole, part)
    near = are_near(rotations, shifts, part, whole.cell)
    assert near[np.argmax(votes)]
    assert near.mean() > 0.3
    assert len(votes) <= TUNED.num_references * TUNED.num_places + TUNED.num_places
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)


def test_a_part_of_another_surface_gets_fewer_votes():
    whole, part = whole_and_part(3)
    other, _ = whole_and_part(5)
    assert pair_vote_poses(whole, part)[2].mean() > 1.2 * pair_vote_poses(other, part)[2].mean()
