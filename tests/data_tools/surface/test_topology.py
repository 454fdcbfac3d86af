import numpy as np

from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.surface.topology import (
    boundary_edges,
    counted_edges,
    is_open_surface,
    mesh_edges,
)


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
