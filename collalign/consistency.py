"""From pairs that partly contradict each other to one consistent collection: poses, maps, places and sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from collalign.collection import PairEvidence
from collalign.options import AlignOptions
from collalign.pairs import MatchedPair, synchronize_pairs
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, IntArray, as_rotations, read_only
from data_tools.embedding import Samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Consistency:
    """A consistent collection.

    Attributes
    ----------
    synchronization : SynchronizationResult
        Of the rotations in the embedding.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    transforms : ndarray, shape (N, 4, 4)
        File coordinates to the common frame.
    labels : ndarray of int, shape (N, k)
        Universe label of each sample.
    positions : ndarray, shape (N, k, 3)
        Samples in the common frame.
    consensus : ndarray, shape (num_labels, 3)
    pairs : tuple of PairEvidence
    """

    synchronization: SynchronizationResult
    rotations: FloatArray
    transforms: FloatArray
    labels: IntArray
    positions: FloatArray
    consensus: FloatArray
    pairs: tuple[PairEvidence, ...]


def make_consistent(
    samples: Sequence[Samples],
    pairs: Sequence[MatchedPair],
    options: AlignOptions,
    *,
    fixed: Mapping[str, ArrayLike],
) -> Consistency:
    """Synchronize the pairs, label the samples consistently, and place and scale the shapes.

    Parameters
    ----------
    samples : sequence of Samples
    pairs : sequence of MatchedPair
    options : AlignOptions
    fixed : mapping of name to array_like (3, 3)
        ``R_common_shape`` set by hand.
    """
    names = [item.name for item in samples]
    solution = synchronize_pairs(
        pairs,
        len(samples),
        options,
        fixed={names.index(name): as_rotations(pose, f"fixed[{name}]", dim=3) for name, pose in fixed.items()},
        reference=names.index(options.reference) if options.reference else 0,
    )
    rotations = solution.rotations
    labels = universe_labels(samples, rotations)
    transforms = place_and_scale(samples, rotations, labels, options.scaling)
    positions = np.stack(
        [
            (item.positions * item.scale + item.offset) @ transform[:3, :3].T + transform[:3, 3]
            for item, transform in zip(samples, transforms, strict=True)
        ]
    )
    return Consistency(
        synchronization=solution,
        rotations=rotations,
        transforms=transforms,
        labels=labels,
        positions=positions,
        consensus=in_label_order(positions, labels).mean(axis=0),
        pairs=tuple(_evidence(samples, pair, e, solution) for e, pair in enumerate(pairs)),
    )


def universe_labels(samples: Sequence[Samples], rotations: FloatArray, *, max_rounds: int = 50) -> IntArray:
    """Label the samples of all shapes consistently, by exact assignment to the mean shape until nothing changes.

    Parameters
    ----------
    samples : sequence of Samples
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    max_rounds : int

    Returns
    -------
    ndarray of int, shape (N, k)
        Each row a permutation of 0, ..., k - 1.
    """
    posed = np.stack([np.hstack([x.positions @ r.T, x.invariants]) for x, r in zip(samples, rotations, strict=True)])
    mean = posed[0]
    labels = np.full(posed.shape[:2], -1)
    for _ in range(max_rounds):
        updated = np.stack([linear_sum_assignment(cdist(points, mean, "sqeuclidean"))[1] for points in posed])
        if np.array_equal(updated, labels):
            break
        labels = updated
        mean = in_label_order(posed, labels).mean(axis=0)
    return labels


def in_label_order(values: FloatArray, labels: IntArray) -> FloatArray:
    """Return per-sample values (N, k, m) so that row b of every shape carries label b."""
    return np.take_along_axis(values, np.argsort(labels, axis=1)[:, :, None], axis=1)


def place_and_scale(
    samples: Sequence[Samples], rotations: FloatArray, labels: IntArray, scaling: str, *, max_rounds: int = 100
) -> FloatArray:
    """Return each shape's transform to the common frame: generalised Procrustes at fixed rotations (Gower 1975).

    Parameters
    ----------
    samples : sequence of Samples
    rotations : ndarray, shape (N, 3, 3)
    labels : ndarray of int, shape (N, k)
    scaling : {"similarity", "rigid"}

    Returns
    -------
    ndarray, shape (N, 4, 4)
        File coordinates to the common frame; the samples' mean shape is centred.
    """
    units = np.array([item.scale for item in samples])
    posed = np.stack([item.positions @ r.T for item, r in zip(samples, rotations, strict=True)])
    posed = in_label_order(posed, labels)
    factors = units.copy() if scaling == "rigid" else np.ones(len(samples))
    for _ in range(max_rounds if scaling == "similarity" else 0):
        mean = (factors[:, None, None] * posed).mean(axis=0)
        updated = (posed * mean).sum(axis=(1, 2)) / (posed**2).sum(axis=(1, 2))
        updated *= np.sqrt(len(samples) / (updated**2 * (posed**2).sum(axis=(1, 2))).sum())
        converged = np.allclose(updated, factors, rtol=1e-12, atol=0)
        factors = updated
        if converged:
            break
    transforms = np.tile(np.eye(4), (len(samples), 1, 1))
    for i, item in enumerate(samples):
        transforms[i, :3, :3] = factors[i] / item.scale * rotations[i]
        transforms[i, :3, 3] = -transforms[i, :3, :3] @ item.offset
    return transforms


def _evidence(samples: Sequence[Samples], pair: MatchedPair, e: int, solution: SynchronizationResult) -> PairEvidence:
    """Return what is known about a pair, with its best match at the synchronized rotations."""
    target, source = samples[pair.target], samples[pair.source]
    rotation = solution.rotations[pair.target].T @ solution.rotations[pair.source]
    costs = cdist(source.positions @ rotation.T, target.positions, "sqeuclidean")
    costs += cdist(source.invariants, target.invariants, "sqeuclidean")
    rows, columns = linear_sum_assignment(costs)
    return PairEvidence(
        target=pair.target,
        source=pair.source,
        rotations=read_only(pair.rotations[:, :3, :3].copy()),
        energies=read_only(pair.energies),
        map_target_source=read_only(columns.astype(np.int64)),
        energy=float(costs[rows, columns].sum()),
        lower_bound=pair.lower_bound,
        status=pair.status,
        choice=int(solution.edge_choice[e]),
        inlier=bool(solution.edge_inlier[e]),
        disagreement_deg=float(np.rad2deg(solution.edge_inconsistency_rad[e])),
    )
