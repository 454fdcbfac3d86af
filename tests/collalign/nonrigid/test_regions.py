"""The region that a cut body is of another one is among the likeliest, and its maps are maps of the whole."""

from types import SimpleNamespace

import numpy as np
import pytest

from collalign.nonrigid import ranked, regions
from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.regions import (
    LEAST_SHARE,
    NUM_REGIONS,
    SAME_SHARE,
    _Signature,
    is_cut,
    likely_regions,
    region_of,
    region_options,
)
from collalign.nonrigid.spectral_shape import prepare_surface
from data_tools.errors import InputError
from data_tools.surface.shape import Shape
from experiments.generated.bipeds import KINDS, biped
from experiments.generated.cut_bipeds import cut_biped

OPTIONS = SurfaceOptions(num_functions=40, num_dense=300, num_samples=40)


@pytest.fixture(scope="module")
def bodies():
    """A person, the lower body of a child, both prepared, and the regions proposed."""
    whole = biped(KINDS["person"], np.random.default_rng(11))
    cut = cut_biped(biped(KINDS["child"], np.random.default_rng(12)), "lower body")
    surfaces = prepare_surface(whole.shape, OPTIONS), prepare_surface(cut.shape, OPTIONS)
    regions = [region_of(surfaces[0], one, OPTIONS) for one in likely_regions(*surfaces)]
    return whole, cut, *surfaces, [one for one in regions if one is not None]


def covered(whole, region):
    inside = np.zeros(len(whole.vertices), dtype=bool)
    inside[region.at] = True
    return inside


def common(whole, first, second):
    return whole.mass[first & second].sum() / whole.mass[first | second].sum()


def test_the_right_region_is_among_the_likeliest_and_all_are_distinct(bodies):
    body, cut, whole, _, regions = bodies
    true = (cut.places[body.to_template] >= 0)[whole.to_original]
    inside = [covered(whole, one) for one in regions]
    assert 1 < len(regions) <= NUM_REGIONS
    assert max(common(whole, one, true) for one in inside) > 0.85
    assert min(common(whole, one, true) for one in inside) < 0.7
    for number, one in enumerate(inside):
        assert whole.mass[one].sum() > 0.5 * LEAST_SHARE
        assert all(common(whole, one, other) < SAME_SHARE + 0.05 for other in inside[:number])


def test_a_region_is_a_surface_of_the_same_places_with_as_many_functions(bodies):
    whole, regions = bodies[2], bodies[4]
    for region in regions:
        np.testing.assert_array_equal(whole.vertices[region.at], region.surface.vertices)
        assert is_cut(region.surface)
        assert len(region.surface.eigenvalues) == len(whole.eigenvalues)
        assert len(region.surface.samples) == len(whole.samples)
    assert not is_cut(whole)


@pytest.mark.parametrize("is_target", [True, False])
def test_a_map_of_a_region_is_that_map_of_the_whole(bodies, is_target):
    whole, region = bodies[2], bodies[4][0]
    own, other = region.surface, region.surface
    every = np.arange(len(own.dense))
    same = FunctionalMap(
        C_source_target=np.eye(41), map_target_source=every, map_source_target=every
    )
    found = region.on_whole(same, whole, other, is_target=is_target)
    images, back = found.map_target_source, found.map_source_target
    carry = found.C_source_target
    if not is_target:
        images, back, carry = back, images, carry.T
    spacing = np.sqrt(whole.area / len(whole.dense))
    off = whole.vertices[whole.dense[images]] - own.vertices[own.dense]
    assert np.linalg.norm(off, axis=1).max() < 2.0 * spacing
    inside = covered(whole, region)[whole.dense]
    off = own.vertices[own.dense[back]] - whole.vertices[whole.dense]
    assert np.linalg.norm(off[inside], axis=1).max() < 2.0 * spacing
    assert np.linalg.norm(off[~inside], axis=1).max() > 2.0 * spacing
    low = other.basis[other.dense] @ carry[:, 1:5]
    off = low - whole.basis[whole.dense[images], 1:5]
    assert np.sqrt((off**2).mean()) < 0.2


def test_regions_of_which_no_map_can_be_made_are_left_out(bodies, monkeypatch):
    whole, cut = bodies[2:4]
    nothing = np.zeros(len(whole.vertices), dtype=bool)
    few = whole.agd >= np.quantile(whole.agd, 0.99)
    assert region_of(whole, nothing, OPTIONS) is None
    assert region_of(whole, few, OPTIONS) is None
    kept = likely_regions(whole, cut)[0]
    looks = region_options(whole, is_screened=True)
    small = region_of(whole, kept, looks)
    assert len(small.surface.eigenvalues) == looks.num_functions <= len(whole.eigenvalues)

    def refuse(shape, options):
        raise InputError("a strange crop")

    monkeypatch.setattr(regions, "prepare_surface", refuse)
    assert region_of(whole, kept, OPTIONS) is None
    found = ranked.ranked_maps(whole, cut, NonrigidOptions())
    assert {len(one.functional_map.map_target_source) for one in found} == {len(cut.dense)}
    monkeypatch.setattr(regions, "surface_operators", refuse_operators)
    assert likely_regions(whole, cut) == []


def test_what_is_opposite_to_a_cut_surface_is_cropped(bodies, monkeypatch):
    whole, cut = bodies[2:4]
    other = prepare_surface(cut_biped(bodies[0], "upper body").shape, OPTIONS)
    cropped = []

    def record(one, opposite):
        cropped.append(one)
        return []

    monkeypatch.setattr(ranked, "likely_regions", record)
    ranked.ranked_maps(cut, whole, NonrigidOptions())
    assert cropped == [whole]
    ranked.ranked_maps(cut, other, NonrigidOptions())
    assert cropped[1:] == [cut, other]


def refuse_operators(shape):
    raise InputError("too poor")


def test_surfaces_that_end_elsewhere_differ_and_copies_do_not(rng):
    body = biped(KINDS["person"], rng)
    upper, lower = (cut_biped(body, cut).shape for cut in ("upper body", "lower body"))
    first, second = (_Signature.of(one.vertices, one.faces) for one in (upper, lower))
    larger = _Signature.of(3.0 * upper.vertices, upper.faces)
    assert first.gap(larger) < 1e-6
    assert first.gap(second) > 0.1


def test_a_surface_without_tips_has_no_regions(bodies):
    body, cut = bodies[0], bodies[3]
    assert likely_regions(prepare_surface(_ball(), OPTIONS), cut) == []
    cloud = Shape.from_arrays(body.shape.vertices, name="cloud")
    assert likely_regions(prepare_surface(cloud, OPTIONS), cut) == []


def _ball():
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=3)
    return Shape.from_arrays(np.array(mesh.vertices), np.array(mesh.faces), name="ball")


def test_a_lower_body_is_mapped_to_the_lower_body(bodies):
    body, cut, whole, part, _ = bodies
    found = ranked.ranked_maps(whole, part, NonrigidOptions())
    truth = body.places[cut.to_template][part.to_original[part.dense]]
    images = whole.vertices[whole.dense[found[0].functional_map.map_target_source]]
    off = np.linalg.norm(images - body.shape.vertices[truth], axis=1) / whole.area**0.5
    assert off.mean() < 0.1
    assert len({one.evidence.score for one in found}) == len(found)


@pytest.mark.parametrize(
    ("which", "trust", "is_asked"),
    [((0, 1), 0.3, True), ((1, 0), 0.3, True), ((0, 1), 0.99, False), ((0, 0), 0.3, False)],
)
def test_regions_are_asked_where_one_surface_is_cut_and_the_map_in_doubt(
    bodies, monkeypatch, which, trust, is_asked
):
    asked = []
    monkeypatch.setattr(ranked, "_maps_of_whole", lambda *_: [])
    monkeypatch.setattr(ranked, "screened_from_within", lambda *_: [SimpleNamespace(score=0.0)])
    monkeypatch.setattr(ranked, "whole_trust", lambda *_: trust)
    monkeypatch.setattr(ranked, "chosen_first", lambda _target, found, _options: found)
    monkeypatch.setattr(ranked, "likely_regions", lambda *pair: asked.append(pair) or [])
    pair = [bodies[2:4][i] for i in which]
    assert ranked.ranked_maps(*pair, NonrigidOptions()) == []
    assert asked == ([bodies[2:4]] if is_asked else [])
