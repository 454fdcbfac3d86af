"""Walls inside a surface are found, whatever their openings and normals, and recesses are none."""

import numpy as np
import pytest
import trimesh

from data_tools.datasets.synthetic_shapes import blob, sphere_mesh
from data_tools.notes import Note
from data_tools.options import AS_STORED, CleaningOptions
from data_tools.surface.hidden import (
    WALLS,
    WALLS_LEFT_OUT,
    as_seen,
    differ_in_walls,
    inner_walls,
    wall_share,
)
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges, is_open_surface
from tests.notes import codes, only

DROP = CleaningOptions(inner="drop")


def hollow(shape, opening, thickness):
    """Return the shape with a second wall inside, joined to the first one around an opening of some radius."""
    points, faces, num = shape.vertices, shape.faces, len(shape.vertices)
    normals = trimesh.Trimesh(points, faces, process=False).vertex_normals
    top = points[np.argmax(points[:, 2])]
    stays = np.linalg.norm(points - top, axis=1) >= opening
    kept = faces[stays[faces].all(axis=1)]
    directed = {
        (a, b) for face in kept.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)
    }
    rim = [(a, b) if (a, b) in directed else (b, a) for a, b in boundary_edges(kept).tolist()]
    bridge = [corner for a, b in rim for corner in ((b, a, a + num), (b, a + num, b + num))]
    every = np.concatenate([kept, kept[:, ::-1] + num, np.array(bridge, dtype=int).reshape(-1, 3)])
    used, places = np.unique(every, return_inverse=True)
    both = np.concatenate([points, points - thickness * normals])
    return Shape.from_arrays(both[used], places.reshape(-1, 3))


@pytest.fixture(scope="module")
def body():
    return blob(np.random.default_rng(3), num_vertices=900)


@pytest.mark.parametrize("opening", [0.0, 0.2, 0.4])
def test_a_wall_inside_is_left_out_and_its_opening_closed(body, opening):
    shape = hollow(body, opening, 0.08)
    share = wall_share(shape, inner_walls(shape))
    assert 0.35 < share < 0.5
    seen = as_seen(shape, DROP)
    assert only(seen.notes, WALLS_LEFT_OUT).values["share"] == share
    assert len(boundary_edges(seen.faces)) <= 8
    assert not is_open_surface(seen.vertices, seen.faces)
    assert seen.area == pytest.approx(body.area, rel=0.06)
    np.testing.assert_array_equal(shape.vertices[seen.source_indices], seen.vertices)
    assert as_seen(seen, DROP) is seen


def test_bowls_and_folds_are_no_walls():
    """A deep bowl with a wide mouth hides little, and its inside is joined at a long rim."""
    sphere, faces = sphere_mesh(900)
    bowl = hollow(Shape.from_arrays(sphere, faces), 0.9, 0.1)
    assert not inner_walls(bowl).any()


def test_walls_are_named_and_stay_unless_they_are_to_go(body):
    shape = hollow(body, 0.2, 0.08)
    named = as_seen(shape, CleaningOptions())
    assert codes(named.notes) == [WALLS]
    np.testing.assert_array_equal(named.faces, shape.faces)
    assert as_seen(shape, CleaningOptions(inner="keep")) is shape
    assert as_seen(shape, CleaningOptions().again) is shape
    assert DROP.again == DROP
    assert as_seen(shape, AS_STORED) is shape


def test_shapes_differ_where_some_have_walls_and_others_none():
    much, little = (
        (Note(WALLS, values={"share": 0.4}),),
        (Note(WALLS, values={"share": 0.05}),),
    )
    assert differ_in_walls([much, ()], [True, True])
    assert not differ_in_walls([much, much], [True, True])
    assert not differ_in_walls([much, little], [True, True])
    assert not differ_in_walls([little, ()], [True, True])
    assert not differ_in_walls([much, ()], [True, False])
