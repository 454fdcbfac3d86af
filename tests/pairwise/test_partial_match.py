"""Matching surfaces that overlap in part: planted poses of cut blobs, wrong poses that cost more, refusals."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import spread_points
from data_tools.errors import InputError, OptionsError
from data_tools.partial_surface import GRID_CELLS, GRID_MARGIN, PartialSurface
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from pairwise.partial_counterparts import TUNED, counterparts
from pairwise.partial_match import describe_both, match_partial, refine, scales_allowed

NUM = 400


def cut(shape, direction, share):
    """Return the shape without the share of its vertices that lies farthest in a direction."""
    heights = shape.vertices @ direction
    kept = heights <= np.quantile(heights, 1.0 - share)
    faces = shape.faces[kept[shape.faces].all(axis=1)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return Shape.from_arrays(shape.vertices[used], renumbered.reshape(-1, 3), name=shape.name)


def surface(shape):
    return spread_points(shape, NUM)


def moved(shape, turn, scale, shift):
    faces = shape.faces if np.linalg.det(turn) > 0 else shape.faces[:, ::-1]
    return Shape.from_arrays(scale * shape.vertices @ turn.T + shift, faces, name=shape.name)


@pytest.fixture(scope="module")
def whole():
    return blob(np.random.default_rng(5), num_vertices=1200)


@pytest.mark.parametrize("scale", [1e-3, 0.5, 1.0, 1e3])
def test_neighbourhoods_are_described_at_any_size(whole, scale):
    for points in describe_both(surface(whole), surface(whole), scale):
        assert len(points.points) >= TUNED.least_described


@pytest.mark.parametrize("group", ["SO", "O"])
def test_a_cut_blob_finds_its_place_on_the_whole_one(whole, group):
    rng = np.random.default_rng(1)
    turn = random_rotation(rng, group="SO") * (-1.0 if group == "O" else 1.0)
    other = bumped(whole, rng, rms=0.01)
    broken = moved(cut(other, rng.standard_normal(3), 0.35), turn, 0.4, np.array([3.0, -1.0, 2.0]))
    best, *rest = match_partial(surface(whole), surface(broken), group=group)
    assert rotation_angle_deg(best.pose.rotation, turn.T) < 4
    assert best.pose.scale == pytest.approx(1 / 0.4, rel=0.05)
    np.testing.assert_allclose(
        best.pose.scale * broken.vertices.mean(axis=0) @ best.pose.rotation.T + best.pose.shift,
        (broken.vertices.mean(axis=0) - [3.0, -1.0, 2.0]) / 0.4 @ turn,
        atol=0.1,
    )
    assert best.overlap_source > 0.9
    assert 0.5 < best.overlap_target < 0.85
    assert all(pose.energy > best.energy for pose in rest)
    assert group == "O" or match_partial(surface(whole), surface(broken))[0].energy == best.energy


def test_the_energy_tells_a_wrong_pose_from_the_right_one(whole):
    to = surface(whole)
    of = surface(cut(whole, np.array([0.0, 1.0, 0.0]), 0.25))
    turns = np.stack([np.eye(3), random_rotation(np.random.default_rng(4))])
    poses = Similarity(rotation=turns, scale=np.ones(2), shift=np.zeros((2, 3)))
    found = counterparts(to, of, poses, NUM)
    right, wrong = found.energies
    assert right < 0.5 * wrong
    assert found.overlaps()[0, 1] > found.overlaps()[1, 1]
    held = refine([to], of, poses[1:], scale_range=scales_allowed([to], of), hold_rotations=True)
    np.testing.assert_array_equal(held.rotation, turns[1:])
    assert not np.allclose(held.shift, 0.0)


def test_the_grid_answers_with_nearly_the_nearest_point(whole):
    to = surface(whole)
    rng = np.random.default_rng(6)
    places = to.points[rng.integers(NUM, size=50)] + 0.05 * rng.standard_normal((50, 3))
    found = to.nearest(places)
    exact = cKDTree(to.points).query(places)[0]
    cell = (np.ptp(to.points, axis=0).max() + 2 * GRID_MARGIN * to.radius) / GRID_CELLS
    excess = np.linalg.norm(to.points[found] - places, axis=1) - exact
    assert 0 < excess.max() <= np.sqrt(3) * cell
    assert to.nearest(np.full((1, 3), 100.0)).tolist() == [-1]


def test_impossible_surfaces_are_refused():
    with pytest.raises(InputError, match="one place"):
        PartialSurface.from_user(np.ones((5, 3)))
    with pytest.raises(InputError, match="on_rim"):
        PartialSurface.from_user(
            np.random.default_rng(0).random((5, 3)), on_rim=np.zeros(4, dtype=bool)
        )
    with pytest.raises(OptionsError, match="group"):
        match_partial(
            *[PartialSurface.from_user(np.random.default_rng(0).random((5, 3)))] * 2, group="E"
        )
