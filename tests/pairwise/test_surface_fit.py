"""The fit of two surfaces: exact where they are one, by their planes where alike, and by the part that they share."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import blob, crown, figure
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape, outward_normals
from pairwise.dense import DenseMatcher, DensePoints
from pairwise.surface_fit import FIT, _agrees, _Settled, _stepped, fit_surfaces


def fitted(target, source, start=None):
    return fit_surfaces(target, source, np.eye(3) if start is None else start, max_iterations=30)


def spread(points, num, normals=None):
    """Return an even choice of points."""
    chosen = farthest_points(Shape.from_arrays(points), num, metric="euclidean")
    return DensePoints.from_user(points[chosen], None if normals is None else normals[chosen])


def two_samplings(shape, num, *, change=None, with_normals=False):
    """Return two even choices of points of a shape that have none in common, the second ones changed."""
    normals = outward_normals(shape)
    halves = np.random.default_rng(6).permutation(len(shape.vertices))
    made = []
    for half in (halves[::2], halves[1::2]):
        points = shape.vertices[half]
        points = change(points) if made and change else points
        made.append(spread(points, num, normals[half] if with_normals else None))
    return made


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("with_normals", [False, True])
def test_exact_pose_scale_and_shift_are_recovered(mirrored, with_normals, rng):
    shape = crown(np.random.default_rng(0), num_vertices=300)
    points, normals = shape.vertices, outward_normals(shape)
    turn = random_rotation(rng) @ (np.diag([1.0, 1.0, -1.0]) if mirrored else np.eye(3))
    target, source = (
        DensePoints.from_user(places, directions if with_normals else None)
        for places, directions in (
            (points, normals),
            (2.5 * (points @ turn) + [1.0, 2.0, 3.0], normals @ turn),
        )
    )
    start = turn @ Rotation.from_rotvec([0.1, -0.08, 0.05]).as_matrix()
    found = fitted(target, source, start)
    assert rotation_angle_deg(found.pose.rotation, turn) < 0.1
    assert found.pose.scale == pytest.approx(0.4, rel=1e-3)
    assert np.allclose(found.pose.apply(source.points), points, atol=5e-3)


def test_a_size_that_is_known_stays(rng):
    points = crown(np.random.default_rng(0), num_vertices=300).vertices
    turn = Rotation.from_rotvec([0.05, 0.1, 0.0]).as_matrix()
    target, source = (DensePoints.from_user(one) for one in (points, 1.1 * points @ turn))
    held, free = (
        fit_surfaces(target, source, np.eye(3), estimate_scale=free).pose for free in (False, True)
    )
    assert (held.scale, free.scale) == (1.0, pytest.approx(1 / 1.1, rel=1e-3))
    assert rotation_angle_deg(held.rotation, turn) < 1.0


def test_a_far_start_ends_elsewhere():
    """The recovery tests can fail: from half a turn away the answer is another one."""
    shape = DensePoints.from_user(crown(np.random.default_rng(0), num_vertices=300).vertices)
    assert rotation_angle_deg(fitted(shape, shape, np.diag([-1.0, -1.0, 1.0])).pose.rotation) > 30


def test_the_plane_has_one_rotation(rng):
    points = rng.random((200, 2))
    angle = 0.1
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shape, moved = DensePoints.from_user(points), DensePoints.from_user(points @ turn)
    found = fit_surfaces(shape, moved, np.eye(2), max_iterations=30)
    assert np.allclose(found.pose.rotation, turn, atol=1e-3)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
def test_a_sheet_is_moved_across_or_along_itself(direction, rng):
    """Then one of the two variances is zero, and the other one holds all gaps."""
    sheet = np.column_stack([rng.random((50, 2)), np.zeros(50)])
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    still = Similarity(rotation=np.eye(3), scale=1.0, shift=np.zeros(3))
    gaps = np.tile(0.1 * np.array(direction), (50, 1))
    moved = _stepped(still, sheet, gaps, up, np.ones(50), any_size=True)
    assert np.allclose(moved.apply(sheet), sheet + gaps)


def bowed(points):
    """Bend the head and the arms of a figure forwards by a radian."""
    above = points[:, 2] > 12.0
    hinge = points[above].mean(axis=0) * [1.0, 1.0, 0.0] + [0.0, 0.0, 12.0]
    moved = points.copy()
    moved[above] = Rotation.from_rotvec([1.0, 0.0, 0.0]).apply(points[above] - hinge) + hinge
    return moved


def test_a_bent_part_does_not_move_the_pose_of_the_shared_one():
    target, source = two_samplings(figure(resolution=4), 300, change=bowed)
    found = fitted(target, source)
    whole = fit_surfaces(target, source, np.eye(3), find_shared=False, max_iterations=30)
    assert rotation_angle_deg(whole.pose.rotation) > 5
    assert whole.shared_energy == whole.energy < found.energy
    assert rotation_angle_deg(found.pose.rotation) < 2.5
    assert FIT.least_gain * found.shared_energy < found.energy


@pytest.mark.parametrize(
    ("near", "far", "is_shared"), [(0.1, 0.5, True), (0.1, 0.12, False), (0.7, 3.5, False)]
)
def test_a_part_is_shared_if_it_is_near_and_the_rest_is_farther_than_usual(near, far, is_shared):
    """Distances in spacings of a grid, the nearer ones of 60 %."""
    shape = DensePoints.from_user(np.stack(np.meshgrid(*[np.arange(5.0)] * 3), -1).reshape(-1, 3))
    still = Similarity(rotation=np.eye(3), scale=1.0, shift=np.zeros(3))
    pairs = np.tile(np.arange(125), 2), np.tile(np.arange(125), 2)
    fit = _Settled(still, pairs, np.repeat([near, far], [150, 100]))
    assert _agrees(DenseMatcher(shape, shape), fit, FIT.shared_spacings) == is_shared


def test_surfaces_that_differ_everywhere_share_no_part(rng):
    surface = blob(rng, num_vertices=1200)
    target, source = (
        DensePoints.from_user(bumped(surface, rng, rms=0.06).vertices[::3]) for _ in range(2)
    )
    found = fitted(target, source)
    assert found.shared_energy == found.energy


def test_coarse_points_do_not_tell_what_is_shared():
    """Of 50 points, half are within .6 of their spacing at poses several degrees apart."""
    for num, is_shared in ((300, True), (50, False)):
        found = fitted(*two_samplings(figure(resolution=4), num, change=bowed))
        assert (found.shared_energy < found.energy) == is_shared


def test_bad_input_is_refused():
    shape = DensePoints.from_user(crown(num_vertices=100).vertices)
    with pytest.raises(InputError, match="not orthogonal"):
        fitted(shape, shape, 2 * np.eye(3))
    with pytest.raises(InputError, match="expected 3 coordinates"):
        fitted(shape, DensePoints.from_user(shape.points[:, :2]))
    with pytest.raises(OptionsError, match="max_iterations"):
        fit_surfaces(shape, shape, np.eye(3), max_iterations=0)
