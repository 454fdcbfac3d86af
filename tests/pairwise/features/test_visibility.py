"""What one direction saw: the line of sight of a depth image, and what lies in front of it at a pose."""

import numpy as np
import pytest

from collalign.confidence.overlap_model import overlap_log_odds
from data_tools.datasets.synthetic import range_view
from data_tools.embedding.surface_points import surface_cells
from data_tools.rotations import random_rotation
from data_tools.sight import DepthImage, place_of_sight
from data_tools.surface.shape import Shape
from experiments.generated.rooms import depth_frames, room, way_round
from pairwise.features.depth_images import sight_conflicts
from pairwise.features.overlap import evaluate_poses
from tests.views import WHOLE, view_from

SIGHTS = np.array([[0.3, 0.9, 0.4], [0.9, 0.3, 0.2]])
SIGHTS /= np.linalg.norm(SIGHTS, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def views():
    """Two depth images of a blob, some 45 degrees apart, as surfaces in its own coordinates."""
    return [view_from(sight, cell_radii=0.1) for sight in SIGHTS]


def test_a_depth_image_tells_where_it_was_seen_from_and_a_whole_shape_does_not(views):
    for view, sight in zip(views, SIGHTS, strict=True):
        assert view.sights[0] @ sight > 0.97
        assert (view.normals @ sight > 0).mean() > 0.99
    cell = views[0].cell
    assert not len(surface_cells(WHOLE, cell).sights)
    cloud = Shape.from_arrays(WHOLE.vertices, name="cloud")
    assert not len(surface_cells(cloud, cell).sights)


def test_normals_of_a_depth_image_of_separate_pieces_point_to_what_saw_it():
    x, y = (grid.ravel() for grid in np.mgrid[-1:1:60j, -1:1:60j])
    domes = [np.stack([x + 3.0 * k, y, 0.4 * k - 0.4 * (x**2 + y**2)], axis=1) for k in range(3)]
    surface = surface_cells(Shape.from_arrays(np.concatenate(domes), name="domes"), 0.12)
    assert surface.sights[0, 2] > 0.97
    assert (surface.normals[:, 2] > 0).all()


def test_nothing_is_in_front_at_the_right_pose_and_much_at_a_wrong_one(views):
    target, source = views
    still, moved = np.zeros(3), 0.5 * target.cell / 0.1 * SIGHTS[0]
    shares, beside = sight_conflicts(
        target, source, np.tile(np.eye(3), (3, 1, 1)), np.stack([still, moved, -moved])
    )
    assert shares[0].max() < 0.01
    assert shares[1, 1] > 0.3  # the source is in front of the target,
    assert shares[2, 0] > 0.2  # or the target in front of the source
    assert beside[0].max() < 0.01
    assert beside[2].max() > 0.1
    far, all_beside = sight_conflicts(target, source, np.eye(3)[None], np.full((1, 3), 50.0))
    assert far.max() == 0.0
    assert all_beside.min() == 1.0


def test_only_what_was_seen_from_one_direction_contradicts(views):
    surface = surface_cells(WHOLE, views[0].cell)
    rotations, shifts = np.eye(3)[None], np.zeros((1, 3))
    for shares in sight_conflicts(surface, views[0], rotations, shifts):
        assert not np.isnan(shares[0, 0])
        assert np.isnan(shares[0, 1])
    mirror = np.diag([-1.0, 1.0, 1.0])[None]
    image = views[0].mirrored
    judged = evaluate_poses(image, views[0], mirror, shifts)
    assert judged.in_front.max() < 0.01
    assert judged.beside.max() < 0.01
    assert judged.overlap[0] > 0.99


@pytest.fixture(scope="module")
def frames():
    """Two neighbouring depth frames of a corridor, each in the coordinates of its camera, and their poses."""
    rng = np.random.default_rng(2)
    way = way_round(20, rng, corridor=True)[[4, 5]]
    return depth_frames(room(rng, corridor=True), way, rng), way


def test_the_place_of_a_camera_is_where_its_rays_meet(frames):
    rng = np.random.default_rng(1)
    for frame in frames[0]:
        place = place_of_sight(frame.vertices)
        assert np.linalg.norm(place[0]) < 0.6
        turn = random_rotation(rng)
        moved = place_of_sight(frame.vertices @ turn.T + 3.0)
        np.testing.assert_allclose(moved[0], turn @ place[0] + 3.0, atol=0.1)
        surface = surface_cells(frame, 0.1, of_scene=True)
        thinned = surface.points[:: max(1, len(surface.points) // 700)]
        assert not len(place_of_sight(thinned[:90])), "of few points nothing is known"
    view = range_view(WHOLE, SIGHTS[0], noise=0.003, rng=rng)
    assert not len(place_of_sight(view)), "its rays are parallel"


def test_a_frame_slid_along_a_corridor_has_walls_on_walls_but_things_in_front(frames):
    (one, other), way = frames
    surfaces = [surface_cells(frame, 0.1, of_scene=True) for frame in (one, other)]
    right = np.linalg.inv(way[0]) @ way[1]
    slid = np.tile(way[1], (2, 1, 1))
    slid[:, 0, 3] += [1.0, -1.0]
    poses = np.stack([right, *(np.linalg.inv(way[0]) @ slid)])
    found = evaluate_poses(*surfaces, poses[:, :3, :3], poses[:, :3, 3])
    assert np.isnan(found.beside).all(), "a frame ends at its edge, which tells nothing"
    front = found.in_front.max(axis=1)
    assert front[0] < 0.002
    assert front[1:].max() > 0.01
    odds = overlap_log_odds(found)
    assert odds[0] > odds[1:].max() + 2.0


def test_a_slanted_wall_may_go_on_beside_the_image_nearer_than_what_was_seen_of_it():
    along, up = np.mgrid[1.0:6.0:0.1, -1.0:1.0:0.1].reshape(2, -1)
    wall = np.stack([along, np.full(along.shape, 1.0), up], axis=1)
    normals = np.tile([0.0, -1.0, 0.0], (len(wall), 1))
    seen = wall[along > 2.0]
    towards = np.array([-0.94, -np.sqrt(1.0 - 0.94**2), 0.0])
    image = DepthImage.around(np.zeros(3), seen, 0.1)
    placed = np.stack([wall, wall + 0.5 * towards])
    in_front = image.conflicts(placed, np.stack([normals, normals]))[:, 0]
    assert in_front[0] == 0.0
    assert in_front[1] > 0.1, "a wall that was moved towards the camera is in front"
