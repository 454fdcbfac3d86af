"""Poses of a scan on its model, and the axis about which it turns freely."""

import numpy as np
import pytest

from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.errors import OptionsError
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.generated.assembled import assembled_objects, cylinder
from pairwise.features.on_whole import TwoScales, free_axis, match_on_whole

TURN, SHIFT = random_rotation(np.random.default_rng(8)), np.array([0.5, -1.0, 2.0])


def scales(shape, cell):
    return TwoScales(surface_cells(shape, cell), surface_cells(shape, 0.5 * cell))


def model_and_view(model, direction, rng):
    """Return a model and a depth image of it, moved: its pose on the model is TURN and SHIFT."""
    cell = 0.08 * centre_and_radius(model)[1]
    seen = range_view(model, np.array(direction), noise=0.003, rng=rng)
    return scales(model, cell), scales(Shape.from_arrays((seen - SHIFT) @ TURN), cell)


@pytest.fixture(scope="module")
def plates():
    """A chair of thin boards, and a view of it: neighbourhoods tell little there."""
    rng = np.random.default_rng(0)
    return model_and_view(assembled_objects("chairs", 1, rng)[0], [1.0, 0.6, 0.5], rng)


def test_a_view_of_thin_boards_is_placed(plates):
    found = match_on_whole(*plates)
    assert pose_angle_deg(found.rotations[0], TURN) < 3
    assert np.linalg.norm(found.shifts[0] - SHIFT) < plates[0].coarse.cell
    assert found.overlaps[0, 1] > 0.9 > found.overlaps[0, 0]
    assert len(found) <= 8


def test_normals_on_the_other_side_do_not_matter_unless_the_side_is_known(plates):
    whole, part = plates
    behind = part.seen_from_behind()
    assert pose_angle_deg(match_on_whole(whole, behind, side_known=False).rotations[0], TURN) < 3
    told = match_on_whole(whole, behind, num_candidates=1)
    assert told.overlaps[0, 1] - 2.0 * told.in_front[0, 0] < 0.9


def test_mirror_images_are_found_where_they_are_allowed():
    rng = np.random.default_rng(1)
    whole, part = model_and_view(blob(rng, num_vertices=2000), [1.0, 0.3, 0.2], rng)
    assert (np.linalg.det(match_on_whole(whole, part).rotations) > 0).all()
    found = match_on_whole(whole, part.mirrored, group="O")
    assert np.linalg.det(found.rotations[0]) < 0
    assert pose_angle_deg(found.rotations[0] * [-1.0, 1.0, 1.0], TURN) < 3


def test_a_group_that_is_unknown_is_refused(plates):
    with pytest.raises(OptionsError, match="group"):
        match_on_whole(*plates, group="U")


def test_a_shaft_turns_freely_and_boards_do_not(plates):
    vertices, faces = cylinder(0.3, 2.0, [0.0, 0.0, 0.0])
    centre = np.array([1.0, 2.0, 0.0])
    shaft = surface_cells(Shape.from_arrays(vertices + centre, faces), 0.08)
    place, direction = free_axis(shaft, shaft, np.eye(3), np.zeros(3))
    length_axis = np.argmax(np.ptp(vertices, axis=0))
    assert abs(direction[length_axis]) > 0.99
    off = place - vertices.mean(axis=0) - centre
    assert np.linalg.norm(off - (off @ direction) * direction) < 0.05
    whole, part = plates
    assert free_axis(whole.coarse, part.coarse, TURN, SHIFT) is None
    behind = part.coarse.seen_from_behind()
    for side in (part.coarse, behind):
        assert free_axis(whole.coarse, side, TURN, SHIFT, side_known=False) is None
