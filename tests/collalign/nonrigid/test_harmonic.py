"""Maps that are smooth both ways, and tips of limbs: matched as all matchings together say, and mended where torn."""

from itertools import permutations

import numpy as np
import pytest

from collalign.nonrigid.functional_map import FunctionalMap, fitted_map
from collalign.nonrigid.harmonic import SMOOTHNESS, HarmonicRefiner
from collalign.nonrigid.map_evidence import judge
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.pose_maps import PoseMapper
from collalign.nonrigid.starts.smooth import LEFT_OUT, MIN_TIPS, REMOTENESS_WEIGHT, SmoothMapper, tip_matchings
from collalign.nonrigid.surface.posed import sampled_surface
from collalign.nonrigid.surface.spectral_shape import SpectralShape, prepare_surface
from collalign.nonrigid.surface.tips import UNREACHABLE, Tips
from data_tools.arrays import FloatArray, IntArray
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape


@pytest.fixture(scope="module")
def bodies() -> tuple[SpectralShape, SpectralShape]:
    """A body and the same bent, vertices in the same order."""
    body = figure(resolution=3)
    options = SurfaceOptions(num_functions=60, num_dense=300, num_samples=40)
    return prepare_surface(body, options), prepare_surface(bent(body, np.random.default_rng(3), angle=0.5), options)


def true_maps(bodies: tuple[SpectralShape, SpectralShape]) -> tuple[IntArray, IntArray]:
    """The nearest dense sample of the one body to each of the other's, as both are at rest."""
    rest = bodies[0].vertices
    gaps = np.linalg.norm(rest[bodies[1].dense][:, None] - rest[bodies[0].dense], axis=2)
    return gaps.argmin(axis=1), gaps.argmin(axis=0)


def torn(maps: tuple[IntArray, IntArray], rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Maps in which a tenth of the points go anywhere."""
    return tuple(np.where(rng.random(len(one)) < 0.1, rng.integers(0, 300, len(one)), one) for one in maps)  # type: ignore[return-value]


def off(bodies: tuple[SpectralShape, SpectralShape], forward: IntArray) -> float:
    """The mean distance of images from where they belong, in units of sqrt(area)."""
    rest = bodies[0].vertices
    gaps = rest[bodies[0].dense[forward]] - rest[bodies[1].dense]
    return float(np.linalg.norm(gaps, axis=1).mean() / bodies[0].area ** 0.5)


def as_map(bodies: tuple[SpectralShape, SpectralShape], maps: tuple[IntArray, IntArray]) -> FunctionalMap:
    bases = [shape.basis[shape.dense] for shape in bodies]
    return FunctionalMap(
        C_source_target=fitted_map(bases[0], bases[1], *maps),
        map_target_source=maps[0],
        map_source_target=maps[1],
    )


def test_torn_maps_are_mended_and_all_vertices_follow(bodies: tuple[SpectralShape, SpectralShape]) -> None:
    true = true_maps(bodies)
    broken = torn(true, np.random.default_rng(0))
    refiner = HarmonicRefiner(*bodies, num_dense=300, num_functions=61)
    found = refiner.refine(*broken, [SMOOTHNESS] * 6)
    assert off(bodies, broken[0]) > 0.06
    assert off(bodies, found.map_target_source) < 0.04
    forward, backward = refiner.of_all_vertices(found)
    rest, unit = bodies[0].vertices, bodies[0].area ** 0.5
    for images in (forward, backward):
        assert np.linalg.norm(rest[images] - rest, axis=1).mean() < 0.04 * unit
    before, after = (judge(*bodies, one).stretch for one in (as_map(bodies, broken), found))
    assert after < 2.0 < before


def test_both_directions_are_treated_alike(bodies: tuple[SpectralShape, SpectralShape]) -> None:
    forward, backward = torn(true_maps(bodies), np.random.default_rng(1))
    there = HarmonicRefiner(*bodies, num_dense=300, num_functions=41).refine(forward, backward, [1e-3] * 3)
    back = HarmonicRefiner(bodies[1], bodies[0], num_dense=300, num_functions=41).refine(
        backward, forward, [1e-3] * 3
    )
    assert (there.map_target_source == back.map_source_target).mean() > 0.99
    assert (there.map_source_target == back.map_target_source).mean() > 0.99


def test_without_smoothness_torn_maps_stay_rougher(bodies: tuple[SpectralShape, SpectralShape]) -> None:
    broken = torn(true_maps(bodies), np.random.default_rng(2))
    refiner = HarmonicRefiner(*bodies, num_dense=300, num_functions=61)
    smooth, rough = (judge(*bodies, refiner.refine(*broken, [weight])).stretch for weight in (1e-2, 1e-9))
    assert smooth < rough


def some_tips(num: int, rng: np.random.Generator, points: FloatArray | None = None) -> Tips:
    points = rng.random((num, 3)) if points is None else points
    between = np.linalg.norm(points[:, None] - points, axis=2)
    return Tips(between=between, remoteness=rng.normal(scale=0.2, size=num), distances=rng.random((5, num)))


def cost(target: Tips, source: Tips, matched: tuple[int, ...]) -> float:
    """What a matching costs: the target's tip of each source tip, -1 where it is left out."""
    total = 0.0
    for s, t in enumerate(matched):
        if t < 0:
            total += LEFT_OUT * (len(source) - 1)
            continue
        total += REMOTENESS_WEIGHT * (target.remoteness[t] - source.remoteness[s]) ** 2
        for s2, t2 in enumerate(matched[:s]):
            if t2 >= 0:
                total += np.log(target.between[t, t2] / source.between[s, s2]) ** 2
    return total


def test_the_best_matching_of_tips_is_the_best_of_all(rng: np.random.Generator) -> None:
    for noise in (0.05, 0.1, 0.1, 0.2, 1.0):
        points = rng.random((5, 3))
        target, source = some_tips(5, rng, points), some_tips(4, rng, points[:4] + noise * rng.normal(size=(4, 3)))
        every = {
            one: cost(target, source, one)
            for one in set(permutations([*range(5), -1, -1, -1, -1], 4))
            if sum(t >= 0 for t in one) >= MIN_TIPS
        }
        found = tip_matchings(target, source, 6)
        costs = []
        for on_target, on_source in found:
            matched = np.full(4, -1)
            matched[on_source] = on_target
            costs.append(every[tuple(matched.tolist())])
        assert costs == pytest.approx(sorted(every.values())[:6])
        assert costs[0] < max(every.values())


def test_matchings_do_not_depend_on_the_order_of_tips(rng: np.random.Generator) -> None:
    source, order = some_tips(5, rng), rng.permutation(5)
    target = Tips(
        between=source.between[np.ix_(order, order)], remoteness=source.remoteness[order], distances=source.distances
    )
    on_target, on_source = tip_matchings(target, source, 1)[0]
    assert np.array_equal(order[on_target], on_source)
    assert len(on_source) == 5


def test_shapes_without_tips_have_no_matchings(rng: np.random.Generator) -> None:
    assert tip_matchings(Tips.none(7), some_tips(4, rng), 3) == []
    assert tip_matchings(some_tips(4, rng), Tips.none(7), 3) == []


def test_a_body_has_its_tips_and_maps_start_from_them() -> None:
    rng = np.random.default_rng(6)
    body = figure(resolution=3)
    other = bent(body, rng, angle=0.5)
    turned = Shape.from_arrays(other.vertices @ random_rotation(rng).T, other.faces)
    options = SurfaceOptions(num_functions=39, num_dense=200, num_samples=40)
    mapper = PoseMapper(*(sampled_surface(prepare_surface(one, options)) for one in (body, turned)))
    tips = mapper.target.spectral.tips
    assert len(tips) >= MIN_TIPS
    assert (tips.between < UNREACHABLE).all()
    assert tips.between == pytest.approx(tips.between.T, abs=0.05)
    smooth = SmoothMapper(mapper)
    assert 0 < len(smooth.starts_from_tips(4)) <= 8
    best = min((mapper.evidence(one) for one in smooth.maps_from_tips()), key=lambda one: one.score)
    assert best.orientation > 0.8
    assert best.stretch < 2.0


def test_tips_are_remote_and_their_distances_have_no_unit(bodies: tuple[SpectralShape, SpectralShape]) -> None:
    body = bodies[0]
    shapes = [Shape.from_arrays(factor * body.vertices, body.faces, name="body") for factor in (1.0, 7.0)]
    surfaces = [WorkingSurface(shape, SamplingOptions()) for shape in shapes]
    small, large = (Tips.of(surface, np.arange(50)) for surface in surfaces)
    assert len(small) >= 4
    assert (np.diff(small.remoteness) <= 1e-9).all()
    assert small.remoteness.max() > 0.2
    np.testing.assert_allclose(small.between, small.between.T, atol=0.1)
    np.testing.assert_allclose(np.diag(small.between), 0.0, atol=1e-6)
    for name in ("between", "remoteness", "distances"):
        np.testing.assert_allclose(getattr(small, name), getattr(large, name), atol=5e-3)
