"""Poses on which two depth images agree how far an object reaches: starts where they share hardly any surface."""

import numpy as np
import pytest

from data_tools.embedding.surface_points import surface_cells
from data_tools.poses import pose_angle_deg
from pairwise import match_overlapping
from pairwise.features.depth_images import extent_poses
from tests.views import SHIFT, TURN, WHOLE, view_from


def view_at(angle_deg, moved=False):
    """The depth image of a blob from an angle."""
    angle = np.radians(angle_deg)
    return view_from([np.cos(angle), np.sin(angle), 0.2], moved=moved)


@pytest.mark.parametrize("apart_deg", [30.0, 100.0])
def test_a_start_is_near_the_pose_of_two_depth_images(apart_deg):
    target, source = view_at(0.0), view_at(apart_deg, moved=True)
    rotations, shifts = extent_poses(target, source, 40)
    assert rotations.shape == (40, 3, 3)
    near = int(np.argmin(pose_angle_deg(rotations, TURN)))
    assert pose_angle_deg(rotations[near], TURN) < 20.0
    middle = source.points.mean(axis=0)
    gap = rotations[near] @ middle + shifts[near] - (TURN @ middle + SHIFT)
    assert np.linalg.norm(gap) < 6.0 * target.cell


def test_views_that_share_little_are_matched_by_how_far_they_reach():
    found = match_overlapping(view_at(0.0), view_at(100.0, moved=True))
    assert pose_angle_deg(found.rotations[0], TURN) < 8.0
    assert found.overlap[0] < 0.5


def test_whole_surfaces_have_no_starts_of_this_kind():
    target = view_at(0.0)
    surface = surface_cells(WHOLE, target.cell)
    for pair in ((target, surface), (surface, target)):
        rotations, shifts = extent_poses(*pair, 10)
        assert rotations.shape == (0, 3, 3)
        assert shifts.shape == (0, 3)
