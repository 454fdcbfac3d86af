"""Vertices whose counterpart was cut away have none; all others go where they belong."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.tools.match.every_vertex import vertex_maps
from data_tools.datasets.synthetic_shapes import figure
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape

#: How much larger the cut copy is.
SCALE = 1.7
SMALL = SurfaceOptions(num_functions=45, num_samples=60, num_dense=300)


def without(shape, gone):
    """Return a mesh without some of its vertices, and which are left."""
    faces = shape.faces[~gone[shape.faces].any(axis=1)]
    kept = np.unique(faces)
    return Shape.from_arrays(shape.vertices[kept], np.searchsorted(kept, faces)), kept


def true_candidate(target, source, rotation, scale=1.0):
    """Return the true map of samples as far as there is one, by nearest places, for a source that is rotated."""
    places = source.vertices[source.dense] @ rotation / scale
    on_target = target.vertices[target.dense]
    found = FunctionalMap(
        C_source_target=np.eye(len(target.eigenvalues) + 1),
        map_target_source=cKDTree(on_target).query(places)[1],
        map_source_target=cKDTree(places).query(on_target)[1],
    )
    return SimpleNamespace(functional_map=found, evidence=SimpleNamespace(orientation=1.0))


@pytest.fixture(scope="module")
def cut():
    """A whole figure and a rotated one that lacks what is farthest out, and the vertices that are left of that."""
    whole, rotation = figure(), random_rotation(np.random.default_rng(5))
    outwards = whole.vertices[:, 0]
    gone = outwards > np.quantile(outwards, 0.8)
    part, kept = without(replace(whole, vertices=SCALE * whole.vertices @ rotation.T), gone)
    return prepare_surface(whole, SMALL), prepare_surface(part, SMALL), kept, rotation


def test_what_was_cut_away_has_no_counterpart_whichever_is_the_target(cut):
    whole, part, kept, rotation = cut
    lost = np.ones(len(whole.to_working), dtype=bool)
    lost[kept] = False
    chosen = true_candidate(whole, part, rotation, SCALE)
    of_part, of_whole = vertex_maps(whole, part, chosen)
    assert (of_part >= 0).all()
    assert (of_whole[lost] < 0).mean() > 0.95
    assert (of_whole[~lost] < 0).mean() < 0.02
    spacing = np.sqrt(whole.area / len(whole.vertices))
    off = np.linalg.norm(whole.points[of_part] - whole.points[kept], axis=1)
    assert np.quantile(off, 0.9) < 2.0 * spacing
    swapped = replace(
        chosen.functional_map,
        map_target_source=chosen.functional_map.map_source_target,
        map_source_target=chosen.functional_map.map_target_source,
    )
    again = vertex_maps(
        part, whole, SimpleNamespace(functional_map=swapped, evidence=chosen.evidence)
    )
    np.testing.assert_array_equal(again[0], of_whole)
    np.testing.assert_array_equal(again[1], of_part)


def test_whole_surfaces_and_small_holes_leave_nobody_without_a_counterpart(cut):
    whole, turn = cut[0], np.eye(3)
    pierced = prepare_surface(Shape.from_arrays(figure().vertices, figure().faces[1:]), SMALL)
    for other in (whole, pierced):
        there, back = vertex_maps(whole, other, true_candidate(whole, other, turn))
        assert (there >= 0).all()
        assert (back >= 0).all()
