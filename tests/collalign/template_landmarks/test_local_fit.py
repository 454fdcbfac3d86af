"""Rigid fits of what is around a landmark: where they agree with the map that carried it, and where not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.template_landmarks.local_fit import Surroundings, fit_surroundings, holds
from data_tools.datasets.synthetic_shapes import blob, sphere_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape, vertex_normals


@pytest.fixture
def shape(rng):
    return blob(rng, num_vertices=1500)


def fitted(shape, specimen, copy, rows):
    """Fit the surroundings of some vertices of a shape to a specimen, on which ``copy`` says that they are."""
    marks = shape.vertices[rows]
    around = Surroundings.of(marks, marks, shape.vertices, shape.vertices, 1.0)
    return fit_surroundings(
        around,
        shape.vertices,
        copy,
        SurfaceLocator(specimen, shape.faces),
        vertex_normals(specimen, shape.faces),
        1.0,
    )


def test_a_fit_stays_where_a_right_map_takes_the_landmarks(shape, rng):
    moved = 2.0 * shape.vertices @ random_rotation(rng).T + 3.0
    rows = rng.permutation(len(moved))[:20]
    places, misfits = fitted(shape, moved, moved, rows)
    np.testing.assert_allclose(places, moved[rows], atol=1e-6)
    assert misfits.max() < 1e-6


def test_a_fit_leaves_a_map_that_slid_and_goes_back_to_the_feature(rng):
    """A bump holds its landmark, whereto the map has slid by .15."""
    directions, faces = sphere_mesh(2000)
    top = np.array([0.0, 0.0, 1.0])
    bump = 0.4 * np.exp(-((directions - top) ** 2).sum(axis=1) / 0.03)
    shape = Shape.from_arrays(directions * (1 + bump)[:, None], faces, name="bump")
    slid = Rotation.from_euler("x", 0.1).as_matrix()
    rows = [int(np.argmax(directions @ top))]
    locator = SurfaceLocator(shape.vertices, faces)
    copy = locator.closest(shape.vertices @ slid.T).on(shape.vertices)
    places, misfits = fitted(shape, shape.vertices, copy, rows)
    truth = shape.vertices[rows]
    assert np.linalg.norm(places - truth) < 0.5 * np.linalg.norm(copy[rows] - truth)
    other = fitted(shape, directions, directions, rows)[1]
    assert misfits < 0.5 * other, "a bump does not fit a sphere"


def test_missing_landmarks_are_no_trouble_and_a_cloud_stays(shape):
    marks = np.array([shape.vertices[7], [np.nan] * 3])
    at = shape.vertices[[7, 0]]
    around = Surroundings.of(marks, at, shape.vertices, shape.vertices, 1.0)
    cloud = SurfaceLocator(shape.vertices, np.empty((0, 3), dtype=np.int64))
    nothing = np.zeros_like(shape.vertices)
    places, misfits = fit_surroundings(around, shape.vertices, shape.vertices, cloud, nothing, 1.0)
    np.testing.assert_allclose(places[0], shape.vertices[7], atol=1e-9)
    assert np.isfinite(misfits).all()


def test_a_shaft_does_not_hold_a_landmark_and_its_ends_do():
    """Wherever the shaft lies: a landmark slides along it, and around it."""
    directions, faces = sphere_mesh(3000)
    x, y, z = directions.T
    shaft = np.column_stack([0.2 * x, 0.2 * y, 1.5 * z])
    for end in ([0.7, 0.0, 0.7], [-0.6, 0.4, -0.7]):
        bump = np.exp(-((directions - np.array(end) / np.linalg.norm(end)) ** 2).sum(axis=1) / 0.05)
        shaft += 0.4 * bump[:, None] * directions
    rows = [int(np.argmax(directions @ one)) for one in ([0.7, 0, 0.7], [-0.6, 0.4, -0.7])]
    rows += [int(np.argmin(np.abs(z) + np.abs(x - 0.9))), int(np.argmin(np.abs(z - 0.1)))]
    found, held = holds(shaft[rows], shaft, faces, 1.0)
    assert found[:2].min() > 10 * found[2:].max()
    moved = shaft @ Rotation.from_euler("xyz", [0.5, 0.2, 2.0]).as_matrix().T * 3.0 + 2.0
    np.testing.assert_allclose(holds(moved[rows], moved, faces, 3.0)[0], found, rtol=1e-6)
    values, axes = np.linalg.eigh(held)
    assert abs(axes[3, 2, 0]) > 0.95, "along the shaft it is held least"
    outwards = shaft[rows[3]] * [1, 1, 0] / np.linalg.norm(shaft[rows[3], :2])
    assert abs(outwards @ axes[3, :, 2]) > 0.95, "and along the normal most"
    assert values[3, 2] > 5 * values[3, 0]
