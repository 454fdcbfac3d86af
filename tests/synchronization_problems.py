"""Planted synchronization problems with known answers, for the tests and the benchmarks."""

from dataclasses import dataclass

import networkx
import numpy as np

from data_tools.arrays import FloatArray, IntArray

#: The rotations by 180 degrees about the three axes, after the identity.
D2_FLIPS = np.stack([np.diag(s) for s in ([1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])])


@dataclass(frozen=True, kw_only=True, eq=False)
class Planted:
    """Edges, candidate rotations (E, m, d, d), energies (E, m) and the planted ``R_common_i``."""

    edges: IntArray
    rotations: FloatArray
    energies: FloatArray | None
    truth: FloatArray


def random_rotations(rng, count, dim=3, *, group="SO"):
    """Uniform random orthogonal matrices, of determinant +1 for ``group="SO"``."""
    q, r = np.linalg.qr(rng.standard_normal((count, dim, dim)))
    q = q * np.sign(np.einsum("nii->ni", r))[:, None, :]
    if group == "SO":
        q[:, :, 0] *= np.linalg.det(q)[:, None]
    return q


def small_rotations(rng, shape, rms_deg, dim=3):
    """Random rotations of the given root-mean-square angle (normal in the tangent space)."""
    rows, cols = np.triu_indices(dim, 1)
    tangent = rng.standard_normal((*shape, len(rows))) * np.deg2rad(rms_deg) / np.sqrt(len(rows))
    skew = np.zeros((*shape, dim, dim))
    skew[..., rows, cols], skew[..., cols, rows] = tangent, -tangent
    unit = np.eye(dim)
    return np.linalg.solve(unit - skew / 2, unit + skew / 2)


def complete_edges(num_shapes):
    return np.stack(np.triu_indices(num_shapes, 1), axis=1).astype(np.int64)


def regular_edges(num_shapes, degree, seed):
    """Edges of a connected random regular graph."""
    for attempt in range(100):
        graph = networkx.random_regular_graph(degree, num_shapes, seed=seed + 1000 * attempt)
        if networkx.is_connected(graph):
            return np.array(sorted(tuple(sorted(e)) for e in graph.edges), dtype=np.int64)
    raise RuntimeError("no connected graph found")


def exact_pairs(truth, edges):
    return np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]]


def flipped_pairs(rng, edges, num_shapes, *, wrong, noise_deg=10.0, num_candidates=1, kind="flips", informative=True):
    """Pairs of which a share is wrong: off by a 180 degree flip about an axis of the common frame, or anything.

    With four candidates every pair has all flips, each with its own noise, and the lowest energy is wrong with
    probability ``wrong``. Where energies are ``informative`` those of right and flipped candidates are normal, apart
    by what makes that probability; otherwise the margins say nothing.
    """
    truth = random_rotations(rng, num_shapes)
    count = len(edges)
    left, right = np.swapaxes(truth[edges[:, 0]], 1, 2), truth[edges[:, 1]]
    noise = small_rotations(rng, (count, num_candidates), noise_deg)
    is_wrong = rng.random(count) < wrong
    if kind == "uniform":
        measured = (left @ right)[:, None] @ noise
        measured[is_wrong, 0] = random_rotations(rng, int(is_wrong.sum()))
        return Planted(edges=edges, rotations=measured, energies=None, truth=truth)
    flips = rng.permuted(np.tile([1, 2, 3], (count, 1)), axis=1)
    if num_candidates == 1:
        flip, energies = np.where(is_wrong, flips[:, 0], 0)[:, None], None
    elif informative:
        flip = rng.permuted(np.tile(np.arange(4), (count, 1)), axis=1)
        energies = 10.0 + rng.standard_normal((count, 4)) + _flip_margin(wrong) * (flip > 0)
    else:
        place = np.where(is_wrong, rng.integers(1, 4, count), 0)
        flip = np.insert(flips, 0, 0, axis=1)
        flip[is_wrong] = np.stack([np.insert(f, p, 0) for f, p in zip(flips[is_wrong], place[is_wrong], strict=True)])
        energies = 10.0 + np.cumsum(rng.exponential(1.0, (count, 4)), axis=1)
    measured = left[:, None] @ D2_FLIPS[flip] @ right[:, None] @ noise
    return Planted(edges=edges, rotations=measured, energies=energies, truth=truth)


def _flip_margin(wrong):
    """Margin m such that the least of three normals around m is below one around 0 with the given probability."""
    draws = np.random.default_rng(0).standard_normal((200_000, 4))
    return float(np.quantile(draws[:, 0] - draws[:, 1:].min(axis=1), 1.0 - wrong))


def group_flip(rng, edges, num_shapes, *, share, chance, wrong=0.0):
    """Pairs between a block of shapes and the rest are off by one and the same flip with the given chance."""
    problem = flipped_pairs(rng, edges, num_shapes, wrong=wrong)
    block = np.isin(np.arange(num_shapes), rng.permutation(num_shapes)[: round(share * num_shapes)])
    flipped = (block[edges[:, 0]] != block[edges[:, 1]]) & (rng.random(len(edges)) < chance)
    left = problem.truth[edges[:, 0]]
    turn = np.swapaxes(left, 1, 2) @ D2_FLIPS[2] @ left
    rotations = np.where(flipped[:, None, None, None], turn[:, None] @ problem.rotations, problem.rotations)
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
    return Planted(edges=edges, rotations=rotations, energies=energies[:, None], truth=problem.truth), labels


def pose_errors_deg(rotations, truth):
    """Angle of each pose to the truth after the best common rotation (robust: the mode over anchor shapes)."""
    turns = np.swapaxes(truth, 1, 2) @ rotations
    turns = truth @ np.swapaxes(rotations, 1, 2)
    gram = turns.reshape(len(turns), -1) @ turns.reshape(len(turns), -1).T
    close = gram > 1 + 2 * np.cos(np.deg2rad(25.0))
    members = turns[close[np.argmax(close.sum(axis=1))]]
    u, _, vt = np.linalg.svd(members.sum(axis=0))
    errors = np.linalg.norm((u @ vt) @ rotations - truth, axis=(1, 2)) / np.sqrt(8.0)
    return np.rad2deg(2 * np.arcsin(np.minimum(errors, 1.0)))
