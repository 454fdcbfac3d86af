"""Planted synchronization problems of the tests and benchmarks: those of the experiment, blocks and kinds."""

import numpy as np

from experiments.peers.planted_pairs import (
    D2_FLIPS,
    Planted,
    complete_edges,
    exact_pairs,
    flipped_pairs,
    pose_errors_deg,
    random_rotations,
    regular_edges,
    small_rotations,
)

__all__ = [
    "D2_FLIPS",
    "Planted",
    "complete_edges",
    "exact_pairs",
    "flipped_pairs",
    "group_flip",
    "mixed_collection",
    "pose_errors_deg",
    "random_rotations",
    "regular_edges",
    "small_rotations",
]


def group_flip(rng, edges, num_shapes, *, share, chance, wrong=0.0):
    """Pairs between a block of shapes and the rest are off by one and the same flip with the given chance."""
    problem = flipped_pairs(rng, edges, num_shapes, wrong=wrong)
    block = np.isin(np.arange(num_shapes), rng.permutation(num_shapes)[: round(share * num_shapes)])
    flipped = (block[edges[:, 0]] != block[edges[:, 1]]) & (rng.random(len(edges)) < chance)
    left = problem.truth[edges[:, 0]]
    turn = np.swapaxes(left, 1, 2) @ D2_FLIPS[2] @ left
    rotations = np.where(
        flipped[:, None, None, None], turn[:, None] @ problem.rotations, problem.rotations
    )
    return Planted(edges=edges, rotations=rotations, energies=None, truth=problem.truth), block


def mixed_collection(rng, sizes, *, wrong):
    """All pairs of shapes of several kinds: within a kind as :func:`flipped_pairs`, between kinds anything."""
    labels = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    edges = complete_edges(len(labels))
    problem = flipped_pairs(rng, edges, len(labels), wrong=wrong)
    between = labels[edges[:, 0]] != labels[edges[:, 1]]
    rotations = problem.rotations.copy()
    rotations[between, 0] = random_rotations(rng, int(between.sum()))
    energies = rng.uniform(0.8, 1.2, len(edges)) * np.where(between, 2.0, 1.0)
    return Planted(
        edges=edges, rotations=rotations, energies=energies[:, None], truth=problem.truth
    ), labels
