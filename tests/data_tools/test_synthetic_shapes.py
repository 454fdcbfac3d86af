from collections import Counter

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import (
    blob,
    chair,
    crown,
    figure,
    sphere_mesh,
)
from data_tools.surface.topology import (
    boundary_edges,
    is_open_surface,
    mesh_edges,
    vertex_components,
)


def is_closed_manifold(faces):
    """Whether every edge is in exactly two triangles that run through it in opposite directions."""
    directed = Counter(
        zip(faces.ravel().tolist(), np.roll(faces, -1, axis=1).ravel().tolist(), strict=True)
    )
    return max(directed.values()) == 1 and all(edge[::-1] in directed for edge in directed)


def volume(shape):
    a, b, c = (shape.vertices[shape.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("make", [blob, chair])
def test_solid_shapes_are_closed_oriented_and_in_one_piece(make, rng):
    shape = make(rng)
    assert is_closed_manifold(shape.faces)
    assert volume(shape) > 0
    assert vertex_components(len(shape.vertices), [mesh_edges(shape.faces)])[0] == 1
    assert 900 < len(shape.vertices) < 2500


def test_figure_is_closed_and_refines():
    assert is_closed_manifold(figure().faces)
    assert len(figure(resolution=4).vertices) > 3 * len(figure().vertices)


def test_manifold_check_refuses():
    _, faces = sphere_mesh(50)
    assert is_closed_manifold(faces)
    assert not is_closed_manifold(faces[1:])
    flipped = faces.copy()
    flipped[0] = flipped[0][::-1]
    assert not is_closed_manifold(flipped)


def test_crown_is_open_with_one_rim():
    shape = crown(num_vertices=800)
    assert abs(len(shape.vertices) - 800) < 40
    assert is_open_surface(shape.vertices, shape.faces)
    rim = boundary_edges(shape.faces)
    _, labels = vertex_components(len(shape.vertices), [rim])
    assert len(set(labels[np.unique(rim)])) == 1
    np.testing.assert_array_equal(crown(num_vertices=800).vertices, shape.vertices)
    varied = crown(np.random.default_rng(1), num_vertices=800)
    assert np.abs(varied.vertices - shape.vertices).max() > 0.02
