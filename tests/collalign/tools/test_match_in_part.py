"""Two shapes that share a part: depth images of one object, another size, and shapes too small to say anything."""

import numpy as np
import pytest

from collalign import match_in_part
from collalign.tools.match.on_whole import both_scales, is_closed
from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.shafts import stepped_shaft

AS_FILED = SamplingOptions(normalisation="none")


@pytest.fixture(scope="module")
def views():
    """Return a depth image, another one from 40 degrees away in another pose, that pose, and the whole object."""
    rng = np.random.default_rng(2)
    whole = blob(rng, num_vertices=3000)
    angles = np.radians([0.0, 40.0])
    seen = [
        range_view(whole, np.array([np.cos(a), np.sin(a), 0.2]), pixels=100, noise=0.002, rng=rng)
        for a in angles
    ]
    turn, shift = random_rotation(rng), np.array([4.0, -2.0, 1.0])
    return seen[0], seen[1] @ turn.T + shift, turn, shift, whole


def test_depth_images_are_matched_on_what_both_show(views):
    first, second, turn, shift, _ = views
    found = match_in_part(first, second, sampling=AS_FILED)
    assert rotation_angle_deg(found.transform[:3, :3] @ turn, np.eye(3)) < 3
    np.testing.assert_allclose(
        found.transform[:3, :3] @ shift + found.transform[:3, 3], 0.0, atol=0.1
    )
    assert 0.5 < found.poses[0].overlap_source < 0.98
    chances = np.array([pose.chance for pose in found.poses])
    assert (np.diff(chances) <= 0).all()
    assert chances.sum() <= 1.0 + 1e-9
    assert 0.8 < found.confidence < 1.0
    assert [one["chance"] for one in found.record()["candidates"]] == chances.tolist()


def test_too_few_points_give_no_pose(rng):
    few = rng.random((20, 3))
    with pytest.raises(InputError, match="no pose was found"):
        match_in_part(few, few, sampling=AS_FILED)


def test_a_model_is_placed_on_its_scan_as_the_scan_is_on_it(views):
    _, second, turn, shift, whole = views
    found = match_in_part(second, whole, sampling=AS_FILED)
    assert rotation_angle_deg(found.transform[:3, :3], turn) < 3
    np.testing.assert_allclose(found.transform[:3, 3], shift, atol=0.1)
    assert found.poses[0].overlap_target > 0.95 > found.poses[0].overlap_source
    assert found.free_axis is None
    assert found.record()["free_axis"] is None


def test_a_scan_in_another_unit_is_no_part_of_its_model(views):
    _, second, *_, whole = views
    scan = Shape.from_arrays(second)
    assert both_scales(whole, scan) is not None
    assert both_scales(whole, Shape.from_arrays(1000.0 * second)) is None
    assert both_scales(whole, Shape.from_arrays(0.001 * second)) is None
    assert is_closed(whole)
    assert not is_closed(scan)
    assert not is_closed(Shape.from_arrays(whole.vertices, whole.faces[:-400]))


@pytest.mark.parametrize("is_target", [True, False])
def test_the_axis_of_a_shaft_is_named_and_its_turns_count_together(is_target):
    rng = np.random.default_rng(3)
    shaft = stepped_shaft()
    turn = random_rotation(rng)
    scan = range_view(shaft, np.array([1.0, 0.2, 0.4]), noise=0.002, rng=rng) @ turn.T
    model = (shaft.vertices, shaft.faces)
    found = match_in_part(*((model, scan) if is_target else (scan, model)), sampling=AS_FILED)
    assert found.free_axis is not None
    axis = np.array([0, 0, 1.0]) if is_target else turn @ [0, 0, 1.0]
    assert abs(found.free_axis[1] @ axis) > 0.99
    assert np.linalg.norm(np.cross(found.free_axis[0], axis)) < 0.03
    assert found.confidence > found.poses[0].chance
    assert set(found.record()["free_axis"]) == {"point", "direction"}
