"""Maps between files become maps between shapes whose unused vertices were dropped."""

from dataclasses import replace

import numpy as np

from collalign.tools.match.pictures import vertices_map
from data_tools.surface.shape import Shape


def shape_without(dropped, num):
    """Return a shape that kept the vertices of a file of ``num`` that are not dropped."""
    kept = np.setdiff1d(np.arange(num), dropped)
    shape = Shape.from_arrays(np.random.default_rng(0).random((len(kept), 3)))
    return replace(shape, source_indices=kept)


def test_dropped_vertices_are_renumbered():
    target, source = shape_without([1], 4), shape_without([0], 3)
    point_map = np.array([-1, 3, 0])
    assert vertices_map(point_map, target, source).tolist() == [2, 0]
    assert vertices_map(np.array([0, 1, -1]), target, source).tolist() == [-1, -1]
