"""Dense points of surfaces, and which are nearest to each other at a pose."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import crown
from data_tools.errors import InputError
from data_tools.poses import Similarity
from data_tools.surface.shape import outward_normals
from pairwise.dense import DenseMatcher, DensePoints


def some_shape(num=300):
    shape = crown(np.random.default_rng(0), num_vertices=num)
    return shape.vertices, outward_normals(shape)


def test_bad_input_is_refused():
    points, _ = some_shape(100)
    with pytest.raises(InputError, match="one place"):
        DensePoints.from_user(np.ones((5, 3)))
    with pytest.raises(InputError, match="normals"):
        DensePoints.from_user(points, points[:5])


def test_the_spacing_is_that_of_places():
    square = np.array([[0.0, 0.0], [0.0, 2.0], [2.0, 0.0], [2.0, 2.0]])
    for points in (square, np.concatenate([square, square])):
        assert DensePoints.from_user(points).spacing == pytest.approx(2.0)


def test_nearest_neighbours_in_slabs_are_those_of_trees_wherever_the_source_moves(rng, monkeypatch):
    points, normals = some_shape()
    source = DensePoints.from_user(rng.permutation(points)[:200])
    matcher = DenseMatcher(DensePoints.from_user(points, normals), source)
    monkeypatch.setattr("pairwise.dense._CHUNK_ENTRIES", 7_000)
    for turn in Rotation.from_rotvec(
        np.outer([3.0, 0.1, 0.11, 0.111, 0.5, 0.5], [0.6, 0.0, 0.8])
    ).as_matrix():
        pose = Similarity(rotation=turn, scale=1.1, shift=0.1 * turn[0])
        of_target, of_source = matcher.pair_up(pose)
        np.testing.assert_array_equal(
            of_target[:200], cKDTree(points).query(pose.apply(source.points))[1]
        )
        np.testing.assert_array_equal(
            of_source[200:], cKDTree(pose.apply(source.points)).query(points)[1]
        )
