"""Consistent maps of a collection: bases that synchronize functional maps, choice by cycles, and bent shapes."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import load
from collalign.align import align_collection
from collalign.nonrigid.common_bases import choose_maps, common_bases, map_residuals
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.output.vertex_maps import VERTEX_MAPS_FILE, load_vertex_maps
from collalign.stages.deformation import vertex_notes
from collalign.stages.deformation_jobs import trust_of_places
from data_tools.datasets.synthetic import bent, mirrored
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh
from data_tools.notes import Note
from data_tools.rotations import random_rotation
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape
from tests.notes import codes
from tests.products import vertex_maps_of

pytestmark = pytest.mark.usefixtures("quick_search")
NUM, SIZE = 6, 12
#: Which vertex of the blob is each vertex of its bent copies.
ORDERS = [np.random.default_rng(n).permutation(700) for n in range(3)]


def planted(rng, *, num_wrong=0):
    """Return all edges of a graph, maps that hidden bases make consistent, some replaced, and the bases."""
    bases = np.linalg.qr(rng.normal(size=(NUM, SIZE, SIZE)))[0]
    edges = np.array([(i, j) for i in range(NUM) for j in range(i + 1, NUM)])
    maps = bases[edges[:, 1]] @ np.swapaxes(bases[edges[:, 0]], 1, 2)
    wrong = rng.permutation(len(edges))[:num_wrong]
    maps[wrong] = np.linalg.qr(rng.normal(size=(num_wrong, SIZE, SIZE)))[0]
    return edges, maps, bases


def test_consistent_maps_are_recovered_up_to_one_gauge():
    edges, maps, bases = planted(np.random.default_rng(0))
    found, residuals = common_bases(edges, maps, NUM)
    gauge = bases[0].T @ found[0]
    assert np.allclose(found, bases @ gauge, atol=1e-6)
    assert residuals.max() < 1e-6


def test_a_fifth_of_wrong_maps_is_rejected_and_seen():
    rng = np.random.default_rng(1)
    edges, maps, bases = planted(rng, num_wrong=3)
    found, residuals = common_bases(edges, maps, NUM)
    truth = bases[edges[:, 1]] @ np.swapaxes(bases[edges[:, 0]], 1, 2)
    is_right = np.isclose(maps, truth).all(axis=(1, 2))
    assert is_right.sum() == len(edges) - 3
    assert residuals[is_right].max() < 0.1 < 0.8 < residuals[~is_right].min()
    assert map_residuals(edges, truth, found).max() < 0.1


def test_maps_that_do_not_connect_the_shapes_are_refused():
    edges, maps, _ = planted(np.random.default_rng(3))
    apart = (edges != 5).all(axis=1)
    with pytest.raises(ValueError, match="connect"):
        common_bases(edges[apart], maps[apart], NUM)


def test_cycles_choose_a_map_that_its_own_evidence_places_second_but_not_against_all_odds():
    rng = np.random.default_rng(4)
    edges, maps, _ = planted(rng)
    others = np.linalg.qr(rng.normal(size=(len(edges), SIZE, SIZE)))[0]
    candidates = [np.stack([right, wrong]) for right, wrong in zip(maps, others, strict=True)]
    odds = [np.array([0.0, -2.0]) for _ in edges]
    odds[4] = np.array([0.0, 1.0])
    choice, _, residuals = choose_maps(edges, candidates, odds, NUM)
    assert (choice == 0).all()
    assert residuals.max() < 1e-3
    odds[4] = np.array([0.0, 100.0])
    assert choose_maps(edges, candidates, odds, NUM)[0][4] == 1


def bent_blobs(folder, num):
    """Write one blob bent in several ways, in random poses, the last mirrored, vertices in :data:`ORDERS`."""
    rng = np.random.default_rng(5)
    body = blob(np.random.default_rng(8), num_vertices=len(ORDERS[0]))
    shapes = []
    for n in range(num):
        shape = bent(body, rng, angle=0.5)
        vertices = shape.vertices[ORDERS[n]] @ random_rotation(rng).T
        posed = Shape.from_arrays(vertices, np.argsort(ORDERS[n])[shape.faces], name=f"f{n}")
        posed = mirrored(posed) if n == num - 1 else posed
        write_mesh(folder / f"f{n}.ply", posed)
        shapes.append(posed)
    return shapes


@pytest.fixture(scope="module")
def deformed(tmp_path_factory):
    root = tmp_path_factory.mktemp("deformed")
    folder = root / "shapes"
    folder.mkdir()
    shapes = bent_blobs(folder, 3)
    aligned = align_collection(folder, deformable=True, group="O", jobs=1, progress=False)
    aligned.save(root / "out", report=False)
    return shapes, aligned, root / "out"


def worst_share(maps, shapes, *, within):
    """Return the least share of vertices, over the pairs, that land within a part of the size of their own place."""
    shares = []
    for a, first in enumerate(shapes):
        size = np.ptp(first.vertices, axis=0).max()
        for b in range(len(shapes)):
            found = maps[f"f{a}", f"f{b}"]
            truth = np.argsort(ORDERS[a])[ORDERS[b]]
            gaps = np.linalg.norm(first.vertices[found] - first.vertices[truth], axis=1)
            shares.append(float((gaps <= within * size).mean()))
    return min(shares)


def test_maps_of_bent_blobs_find_every_vertex(deformed):
    shapes, aligned, _ = deformed
    maps = aligned.made.vertices
    assert maps is not None
    assert maps.names == ("f0", "f1", "f2")
    assert not maps.left_out
    assert worst_share(maps, shapes, within=0.2) > 0.9
    backwards = replace(maps, places=tuple(own[:: (-1) ** n] for n, own in enumerate(maps.places)))
    assert worst_share(backwards, shapes, within=0.2) < 0.5


def test_right_places_are_trusted_and_those_of_the_other_side_are_not(deformed):
    shapes, aligned, _ = deformed
    maps = aligned.made.vertices
    assert maps.confidence.min() > 0.5
    at = maps.names.index(maps.reference)
    small = SurfaceOptions(num_functions=60, num_dense=300)
    target, source = (prepare_surface(shapes[i], small) for i in (at, at - 1))
    right, other = maps.places[at - 1], 2 * maps.places[at - 1].mean(axis=0) - maps.places[at - 1]
    wrong = (
        SurfaceLocator(shapes[at].vertices, shapes[at].faces).closest(other).on(shapes[at].vertices)
    )
    stated = [
        trust_of_places(target, source, places[source.to_original[source.dense]])
        for places in (right, wrong)
    ]
    assert stated[0][0] > 0.5 > 0.2 > stated[1][0]
    assert np.median(stated[0][1]) > 0.8 > 0.5 > np.median(stated[1][1])


def test_vertices_without_a_place_have_no_map_and_get_none_to_them():
    rng = np.random.default_rng(9)
    first, nowhere = rng.random((5, 3)), np.full((1, 3), np.nan)
    second = np.vstack([nowhere, first[::-1] + 1e-3])
    places = (first, second, np.tile(nowhere, (2, 1)))
    maps = vertex_maps_of("abc", places)
    np.testing.assert_array_equal(maps["a", "b"], [-1, 4, 3, 2, 1, 0])
    np.testing.assert_array_equal(maps["b", "a"], [5, 4, 3, 2, 1])
    assert (maps["c", "a"] == -1).all()


def test_maps_survive_saving(deformed):
    _, aligned, out = deformed
    maps, again = aligned.made.vertices, load(out).vertex_maps
    assert (again["f1", "f2"] == maps["f1", "f2"]).all()
    assert again.reference == maps.reference
    np.testing.assert_array_equal(again.confidence, maps.confidence)
    np.testing.assert_allclose(
        np.concatenate(again.vertex_confidence), np.concatenate(maps.vertex_confidence), 1e-6
    )
    with pytest.raises(InputError, match="no maps of 'g'"):
        again["g", "f0"]


def test_a_result_without_maps_and_a_damaged_file_say_so(deformed, tmp_path):
    with pytest.raises(InputError, match="--deformable"):
        load_vertex_maps(tmp_path)
    data = dict(np.load(deformed[2] / VERTEX_MAPS_FILE))
    np.savez(tmp_path / VERTEX_MAPS_FILE, **data | {"places": data["places"][:, :2]})
    with pytest.raises(InputError, match="not maps of vertices"):
        load_vertex_maps(tmp_path)


def test_point_clouds_have_no_maps_of_vertices():
    points = np.random.default_rng(6).random((80, 3))
    aligned = align_collection([points, points[::-1]], deformable=True, jobs=1, progress=False)
    assert aligned.made.vertices is None
    assert "no-vertex-maps" in codes(aligned.notes)


def test_shapes_whose_maps_are_in_doubt_are_named():
    confidence = np.array([1.0, 0.7, 0.31])
    maps = vertex_maps_of(
        "abc", [np.zeros((1, 3))] * 3, confidence=confidence, left_out=(("d", "too small"),)
    )
    notes = vertex_notes(maps)
    assert notes == (
        Note("vertex-maps-missing", ("d",), {"reason": "too small"}),
        Note("vertex-maps-doubtful", ("c",), {"confidences": (0.31,)}),
    )
    assert not vertex_notes(replace(maps, confidence=np.ones(3), left_out=()))
