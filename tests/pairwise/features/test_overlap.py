"""Two surfaces that overlap: their pose, and what both explain of each other there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.embedding.surface_points import surface_cells
from data_tools.errors import OptionsError
from data_tools.local_surface import LocalSurface
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from pairwise import evaluate_poses, match_overlapping
from pairwise.features.overlap import closeness
from tests.views import SHIFT, TURN, view_from


@pytest.fixture(scope="module")
def views():
    """Two views of one blob, 45 degrees apart, the second one moved: its pose on the first is TURN and SHIFT."""
    return view_from([1.0, 0.0, 0.2]), view_from([0.7, 0.7, 0.2], moved=True)


@pytest.fixture(scope="module")
def sphere():
    return surface_cells(Shape.from_arrays(*sphere_mesh(1500), name="sphere"), 0.12)


def half(surface, axis):
    kept = surface.points @ axis >= 0.0
    return LocalSurface.from_user(surface.points[kept], surface.normals[kept], surface.cell)


def test_the_pose_of_two_views_is_found(views):
    found = match_overlapping(*views)
    assert pose_angle_deg(found.rotations[0], TURN) < 1.5
    assert np.linalg.norm(found.shifts[0] - SHIFT) < views[0].cell
    assert found.overlap[0] > 0.6
    assert found.consensus[0] > 3.0 * found.consensus[1:].max(initial=0.0)
    assert len(found) <= 8
    assert len(match_overlapping(*views, num_candidates=1)) == 1


def test_groups_are_checked(views):
    with pytest.raises(OptionsError, match="group"):
        match_overlapping(*views, group="U")


def test_the_true_pose_is_judged_better_than_wrong_ones(views, rng):
    wrong = np.stack([random_rotation(rng) for _ in range(5)])
    middle = views[1].points.mean(axis=0)
    shifts = TURN @ middle + SHIFT - wrong @ middle
    found = evaluate_poses(
        *views, np.concatenate([TURN[None], wrong]), np.concatenate([SHIFT[None], shifts])
    )
    assert found.overlap[0] > found.overlap[1:].max()
    assert found.consensus[0] > 5.0 * found.consensus[1:].max()
    assert found.mismatch[0] < found.mismatch[1:].min() - 0.1
    chosen = found[[2, 0]]
    np.testing.assert_array_equal(chosen.mismatch, found.mismatch[[2, 0]])
    np.testing.assert_array_equal(chosen.overlaps, found.overlaps[[2, 0]])


def test_overlaps_are_the_shares_of_both_surfaces(sphere):
    up, side = half(sphere, np.eye(3)[2]), half(sphere, np.eye(3)[0])
    for target, source, shares in (
        (up, side, (0.5, 0.5)),
        (up, up, (1.0, 1.0)),
        (sphere, up, (0.5, 1.0)),
    ):
        overlaps, _ = closeness(target, source, np.eye(3)[None], np.zeros((1, 3)))
        assert overlaps[0] == pytest.approx(shares, abs=0.1)
    apart, _ = closeness(up, up, np.diag([1.0, -1.0, -1.0])[None], np.zeros((1, 3)))
    assert apart.max() < 0.2
    inside_out = LocalSurface.from_user(up.points, -up.normals, up.cell)
    assert closeness(up, inside_out, np.eye(3)[None], np.zeros((1, 3)))[0].max() < 0.02


def test_mismatch_is_none_for_copies_and_whole_for_what_is_far(views):
    target = views[0]
    shifts = np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 0.0]])
    overlaps, mismatches = closeness(target, target, np.tile(np.eye(3), (2, 1, 1)), shifts)
    mismatch = mismatches.mean(axis=1)
    assert mismatch == pytest.approx([0.0, 1.0], abs=1e-3)
    assert overlaps.tolist() == [[1.0, 1.0], [0.0, 0.0]]
    rotated = Rotation.from_rotvec([[0.0, 0.0, a] for a in (0.1, 0.3)]).as_matrix()
    nearer, farther = closeness(target, target, rotated, np.zeros((2, 3)), num_points=200)[1].mean(
        axis=1
    )
    assert 0.0 < nearer < farther < 1.0
