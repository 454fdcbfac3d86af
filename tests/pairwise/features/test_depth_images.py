"""Poses on which two depth images agree how far an object reaches: starts where they share hardly any surface."""

import numpy as np
import pytest

from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from pairwise import match_overlapping
from pairwise.features.depth_images import extent_poses

TURN, SHIFT = random_rotation(np.random.default_rng(5)), np.array([2.0, -1.0, 0.5])


@pytest.fixture(scope="module")
def whole():
    return blob(np.random.default_rng(1), num_vertices=1500)


@pytest.fixture(scope="module")
def view_from(whole):
    """Makes the depth image of a blob from an angle, in degrees."""
    cell = 0.08 * centre_and_radius(whole)[1]

    def view(angle_deg, moved=False):
        angle = np.radians(angle_deg)
        sight = np.array([np.cos(angle), np.sin(angle), 0.2])
        points = range_view(whole, sight, noise=0.003, rng=np.random.default_rng(0))
        points = (points - SHIFT) @ TURN if moved else points
        return surface_cells(Shape.from_arrays(points, name="view"), cell)

    return view


@pytest.mark.parametrize("apart_deg", [30.0, 100.0])
def test_a_start_is_near_the_pose_of_two_depth_images(view_from, apart_deg):
    target, source = view_from(0.0), view_from(apart_deg, moved=True)
    rotations, shifts = extent_poses(target, source, 40)
    assert rotations.shape == (40, 3, 3)
    near = int(np.argmin(pose_angle_deg(rotations, TURN)))
    assert pose_angle_deg(rotations[near], TURN) < 20.0
    middle = source.points.mean(axis=0)
    gap = rotations[near] @ middle + shifts[near] - (TURN @ middle + SHIFT)
    assert np.linalg.norm(gap) < 6.0 * target.cell


def test_views_that_share_little_are_matched_by_how_far_they_reach(view_from):
    found = match_overlapping(view_from(0.0), view_from(100.0, moved=True))
    assert pose_angle_deg(found.rotations[0], TURN) < 8.0
    assert found.overlap[0] < 0.5


def test_whole_surfaces_have_no_starts_of_this_kind(view_from, whole):
    target = view_from(0.0)
    surface = surface_cells(whole, target.cell)
    for pair in ((target, surface), (surface, target)):
        rotations, shifts = extent_poses(*pair, 10)
        assert rotations.shape == (0, 3, 3)
        assert shifts.shape == (0, 3)
