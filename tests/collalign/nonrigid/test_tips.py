"""Ends of limbs are found in any posture, matched by distances, and start maps that keep front and back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.map_evidence import limb_gap
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.map_starts import tip_starts
from collalign.nonrigid.portfolio import (
    FROM_POSES,
    FROM_TIPS,
    SURE_FROM_WITHIN,
    find_candidates,
    likeliest,
    screened_from_within,
    whole_trust,
)
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.nonrigid.tips import MAX_TIPS, Tips, _persistence, edge_net, tip_matches
from experiments.generated.bipeds import KINDS, biped, template_points

OPTIONS = SurfaceOptions(num_functions=40, num_dense=400, num_samples=40)


@pytest.fixture(scope="module")
def bodies():
    """A person and an ape in other postures, and both prepared."""
    generated = [
        biped(KINDS[kind], np.random.default_rng(seed))
        for seed, kind in enumerate(("person", "ape"))
    ]
    return generated, [prepare_surface(one.shape, OPTIONS) for one in generated]


def ends_of_template():
    """Head, hands and feet of the template, left ones first."""
    points = template_points()
    places = [(0, 0, 1.75), (0, 0.9, 1.43), (0, -0.9, 1.43), (0.2, 0.12, 0), (0.2, -0.12, 0)]
    return cKDTree(points).query(places)[1]


def map_of(bodies, *, turn):
    """The map of the samples of the second body to the first that a turn of the template (3, 3) asks for."""
    (to, of), (target, source) = bodies
    points = template_points()
    turned = cKDTree(points).query(points @ turn)[1]
    there = cKDTree(target.vertices[target.dense]).query(
        to.shape.vertices[to.places[turned[of.to_template[source.to_original[source.dense]]]]]
    )[1]
    back = cKDTree(source.vertices[source.dense]).query(
        of.shape.vertices[of.places[turned[to.to_template[target.to_original[target.dense]]]]]
    )[1]
    return FunctionalMap(C_source_target=np.eye(2), map_target_source=there, map_source_target=back)


def test_tips_are_the_ends_of_limbs_in_any_posture(bodies):
    for body, surface in zip(*bodies, strict=True):
        ends = surface.vertices[surface.tips.vertices] / surface.area**0.5
        for place in body.places[ends_of_template()]:
            gaps = np.linalg.norm(ends - body.shape.vertices[place] / surface.area**0.5, axis=1)
            assert gaps.min() < 0.15
        assert len(ends) <= MAX_TIPS
        assert (surface.tips.distances[:, surface.tips.vertices].diagonal() == 0).all()


def test_peaks_count_by_how_far_they_rise_above_the_saddle_to_a_higher_one():
    places = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    faces = np.array([[i, i + 1, i + 1] for i in range(5)])
    heights = np.array([0.5, 0.1, 0.9, 0.6, 0.7, 0.2])
    net = edge_net(places, faces)
    assert _persistence(net, heights) == pytest.approx([0.4, 0.0, 0.8, 0.0, 0.1, 0.0])


def test_matches_are_rated_by_the_distances_between_tips(rng):
    places = rng.random((5, 3))
    distances = np.linalg.norm(places[:, None] - places, axis=2)
    order = np.array([3, 0, 4, 1])
    whole, some = (
        Tips(np.arange(5), distances),
        Tips(np.arange(4), distances[np.ix_(order, order)]),
    )
    to, of = tip_matches(whole, some)[0]
    assert (to == order).all()
    assert (of == np.arange(4)).all()
    back, there = tip_matches(some, whole)[0]
    assert (there == order).all()
    assert (back == np.arange(4)).all()


def test_matched_tips_start_the_right_map_and_the_half_turned_one_of_one_orientation(bodies):
    target, source = bodies[1]
    right, turned = (
        map_of(bodies, turn=np.diag(signs)) for signs in ((1.0, 1.0, 1.0), (-1.0, -1.0, 1.0))
    )
    starts = tip_starts(target, source, len(source.dense), mirrored=False)
    places = target.vertices[target.dense] / target.area**0.5

    def off(start, known):
        gaps = places[start[0]] - places[known.map_target_source]
        return float(np.linalg.norm(gaps, axis=1).mean())

    assert min(off(start, right) for start in starts) < 0.15
    assert min(off(start, turned) for start in starts) < 0.2
    assert len(tip_starts(target, source, 100, mirrored=True)) == 2 * len(starts)


def test_a_half_turn_leaves_more_across_limbs_than_the_right_map_and_other_sides_are_seen(bodies):
    target, source = bodies[1]
    right = map_of(bodies, turn=np.eye(3))
    turned = map_of(bodies, turn=np.diag([-1.0, -1.0, 1.0]))
    mirrored = map_of(bodies, turn=np.diag([1.0, -1.0, 1.0]))
    gap = limb_gap(target, source, right, chirality=1.0)
    assert 0.0 < gap < 0.5 * limb_gap(target, source, turned, chirality=1.0)
    assert gap < limb_gap(target, source, right, chirality=-1.0)
    nowhere = replace(right, map_target_source=np.zeros_like(right.map_target_source))
    assert gap < limb_gap(target, source, nowhere, chirality=1.0) <= 1.0
    as_reflection = limb_gap(target, source, mirrored, chirality=-1.0)
    assert as_reflection < limb_gap(target, source, mirrored, chirality=1.0)
    assert as_reflection == pytest.approx(gap, abs=0.1)


def candidates_of(target, source, options):
    return find_candidates(target, source, screened_from_within(target, source, options), options)


def test_the_best_candidate_of_two_kinds_is_right_and_fits_across_limbs(bodies):
    target, source = bodies[1]
    right = map_of(bodies, turn=np.eye(3)).map_target_source
    found = candidates_of(target, source, NonrigidOptions())
    places = target.vertices[target.dense] / target.area**0.5
    off = [
        np.linalg.norm(places[one.functional_map.map_target_source] - places[right], axis=1).mean()
        for one in found
    ]
    assert off[0] < 0.1
    assert max(off) > 0.3
    assert found[0].evidence.limbs == min(one.evidence.limbs for one in found) < 0.5


def test_poses_and_tips_start_maps_only_where_those_from_within_are_in_doubt(bodies):
    target, source = bodies[1]

    def tried(shape, *, orientation="preserving"):
        options = NonrigidOptions(orientation=orientation)
        found = candidates_of(target, shape, options)
        sure = whole_trust(target, found, likeliest(target, found, options))
        return sure, {one.origin for one in found} & {FROM_TIPS, FROM_POSES}

    sure, others = tried(target)
    assert sure >= SURE_FROM_WITHIN
    assert not others
    assert tried(source)[1], "a person and an ape"
    assert tried(target, orientation="any")[1], "all that are mirrored are asked for"
