import numpy as np

from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.surface.topology import (
    boundary_edges,
    counted_edges,
    is_open_surface,
    mesh_edges,
    spread_over_faces,
    vertex_components,
)

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_boundary_and_crowded_edges_are_seen():
    assert len(boundary_edges(TETRAHEDRON[:3])) == 3
    assert counted_edges(np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))[1].max() == 3


def test_points_are_spread_over_triangles_by_area():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0]])
    points, at = spread_over_faces(corners, np.array([[0, 1, 2], [1, 3, 2]]), 3000)
    assert np.bincount(at).tolist() == [1000, 2000]
    first, second = points[at == 0], points[at == 1]
    assert first.min() >= 0
    assert max(first.sum(axis=1).max(), (second @ [1, 3, 0]).max() / 3) <= 1
    assert (second @ [1, 1, 0]).min() >= 1
    np.testing.assert_allclose(first.mean(axis=0), [1 / 3, 1 / 3, 0], atol=0.01)
    np.testing.assert_allclose(second.mean(axis=0), [4 / 3, 1 / 3, 0], atol=0.02)


def test_components():
    _, faces = sphere_mesh(30)
    num, labels = vertex_components(61, [mesh_edges(np.concatenate([faces, faces + 30]))])
    assert num == 3
    assert len(set(labels[:30])) == len(set(labels[30:60])) == 1


def test_a_hole_does_not_open_a_closed_surface_but_a_rim_does():
    vertices, faces = sphere_mesh(1000)
    assert not is_open_surface(vertices, faces)
    assert not is_open_surface(vertices, faces[5:])
    assert len(boundary_edges(faces[5:])) > 0
    shape = crown()
    assert is_open_surface(shape.vertices, shape.faces)
    assert not is_open_surface(vertices, np.empty((0, 3), dtype=np.int64))


def test_edges_of_any_triangles_are_those_of_a_count_by_hand():
    faces = np.random.default_rng(0).permuted(np.tile(np.arange(9), (40, 1)), axis=1)[:, :3]
    forward = {}
    for a, b in [(int(f[i]), int(f[(i + 1) % 3])) for f in faces for i in range(3)]:
        forward.setdefault((min(a, b), max(a, b)), []).append(a)
    edges, num_faces = counted_edges(faces)
    assert edges.tolist() == [list(edge) for edge in sorted(forward)]
    assert num_faces.tolist() == [len(forward[edge]) for edge in sorted(forward)]
    assert len(mesh_edges(np.empty((0, 3), dtype=np.int64))) == 0
