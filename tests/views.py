"""Depth images of a blob as surfaces: what a camera sees of it, where it lies or moved."""

import numpy as np

from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape

WHOLE = blob(np.random.default_rng(1), num_vertices=1500)
#: The pose of a view that was moved on one that was not.
TURN, SHIFT = random_rotation(np.random.default_rng(9)), np.array([2.0, -1.0, 0.5])


def view_from(sight, *, moved=False, cell_radii=0.08):
    """Return what is seen from a direction, of cells of so many radii."""
    points = range_view(WHOLE, np.array(sight), noise=0.003, rng=np.random.default_rng(0))
    points = (points - SHIFT) @ TURN if moved else points
    cell = cell_radii * centre_and_radius(WHOLE)[1]
    return surface_cells(Shape.from_arrays(points, name="view"), cell)
