"""Planted synchronization problems with known answers: pairs by noise, wrong pairs, candidates and graph."""

from __future__ import annotations

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


def random_rotations(
    rng: np.random.Generator, count: int, dim: int = 3, *, group: str = "SO"
) -> FloatArray:
    """Return uniform random orthogonal matrices (count, d, d), of determinant +1 for ``group="SO"``."""
    q, r = np.linalg.qr(rng.standard_normal((count, dim, dim)))
    q = q * np.sign(np.einsum("nii->ni", r))[:, None, :]
    if group == "SO":
        q[:, :, 0] *= np.linalg.det(q)[:, None]
    return q


def small_rotations(
    rng: np.random.Generator, shape: tuple[int, ...], rms_deg: float, dim: int = 3
) -> FloatArray:
    """Return random rotations of the given root-mean-square angle (normal in the tangent space)."""
    rows, cols = np.triu_indices(dim, 1)
    tangent = rng.standard_normal((*shape, len(rows))) * np.deg2rad(rms_deg) / np.sqrt(len(rows))
    skew = np.zeros((*shape, dim, dim))
    skew[..., rows, cols], skew[..., cols, rows] = tangent, -tangent
    unit = np.eye(dim)
    return np.asarray(np.linalg.solve(unit - skew / 2, unit + skew / 2))


def complete_edges(num_shapes: int) -> IntArray:
    """Return all pairs, shape (E, 2)."""
    return np.stack(np.triu_indices(num_shapes, 1), axis=1).astype(np.int64)


def regular_edges(num_shapes: int, degree: int, seed: int) -> IntArray:
    """Return the edges of a connected random regular graph, shape (E, 2)."""
    for attempt in range(100):
        graph = networkx.random_regular_graph(degree, num_shapes, seed=seed + 1000 * attempt)
        if networkx.is_connected(graph):
            return np.array(sorted(tuple(sorted(e)) for e in graph.edges), dtype=np.int64)
    raise RuntimeError("no connected graph found")


def exact_pairs(truth: FloatArray, edges: IntArray) -> FloatArray:
    """Return ``R_i_j`` of planted ``R_common_i``, shape (E, d, d)."""
    return np.asarray(np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]])


def flipped_pairs(
    rng: np.random.Generator,
    edges: IntArray,
    num_shapes: int,
    *,
    wrong: float,
    noise_deg: float = 10.0,
    num_candidates: int = 1,
    kind: str = "flips",
    informative: bool = True,
    none_right: float = 0.0,
) -> Planted:
    """Return pairs of which a share is wrong.

    A wrong pair is off by a 180 degree flip about an axis of the common frame, or anything. With four candidates
    every pair has all flips, each with its own noise, and the lowest energy is wrong with probability ``wrong``.
    Where energies are ``informative`` those of right and flipped candidates are normal, apart by what makes that
    probability; otherwise the margins say nothing. In a share ``none_right`` of the pairs all candidates are
    anything, and the energies as before.
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
    energies: FloatArray | None = None
    flips = rng.permuted(np.tile([1, 2, 3], (count, 1)), axis=1)
    if num_candidates == 1:
        flip = np.where(is_wrong, flips[:, 0], 0)[:, None]
    elif informative:
        flip = rng.permuted(np.tile(np.arange(4), (count, 1)), axis=1)
        energies = 10.0 + rng.standard_normal((count, 4)) + _flip_margin(wrong) * (flip > 0)
    else:
        place = np.where(is_wrong, rng.integers(1, 4, count), 0)
        flip = np.insert(flips, 0, 0, axis=1)
        flip[is_wrong] = np.stack(
            [np.insert(f, p, 0) for f, p in zip(flips[is_wrong], place[is_wrong], strict=True)]
        )
        energies = 10.0 + np.cumsum(rng.exponential(1.0, (count, 4)), axis=1)
    measured = left[:, None] @ D2_FLIPS[flip] @ right[:, None] @ noise
    if none_right:
        chosen = rng.random(count) < none_right
        anything = random_rotations(rng, num_candidates * int(chosen.sum()))
        measured[chosen] = anything.reshape(-1, num_candidates, 3, 3)
    return Planted(edges=edges, rotations=measured, energies=energies, truth=truth)


def _flip_margin(wrong: float) -> float:
    """Return the margin m such that the least of three normals around m is below one around 0 that often."""
    draws = np.random.default_rng(0).standard_normal((200_000, 4))
    return float(np.quantile(draws[:, 0] - draws[:, 1:].min(axis=1), 1.0 - wrong))


def pose_errors_deg(rotations: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the angle of each pose to the truth after the common rotation that most shapes agree about, (N,)."""
    relative = truth @ np.swapaxes(rotations, 1, 2)
    gram = relative.reshape(len(relative), -1) @ relative.reshape(len(relative), -1).T
    close = gram > 1 + 2 * np.cos(np.deg2rad(25.0))
    members = relative[close[np.argmax(close.sum(axis=1))]]
    u, _, vt = np.linalg.svd(members.sum(axis=0))
    errors = np.linalg.norm((u @ vt) @ rotations - truth, axis=(1, 2)) / np.sqrt(8.0)
    return np.asarray(np.rad2deg(2 * np.arcsin(np.minimum(errors, 1.0))))
