"""Depth images are told from models that are open and of few vertices."""

import numpy as np
from scipy.spatial import Delaunay

from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import SamplingOptions
from data_tools.sight import lines_that_saw
from data_tools.surface.shape import Shape


def sheets():
    """Return a sheet, and two, one behind the other, whose triangles face one way or two."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 2, 21), np.linspace(0, 1, 11)))
    front = np.stack([x, y, 0.2 * np.sin(2 * x)], axis=1)
    faces = Delaunay(front[:, :2]).simplices
    both = np.concatenate([front, front - [0, 0, 0.1]])
    one_side = np.concatenate([faces, faces + len(front)])
    two_sides = np.concatenate([faces, faces[:, ::-1] + len(front)])
    return front, faces, both, one_side, two_sides


def test_a_mesh_that_faces_two_ways_was_seen_from_no_direction():
    front, faces, both, one_side, two_sides = sheets()
    assert len(lines_that_saw(Shape.from_arrays(front, faces)))
    assert len(lines_that_saw(Shape.from_arrays(both, one_side)))
    assert not len(lines_that_saw(Shape.from_arrays(both, two_sides)))
    unknown = np.concatenate([two_sides, faces])  # triangles that lie on others the wrong way round
    assert len(lines_that_saw(Shape.from_arrays(both, unknown)))


def test_an_open_model_of_two_sides_is_joined_and_an_image_is_not():
    _, _, both, one_side, two_sides = sheets()
    for triangles, is_model in ((one_side, False), (two_sides, True)):
        mesh = Shape.from_arrays(both, triangles)
        assert WorkingSurface(mesh, SamplingOptions(), joined=True).is_joined == is_model
