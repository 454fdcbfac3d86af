"""Parts of synchronization against their definitions: noise model, turns, affinities, last weights, signs, gauge."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.synchronization import PairGraph, principal_axes_gauge, synchronize
from collalign.synchronization.clusters import pair_affinity, spectral_clusters
from collalign.synchronization.frames import transposed
from collalign.synchronization.hypotheses import (
    _add_own_hypotheses,
    _modes,
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
from collalign.synchronization.spectral import synchronize_signs
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
