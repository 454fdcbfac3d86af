"""Every detector reports the failure that is planted for it, and is silent where there is none."""

import numpy as np
import pytest

from collalign.synchronization import synchronize
from tests.synchronization_problems import (
    D2_FLIPS,
    complete_edges,
    flipped_pairs,
    pose_errors_deg,
    regular_edges,
)


def _solve(problem, **options):
    return synchronize(problem.edges, problem.rotations, energies=problem.energies, **options)


def test_a_wrong_shape_has_low_confidence_and_its_true_pose_among_the_alternatives():
    edges = complete_edges(16)
    problem = flipped_pairs(np.random.default_rng(2), edges, 16, wrong=0.05, num_candidates=1)
    rotations = problem.rotations.copy()
    touching = np.flatnonzero((edges == 5).any(axis=1))
    flipped = touching[::2]
    turn = D2_FLIPS[3]
    left = np.swapaxes(problem.truth[edges[:, 0]], 1, 2)
    rotations[flipped, 0] = (left @ turn @ problem.truth[edges[:, 1]])[flipped]
    found = synchronize(edges, rotations)
    assert found.confidence[5] < 0.95 < np.delete(found.confidence, 5).min()
    pairs = np.delete(np.arange(16), 5)
    gauge = found.rotations[pairs[0]] @ problem.truth[pairs[0]].T
    poses = [
        gauge.T @ found.rotations[5],
        *(gauge.T @ other.rotation for other in found.alternatives[5]),
    ]
    assert min(np.linalg.norm(pose - problem.truth[5]) for pose in poses) < 0.5


@pytest.mark.parametrize(("degree", "stated"), [(6, 0.0), (10, 0.8)])
def test_confidence_is_calibrated_and_ranks_wrong_shapes(degree, stated):
    right, sure = [], []
    for seed in range(6):
        problem = flipped_pairs(
            np.random.default_rng(seed), regular_edges(60, degree, seed), 60, wrong=0.3
        )
        found = _solve(problem)
        right.append(pose_errors_deg(found.rotations, problem.truth) < 20.0)
        sure.append(found.confidence)
    is_right, confidence = np.concatenate(right), np.concatenate(sure)
    stated_right = is_right[confidence >= 0.95]
    assert len(stated_right) >= stated * len(is_right)
    assert stated_right.sum() >= 0.99 * len(stated_right)
    assert confidence[is_right].mean() > confidence[~is_right].mean() + 0.1


@pytest.mark.parametrize(("degree", "wrong", "stated"), [(12, 0.5, 0.8), (12, 0.7, 0.0)])
def test_sparse_graphs_with_uniform_outliers_state_no_wrong_shape(degree, wrong, stated):
    edges = regular_edges(200, degree, 6)
    problem = flipped_pairs(
        np.random.default_rng(6), edges, 200, wrong=wrong, noise_deg=5.0, kind="uniform"
    )
    found = _solve(problem)
    is_right = pose_errors_deg(found.rotations, problem.truth) < 20.0
    sure = found.confidence >= 0.95
    assert sure.mean() >= stated
    assert is_right[sure].all()
