"""Normals point outwards whatever the winding, turn with the shape, and are absent where sides disagree."""

import numpy as np

from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape, orientation_defects, outward_normals
from data_tools.synthetic_shapes import sphere_mesh


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


def test_normals_turn_and_mirror_with_the_shape(rng):
    shape = sphere()
    for turn in (random_rotation(rng), -np.eye(3)):
        moved = Shape.from_arrays(shape.vertices @ turn.T, shape.faces)
        assert np.allclose(outward_normals(moved), outward_normals(shape) @ turn.T)


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
