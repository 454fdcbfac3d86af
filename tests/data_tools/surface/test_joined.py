"""The surface around components is closed, lies close to all of them, and leaves out what lies within."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.rotations import random_rotation
from data_tools.surface.joined import _points_on, cell_size, joined_surface
from data_tools.surface.shape import Shape, orientation_defects
from data_tools.surface.topology import boundary_edges, mesh_components

BOX = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
BOX_FACES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)


def boxes(*placed):
    """Return boxes, each given by its size and its lowest corner, as one mesh."""
    vertices = np.concatenate([BOX * size + np.array(corner) for size, corner in placed])
    faces = np.concatenate([BOX_FACES + 8 * i for i in range(len(placed))])
    return Shape.from_arrays(vertices, faces)


def volume(mesh):
    return np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6.0


def num_components(mesh):
    return mesh_components(len(mesh.vertices), mesh.faces)[0]


@pytest.mark.parametrize("seed", range(3))
def test_boxes_that_touch_become_one_closed_surface(seed):
    turn = random_rotation(np.random.default_rng(seed))
    table = boxes(((4, 3, 0.1), (0, 0, 2)), *(((0.1, 0.1, 2), (x, 1, 0)) for x in (0, 3.9)))
    table = Shape.from_arrays(table.vertices @ turn.T, table.faces)
    found = joined_surface(table)
    assert num_components(found) == 1
    assert len(boundary_edges(found.faces)) == 0
    assert orientation_defects(found) == 0.0
    assert volume(found) > 0.0
    cell = cell_size(table)
    far = cKDTree(found.vertices).query(_points_on(table.vertices[table.faces], cell))[0]
    assert far.max() < 2.5 * cell


@pytest.mark.parametrize(("gap", "num"), [(1.0, 1), (8.0, 2)])
def test_gaps_of_a_cell_are_closed_and_wide_ones_stay(gap, num):
    cell = cell_size(boxes((1, (0, 0, 0)), (1, (1.05, 0, 0))))
    assert num_components(joined_surface(boxes((1, (0, 0, 0)), (1, (1 + gap * cell, 0, 0))))) == num
