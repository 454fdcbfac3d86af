"""Registration on generated shapes whose true correspondence is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.registration.register import MIN_VOLUME_CHANGE, FieldSpace, SmoothField, register
from collalign.registration.surface import RegistrationSurface
from collalign.tools.correspond import medoid
from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import crown, figure
from data_tools.errors import InputError
from data_tools.poses import fitting_similarity, moved_by
from data_tools.surface.shape import Shape

pytestmark = pytest.mark.usefixtures("quick_search")


def surface(shape):
    return RegistrationSurface.from_shape(shape, 800)


def volume_change(field, points):
    """Determinant of the field's Jacobian: not positive where space is folded."""
    return np.linalg.det(field.jacobian(field.space.slopes(points)))


def error(target, found):
    """Return the mean distance of vertices from where they truly are, in root mean square radii."""
    radius = np.sqrt(((target.vertices - target.vertices.mean(axis=0)) ** 2).sum(axis=1).mean())
    return float(np.linalg.norm(found - target.vertices, axis=1).mean() / radius)


@pytest.fixture(scope="module")
def pair():
    source = crown(np.random.default_rng(0))
    return bumped(source, np.random.default_rng(10), rms=0.04), source


def test_a_shape_on_itself_stays():
    shape = figure()
    found, _ = register(surface(shape), surface(shape))
    assert error(shape, found.vertices) < 1e-6
    assert found.residual.max() < 1e-6


def test_a_part_without_counterpart_is_not_pulled(pair):
    """Half of the target is cut away: the other half must not crowd at the rim."""
    target, source = pair
    kept = target.vertices[target.faces].mean(axis=1)[:, 0] > 0
    half = Shape.from_arrays(target.vertices, target.faces[kept])
    used = np.unique(half.faces)
    half = Shape.from_arrays(target.vertices[used], np.searchsorted(used, half.faces))
    found, _ = register(surface(half), surface(source))
    lost = np.setdiff1d(np.arange(len(source.vertices)), used)
    far = lost[target.vertices[lost, 0] < -0.3]
    assert found.quality[far].mean() < 0.2 < 0.5 < found.quality[used].mean()
    assert np.linalg.norm(found.vertices[far] - source.vertices[far], axis=1).mean() < 0.2


def test_clouds_are_registered_by_positions(pair):
    target, source = pair
    clouds = [Shape.from_arrays(shape.vertices) for shape in (target, source)]
    found, _ = register(*map(surface, clouds))
    assert error(target, found.vertices) < error(target, source.vertices)


def test_nothing_folds_where_correspondences_would_cross():
    """A thin plate is asked to shrink to a fifth and to reach far: the stiffness has to rise."""
    source = crown(np.random.default_rng(4))
    target = Shape.from_arrays(source.vertices * [0.15, 1.6, 1.0], source.faces)
    _, field = register(surface(target), surface(source))
    assert volume_change(field, source.vertices).min() >= 0.5 * MIN_VOLUME_CHANGE


def test_a_wrong_size_and_turn_are_made_good_before_anything_bends(pair):
    target, _ = pair
    turned = np.eye(4)
    turned[:3, :3] = 1.06 * Rotation.from_euler("xyz", [4, -3, 5], degrees=True).as_matrix()
    turned[:3, 3] = 0.03
    found, field = register(surface(target.transformed(turned)), surface(target))
    np.testing.assert_allclose(found.pose, turned, atol=5e-3)
    assert field.bending < 1e-2
    assert error(target.transformed(turned), found.vertices) < 5e-3


def test_a_similarity_is_fitted_exactly_and_never_mirrors():
    rng = np.random.default_rng(7)
    points, pose = rng.random((30, 3)), np.eye(4)
    pose[:3, :3] = 1.7 * Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix()
    pose[:3, 3] = [1, 2, 3]
    np.testing.assert_allclose(
        fitting_similarity(moved_by(pose, points), points, rng.random(30)), pose, atol=1e-12
    )
    mirrored = fitting_similarity(points * [1, 1, -1], points, np.ones(30))
    assert np.linalg.det(mirrored[:3, :3]) > 0
    held = fitting_similarity(1.5 * points + 2, points, np.ones(30), may_rotate=False)
    np.testing.assert_allclose(
        held[:3], np.hstack([1.5 * np.eye(3), np.full((3, 1), 2.0)]), atol=1e-12
    )


def test_the_jacobian_is_that_of_the_displacement():
    rng = np.random.default_rng(5)
    space = FieldSpace.at(rng.random((20, 3)), (0.5, 0.2), (0.3, 0.2))
    coefficients = rng.normal(size=(space.modes.shape[1], 3))
    field = SmoothField(space=space, coefficients=coefficients)
    points, step = rng.random((6, 3)), 1e-6
    columns = [
        (field.moved(points + step * e) - field.moved(points - step * e)) / (2 * step)
        for e in np.eye(3)
    ]
    np.testing.assert_allclose(
        volume_change(field, points), np.linalg.det(np.stack(columns, axis=2)), rtol=1e-5
    )


def test_the_medoid_is_in_the_middle():
    cloud = np.random.default_rng(6).random((50, 3))
    assert medoid([cloud, cloud + 0.4, cloud + 0.8]) == 1
    assert medoid([cloud, cloud]) == 0
    assert medoid([cloud, cloud + 0.4, cloud + 0.8], [0, 2]) in (0, 2)


def test_surfaces_that_face_each_other_nowhere_are_refused():
    """A patch seen from above and one seen from below have no normals in common."""
    grid = np.array([[x, y, 0.05 * x * y] for x in range(5) for y in range(5)], dtype=float)
    cells = [(5 * x + y, 5 * x + y + 5, 5 * x + y + 1) for x in range(4) for y in range(4)]
    patch = RegistrationSurface.from_shape(Shape.from_arrays(grid, cells), 20)
    below = RegistrationSurface(**{**vars(patch), "faces": patch.faces[:, ::-1]})
    with pytest.raises(InputError, match="no point"):
        register(below, patch)
