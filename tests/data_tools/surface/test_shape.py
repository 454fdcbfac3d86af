"""Shapes hold what they are given, and their normals point outwards whatever the winding."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import InputError
from data_tools.surface.shape import Shape, orientation_defects, outward_normals


def test_clouds_have_no_area():
    cloud = Shape.from_arrays(np.eye(3))
    assert not cloud.is_mesh
    assert np.isnan(cloud.area)


def test_arrays_are_copies_and_read_only():
    vertices = np.eye(3)
    shape = Shape.from_arrays(vertices, [[0, 1, 2]])
    vertices[0, 0] = 7
    assert shape.vertices[0, 0] == 1
    assert not shape.vertices.flags.writeable
    assert not shape.faces.flags.writeable


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        (np.eye(3), [[0, 1, 99]], "faces: indices run from 0 to 99"),
        (np.eye(3), [[0, 1, -1]], "faces: indices run from -1"),
        (np.eye(3), [[0, 1]], "faces: expected shape"),
        (np.eye(3), [[0.5, 1, 2]], "faces: expected integer"),
        (np.full((3, 3), np.nan), None, "vertices: 9 of 9"),
        (np.eye(2), None, "vertices: expected shape"),
        (np.empty((0, 3)), None, "vertices: 0 points"),
    ],
)
def test_impossible_arrays_are_refused_by_name(vertices, faces, reason):
    with pytest.raises(InputError, match=f"thing: {reason}"):
        Shape.from_arrays(vertices, faces, name="thing")


def sphere():
    vertices, faces = sphere_mesh(300)
    return Shape.from_arrays(vertices + np.array([3.0, 0.0, 1.0]), faces)


def test_normals_of_a_sphere_are_its_radii_even_inside_out():
    shape = sphere()
    radii = shape.vertices - shape.vertices.mean(axis=0)
    radii /= np.linalg.norm(radii, axis=1, keepdims=True)
    for faces in (shape.faces, shape.faces[:, ::-1]):
        normals = outward_normals(Shape.from_arrays(shape.vertices, faces))
        assert (normals * radii).sum(axis=1).min() > 0.98


def test_normals_of_some_vertices_are_those_of_all_to_the_bit():
    shape = sphere()
    some = np.array([17, 3, 250])
    for faces in (shape.faces, shape.faces[:, ::-1]):
        either = Shape.from_arrays(shape.vertices, faces)
        np.testing.assert_array_equal(
            outward_normals(either, at=some), outward_normals(either)[some]
        )


def test_one_turned_triangle_and_clouds_have_no_normals():
    shape = sphere()
    faces = shape.faces.copy()
    faces[0] = faces[0, ::-1]
    assert orientation_defects(shape) == 0
    assert orientation_defects(Shape.from_arrays(shape.vertices, faces)) > 0
    assert outward_normals(Shape.from_arrays(shape.vertices, faces)).shape == (0, 3)
    assert outward_normals(Shape.from_arrays(shape.vertices)).shape == (0, 3)
