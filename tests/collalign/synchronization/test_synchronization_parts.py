"""Parts of synchronization against their definitions: noise model, turns, affinities, last weights, signs, gauge."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.synchronization import PairGraph, principal_axes_gauge, synchronize
from collalign.synchronization.clusters import pair_affinity, spectral_clusters
from collalign.synchronization.frames import relative, transposed
from collalign.synchronization.hypotheses import (
    Hypotheses,
    _add_own_hypotheses,
    _directed_flips,
    _flipped_pairs,
    _modes,
    _rotated_distances,
    aligned_candidates,
)
from collalign.synchronization.model import (
    PRIORS,
    EdgeModel,
    _fitted_noise,
    candidate_features,
    relative_energies,
    relative_weights,
    squared_distances,
)
from collalign.synchronization.robust import connectivity_warnings
from collalign.synchronization.search import State, common_costs
from collalign.synchronization.spectral import synchronize_signs
from data_tools.notes import Note
from data_tools.rotations import rotation_angle_deg
from pairwise.rotation_pattern import RotationPattern
from tests.synchronization_problems import (
    complete_edges,
    exact_pairs,
    random_rotations,
    small_rotations,
)

THIRD = np.array(
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
)  # a turn that is not its own inverse


def noisy_graph(num, noise_deg, *, seed=0, **options):
    """All pairs of random poses with small noise; returns the graph and ``R_common_i``."""
    rng = np.random.default_rng(seed)
    edges, truth = complete_edges(num), random_rotations(rng, num)
    pairs = exact_pairs(truth, edges) @ small_rotations(rng, (len(edges),), noise_deg)
    return PairGraph.from_user(edges, pairs, **options), truth


def test_squared_distances_are_frobenius():
    graph, truth = noisy_graph(5, 20.0)
    frames = transposed(truth)
    expected = graph.candidates[:, 0] - relative(frames, graph.edges)
    found = squared_distances(graph, frames)[:, 0]
    np.testing.assert_allclose(found, (expected**2).sum(axis=(1, 2)), atol=1e-12)


def test_costs_are_the_log_of_a_mixture_and_shares_its_parts():
    graph, _ = noisy_graph(4, 10.0)
    model = EdgeModel(graph=graph)
    for distance in (0.0, 0.3, 8.0):
        squared = np.full((graph.num_edges, 1), distance)
        inlier, outlier = np.exp(model.log_terms(squared))[:, 0], np.exp(model.log_uniform)
        np.testing.assert_allclose(model.costs(squared), -np.log(inlier + outlier), atol=1e-12)
        np.testing.assert_allclose(
            model.responsibilities(squared)[:, 0], inlier / (inlier + outlier), atol=1e-12
        )


def test_noise_is_estimated_with_the_freedom_of_the_frames_discounted():
    # The frames of a least squares solution absorb part of the noise; what is left must be scaled up again.
    estimates = []
    for seed in range(12):
        graph, _ = noisy_graph(8, 10.0, seed=seed)
        found = synchronize(graph.edges, graph.candidates[:, 0])
        squared = squared_distances(graph, transposed(found.rotations))
        share = np.ones((graph.num_edges, 1))
        estimates.append(np.rad2deg(_fitted_noise(EdgeModel(graph=graph), share, squared)))
    # 10 degrees over three axes; the prior pulls a little
    assert np.median(estimates) == pytest.approx(10.0 / np.sqrt(3.0), rel=0.1)


def test_features_energies_and_weights_are_relative():
    edges = np.array([[0, 1], [1, 2], [0, 2]])
    energies = np.array([[1.0, np.e], [2.0, 2.0 * np.e], [4.0 * np.e, 4.0]])
    graph = PairGraph.from_user(
        edges, np.tile(np.eye(3), (3, 2, 1, 1)), energies=energies, weights=[1.0, 2.0, 8.0]
    )
    features = candidate_features(graph)
    assert features[..., 0].tolist() == [[0, 1], [0, 1], [1, 0]]
    np.testing.assert_allclose(features[..., 1], [[0, 1], [0, 1], [1, 0]], atol=1e-12)
    np.testing.assert_allclose(relative_energies(graph), [0.5, 1.0, 2.0])
    assert relative_energies(replace(graph, energies=0.0 * energies)).tolist() == [1.0] * 3, (
        "copies are no ties"
    )
    np.testing.assert_allclose(relative_weights(graph), [0.5, 1.0, 4.0])
    fixed = replace(graph, fixed=np.array([False, False, True]))
    assert relative_weights(fixed)[2] == pytest.approx(1e3 * relative_weights(fixed)[:2].max())


def turned_by(turn, shape, num):
    """All pairs of ``num`` shapes in the pose that the frames say, but for one shape that is turned."""
    rng = np.random.default_rng(2)
    edges, frames = complete_edges(num), random_rotations(rng, num)
    posed = frames.copy()
    posed[shape] = frames[shape] @ turn
    pairs = exact_pairs(transposed(posed), edges)
    return EdgeModel(graph=PairGraph.from_user(edges, pairs)), aligned_candidates(
        PairGraph.from_user(edges, pairs), frames
    )


@pytest.mark.parametrize("shape", [0, 2, 4])
def test_a_turned_shape_proposes_its_own_turn_whichever_side_of_its_pairs_it_is(shape):
    model, aligned = turned_by(THIRD, shape, 5)
    turns, offered = np.tile(np.eye(3), (5, 3, 1, 1)), np.zeros((5, 3), dtype=bool)
    offered[:, 0] = True
    _add_own_hypotheses(model, aligned, turns, offered, 1, np.zeros(10))
    assert offered[shape, 1]
    swap = model.graph.edges[:, 1] == shape
    asked = np.where(swap[:, None, None], np.swapaxes(aligned[:, 0], 1, 2), aligned[:, 0])
    mine = asked[(model.graph.edges == shape).any(axis=1)]
    np.testing.assert_allclose(mine, np.broadcast_to(turns[shape, 1], mine.shape), atol=1e-6)


@pytest.mark.parametrize(("angle_deg", "count"), [(26.0, 0), (36.0, 1)])
def test_what_is_within_thirty_degrees_of_a_known_turn_is_no_other(angle_deg, count):
    turn = Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()
    assert len(_modes(np.tile(turn, (9, 1, 1)), np.ones(9), 0.02, 5, np.eye(3)[None], 48)) == count


def test_modes_are_apart_and_the_heaviest_first():
    rng = np.random.default_rng(3)
    flip = np.diag([1.0, -1.0, -1.0])
    turns = np.concatenate(
        [THIRD @ small_rotations(rng, (20,), 3.0), flip @ small_rotations(rng, (10,), 3.0)]
    )
    means = _modes(turns, np.ones(30), 0.02, 5, np.eye(3)[None], 48)
    assert len(means) == 2
    found = RotationPattern.from_user(None, 3, "SO").project(means)
    assert rotation_angle_deg(found[0], THIRD) < 3.0
    assert rotation_angle_deg(found[1], flip) < 3.0


def turn_set(*turns, num=3, rate=0.1):
    common = np.array(turns)
    every = np.tile(np.concatenate([np.eye(3)[None], common]), (num, 1, 1, 1))
    return Hypotheses(
        rotations=every,
        offered=np.ones(every.shape[:2], dtype=bool),
        common=common,
        rates=np.full(len(common), rate),
        explained=np.ones(num * (num - 1) // 2),
    )


def test_flips_go_both_ways_unless_they_are_their_own_inverse():
    both = _directed_flips(turn_set(THIRD))
    assert [rate for _, rate in both] == [0.05, 0.05]
    assert np.allclose(both[0][0], both[1][0].T)
    assert not np.allclose(both[0][0], both[1][0])
    assert len(_directed_flips(turn_set(np.diag([1.0, -1.0, -1.0])))) == 1
    assert _directed_flips(turn_set(THIRD, rate=1e-6)) == []


@pytest.mark.parametrize("noises_rad", [(0.05, 0.35), (0.35, 0.05)])
def test_states_are_compared_at_one_noise_whatever_each_has_fitted(noises_rad):
    rng = np.random.default_rng(5)
    edges, truth = complete_edges(12), random_rotations(rng, 12)
    pairs = exact_pairs(truth, edges) @ small_rotations(rng, (len(edges),), 5.0)
    pairs[::2] = random_rotations(rng, len(pairs[::2]))
    graph = PairGraph.from_user(edges, pairs)
    states = [
        State(
            model=EdgeModel(graph=graph, noise_rad=noise),
            frames=frames,
            beliefs=np.ones((12, 1)),
            alternatives=own,
        )
        for noise, frames in zip(
            noises_rad, (transposed(truth), random_rotations(rng, 12)), strict=True
        )
        for own in [turn_set(THIRD, num=12)]
    ]
    costs = common_costs(states)
    assert costs[1] > costs[0] + 10.0
    assert np.allclose(
        costs,
        common_costs([replace(s, model=EdgeModel(graph=graph, noise_rad=0.05)) for s in states]),
    )


@pytest.mark.parametrize("shared", [True, False])
def test_rotated_distances_are_those_of_their_definition(shared):
    rng = np.random.default_rng(4)
    graph, truth = noisy_graph(3, 30.0)
    aligned = aligned_candidates(graph, transposed(truth))
    alternatives = turn_set(*random_rotations(rng, 2))
    if not shared:
        turns = np.concatenate([alternatives.rotations, random_rotations(rng, 3)[:, None]], axis=1)
        alternatives = replace(
            alternatives, rotations=turns, offered=np.ones(turns.shape[:2], dtype=bool)
        )
    for flip in (None, THIRD):
        found = _rotated_distances(graph, aligned, alternatives, flip=flip)
        target = np.eye(3) if flip is None else flip
        for e, (i, j) in enumerate(graph.edges):
            for a, b in itertools.product(range(alternatives.rotations.shape[1]), repeat=2):
                T = alternatives.rotations[i, a].T @ aligned[e, 0] @ alternatives.rotations[j, b]
                assert found[e, 0, a, b] == pytest.approx(((T - target) ** 2).sum(), abs=1e-9)


def test_pairs_are_wrong_by_a_common_rotation_as_far_as_they_are_not_right():
    model, aligned = turned_by(THIRD, 2, 5)
    is_turned = (model.graph.edges == 2).any(axis=1)
    found = _flipped_pairs(model, aligned, THIRD[None], np.full(len(is_turned), 0.25))
    np.testing.assert_allclose(found[:, 0], 0.75 * is_turned)


def test_affinity_is_the_closure_rate_times_a_trust_that_never_exceeds_one():
    edges = complete_edges(4)
    truth = random_rotations(np.random.default_rng(5), 4)
    pairs = exact_pairs(truth, edges)
    pairs[0] = pairs[0] @ np.diag([1.0, -1.0, -1.0])  # the pair (0, 1) closes no triangle
    energies = np.array([1.0, 0.5, 1.0, 1.0, 4.0, 1.0])
    affinity = pair_affinity(PairGraph.from_user(edges, pairs, energies=energies))
    assert np.array_equal(affinity, affinity.T)
    closed = {(0, 1): 0, (0, 2): 1, (0, 3): 1, (1, 2): 1, (1, 3): 1, (2, 3): 2}
    for (i, j), energy in zip(edges, energies, strict=True):
        assert affinity[i, j] == pytest.approx((closed[i, j] + 1e-3) / 3.0 * min(1.0, 1.0 / energy))


def test_parts_are_numbered_by_their_first_shape():
    member = np.array([1, 0, 0, 1, 2, 2, 1, 0])
    affinity = np.where(member[:, None] == member, 1.0, 0.01) - np.eye(8)
    expected = [0, 1, 1, 0, 2, 2, 0, 1]
    assert spectral_clusters(affinity, 3).tolist() == expected


def test_the_first_axis_has_the_largest_variance_and_nothing_is_mirrored():
    rng = np.random.default_rng(8)
    for _ in range(8):
        cloud = rng.exponential(1.0, (60, 3)) * rng.permutation([3.0, 2.0, 1.0])
        turns = principal_axes_gauge([cloud], random_rotations(rng, 1))
        moved = (cloud - cloud.mean(axis=0)) @ turns[0].T
        assert np.linalg.det(turns[0]) == pytest.approx(1.0)
        assert (np.diff(moved.var(axis=0)) < 0).all()
        assert ((moved**3).mean(axis=0)[:2] > 0).all()


def test_signs_are_relative_to_the_first_shape_and_agree_with_most_of_the_evidence():
    truth = np.array([-1.0, 1.0, 1.0, -1.0, 1.0])
    mirrored = [False, True, True, False, True]
    edges = complete_edges(5)
    signs = truth[edges[:, 0]] * truth[edges[:, 1]]
    assert synchronize_signs(edges, signs, np.ones(10), 5).tolist() == mirrored
    signs[2] *= -1.0
    assert synchronize_signs(edges, signs, np.ones(10), 5).tolist() == mirrored
    alone = np.full(10, 0.1)
    # The first shape's own pairs say all that counts, the wrong one included.
    alone[[0, 1, 2, 3]] = 1.0
    assert synchronize_signs(edges, signs, alone, 5).tolist() == [False, True, True, True, True]


def test_unconnected_parts_are_said():
    assert connectivity_warnings(1) == ()
    assert connectivity_warnings(2) == (Note("unconnected", values={"num": 2}),)


def test_what_energies_say_of_candidates_is_learnt_from_the_pairs():
    rng = np.random.default_rng(4)
    graph, truth = noisy_graph(12, 3.0)
    turned = graph.candidates[:, 0] @ np.diag([1.0, -1.0, -1.0])
    both = np.stack([graph.candidates[:, 0], turned], axis=1)
    frames = transposed(truth)

    def learnt(energies):
        told = PairGraph.from_user(graph.edges, both, energies=energies)
        return EdgeModel(graph=told).updated(squared_distances(told, frames))

    lower = rng.uniform(0.1, 0.2, (len(both), 1))
    right, wrong = learnt(np.hstack([lower, 2.0 * lower])), learnt(np.hstack([2.0 * lower, lower]))
    assert (
        right.best_log_odds + right.energy_slope
        > PRIORS.log_odds
        > wrong.best_log_odds + wrong.energy_slope
    )
