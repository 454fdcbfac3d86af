"""Maps that are smooth both ways: mended where they are torn."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.nonrigid.functional_map import SMOOTHNESS, FunctionalMap, HarmonicRefiner, fitted_map
from collalign.nonrigid.map_evidence import measure_evidence
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.map_starts import ShellRefiner
from collalign.nonrigid.portfolio import (
    Layer,
    mended,
    refined_with_evidence,
    sharpened,
    smooth_candidates,
)
from collalign.nonrigid.pose_maps import PoseMapper, sampled_surface
from collalign.nonrigid.refine import without_torn_ends
from collalign.nonrigid.spectral_shape import prepare_surface
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape


@pytest.fixture(scope="module")
def bodies():
    """A body and the same bent, vertices in the same order."""
    body = figure(resolution=3)
    options = SurfaceOptions(num_functions=60, num_dense=300, num_samples=40)
    return prepare_surface(body, options), prepare_surface(
        bent(body, np.random.default_rng(3), angle=0.5), options
    )


def true_maps(bodies):
    """The nearest dense sample of the one body to each of the other's, as both are at rest."""
    rest = bodies[0].vertices
    gaps = np.linalg.norm(rest[bodies[1].dense][:, None] - rest[bodies[0].dense], axis=2)
    return gaps.argmin(axis=1), gaps.argmin(axis=0)


def torn(maps, rng):
    """Maps in which a tenth of the points go anywhere."""
    return tuple(
        np.where(rng.random(len(one)) < 0.1, rng.integers(0, 300, len(one)), one) for one in maps
    )


def off(bodies, forward):
    """The mean distance of images from where they belong, in units of sqrt(area)."""
    rest = bodies[0].vertices
    gaps = rest[bodies[0].dense[forward]] - rest[bodies[1].dense]
    return float(np.linalg.norm(gaps, axis=1).mean() / bodies[0].area ** 0.5)


def as_map(bodies, maps):
    bases = [shape.basis[shape.dense] for shape in bodies]
    return FunctionalMap(
        C_source_target=fitted_map(bases[0], bases[1], *maps),
        map_target_source=maps[0],
        map_source_target=maps[1],
    )


def test_torn_maps_are_mended_and_all_vertices_follow(bodies):
    true = true_maps(bodies)
    broken = torn(true, np.random.default_rng(0))
    refiner = HarmonicRefiner(*bodies)
    found = refiner.refine(*broken, [SMOOTHNESS] * 6)
    assert off(bodies, broken[0]) > 0.06
    assert off(bodies, found.map_target_source) < 0.04
    forward, backward = refiner.of_all_vertices(found)
    rest, unit = bodies[0].vertices, bodies[0].area ** 0.5
    for images in (forward, backward):
        assert np.linalg.norm(rest[images] - rest, axis=1).mean() < 0.04 * unit
    before, after = (
        measure_evidence(*bodies, one).stretch for one in (as_map(bodies, broken), found)
    )
    assert after < 2.0 < before
    right, wrong = (
        refined_with_evidence(*bodies, one, "signs") for one in (found, as_map(bodies, broken))
    )
    sharp, left = (sharpened(*bodies, one).functional_map for one in (right, wrong))
    assert off(bodies, sharp.map_target_source) < 0.025
    assert left is wrong.functional_map is not sharp


def test_ends_of_limbs_that_are_exchanged_are_found_and_mended(bodies):
    of, to = (bodies[0].vertices[one.dense] for one in bodies[::-1])
    ends = [np.abs(points[:, 0] - 10.5) > 5.0 for points in (of, to)]
    other = [
        p + end[:, None] * ([21, 0, 0] - p * [2, 0, 0])
        for p, end in zip((of, to), ends, strict=True)
    ]
    there, back = (
        np.linalg.norm(p[:, None] - q, axis=2).argmin(1)
        for p, q in zip(other, (to, of), strict=True)
    )
    wrong, right = (as_map(bodies, maps) for maps in ((there, back), true_maps(bodies)))
    for maps, found in zip(without_torn_ends(*bodies, wrong), ends, strict=True):
        np.testing.assert_array_equal(maps < 0, found)
    whole, same = (
        mended(*bodies, refined_with_evidence(*bodies, one, "signs"), NonrigidOptions())
        for one in (wrong, right)
    )
    assert off(bodies, whole.functional_map.map_target_source) < 0.05 < 0.15 < off(bodies, there)
    assert same.functional_map is right


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_laying_surfaces_onto_each_other_mends_maps_both_ways_alike(bodies, sign):
    other = replace(
        bodies[1],
        vertices=bodies[1].vertices * [sign, 1.0, 1.0],
        faces=bodies[1].faces[:, :: int(sign)],
    )
    forward, backward = torn(true_maps(bodies), np.random.default_rng(2))
    there, wrong = (
        ShellRefiner(bodies[0], other).refine(forward, backward, chirality=s) for s in (sign, -sign)
    )
    back = ShellRefiner(other, bodies[0]).refine(backward, forward, chirality=sign)
    assert off(bodies, there[0]) < 0.04 < off(bodies, forward)
    assert off(bodies, wrong[0]) > off(bodies, there[0])
    assert (there[0] == back[1]).mean() > 0.99


def test_normals_turn_maps_over_that_exchange_front_and_back(bodies):
    rest = bodies[0].vertices
    over = np.where(np.arange(3) == np.argmin(np.ptp(rest, axis=0)), -1.0, 1.0)
    gaps = np.linalg.norm(over * rest[bodies[1].dense][:, None] - rest[bodies[0].dense], axis=2)
    wrong = as_map(bodies, (gaps.argmin(axis=1), gaps.argmin(axis=0)))
    start = refined_with_evidence(*bodies, wrong, "poses")
    found = Layer(*bodies, NonrigidOptions()).laid(start).functional_map
    assert off(bodies, found.map_target_source) < 0.04 < off(bodies, wrong.map_target_source)


def test_maps_start_smoothly_from_crude_poses():
    body, options = (
        figure(resolution=3),
        SurfaceOptions(num_functions=39, num_dense=200, num_samples=40),
    )
    other = bent(body, np.random.default_rng(6), angle=0.5)
    turned = Shape.from_arrays(
        other.vertices @ random_rotation(np.random.default_rng(7)).T, other.faces
    )
    mapper = PoseMapper(*(sampled_surface(prepare_surface(one, options)) for one in (body, turned)))
    best = smooth_candidates(mapper, NonrigidOptions())[0].evidence
    assert best.orientation > 0.8
    assert best.stretch < 2.0
