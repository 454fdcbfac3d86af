"""The common frame: its gauge and origin, common labels of the samples, and the transforms that follow from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from collalign.options import AlignOptions
from collalign.products.pair import AlignedPair
from collalign.products.shapes import Constraints
from collalign.synchronization import SynchronizationResult, principal_axes_gauge, synchronize_maps
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.poses import moved_by


def fix_frame(
    options: AlignOptions,
    samples: Sequence[Samples],
    rotations: FloatArray,
    solution: SynchronizationResult,
    constraints: Constraints,
) -> tuple[FloatArray, SynchronizationResult]:
    """Return poses and solution in the gauge that ``options.gauge`` asks for; fixed poses go before.

    They come in the gauge of the reference, which landmarks of it may rotate; "axes" is that of the principal axes of
    all posed samples together.

    Parameters
    ----------
    options : AlignOptions
    samples : sequence of Samples
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    solution : SynchronizationResult
        In the same frame.
    constraints : Constraints
    """
    if constraints.fixed or (options.gauge != "axes" and constraints.rotation is None):
        return rotations, solution
    if constraints.rotation is not None:
        posed = constraints.rotation @ rotations[constraints.reference].T @ rotations
    else:
        posed = principal_axes_gauge([item.positions for item in samples], rotations)
    rotation = posed[0] @ rotations[0].T
    return posed, rotated_solution(solution, np.tile(rotation, (len(samples), 1, 1)))


def with_origin(transforms: FloatArray, constraints: Constraints) -> FloatArray:
    """Return transforms (N, 4, 4) with the origin at the point of the reference that was asked for, if any was."""
    if constraints.origin is None or constraints.fixed_transforms:
        return transforms
    moved = transforms.copy()
    moved[:, :3, 3] -= moved_by(transforms[constraints.reference], constraints.origin)
    return moved


def rotated_solution(
    solution: SynchronizationResult, rotations: FloatArray
) -> SynchronizationResult:
    """Return the solution with the pose of each shape, and its alternatives, rotated in the common frame.

    Parameters
    ----------
    solution : SynchronizationResult
        Of rotations of space.
    rotations : ndarray, shape (N, 3, 3)
        The same for all shapes of a connected part.
    """
    alternatives = tuple(
        tuple(replace(pose, rotation=read_only(rotation @ pose.rotation)) for pose in poses)
        for rotation, poses in zip(rotations, solution.alternatives, strict=True)
    )
    return replace(
        solution, rotations=read_only(rotations @ solution.rotations), alternatives=alternatives
    )


def labels_at_common_poses(
    samples: Sequence[Samples], pairs: Sequence[AlignedPair], rotations: FloatArray
) -> IntArray:
    """Label the samples of all shapes consistently, from the pairs' maps and the common poses.

    Parameters
    ----------
    samples : sequence of Samples
    pairs : sequence of AlignedPair
        With their maps at the common poses.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.

    Returns
    -------
    ndarray of int, shape (N, k)
        Each row a permutation of 0, ..., k - 1.
    """
    posed = [
        np.hstack([x.positions @ r.T, x.invariants])
        for x, r in zip(samples, rotations, strict=True)
    ]
    median = float(np.median([pair.energy for pair in pairs])) or 1.0
    return synchronize_maps(
        np.array([(pair.target, pair.source) for pair in pairs]),
        np.stack([pair.map_target_source for pair in pairs]),
        np.array([1.0 / (1.0 + pair.energy / median) for pair in pairs]),
        np.stack(posed),
    )


def in_label_order(values: FloatArray, labels: IntArray) -> FloatArray:
    """Return per-sample values (N, k, m) so that row b of every shape carries label b."""
    return np.take_along_axis(values, np.argsort(labels, axis=1)[:, :, None], axis=1)


def place_and_scale(
    samples: Sequence[Samples],
    rotations: FloatArray,
    labels: IntArray,
    scaling: str,
    *,
    fixed: Mapping[int, FloatArray] | None = None,
) -> FloatArray:
    """Return each shape's transform to the common frame: generalised Procrustes at the common rotations.

    Parameters
    ----------
    samples : sequence of Samples
    rotations : ndarray, shape (N, 3, 3)
    labels : ndarray of int, shape (N, k)
    scaling : {"similarity", "rigid"}
    fixed : mapping of int to ndarray (4, 4), optional
        Transforms that stay; the other shapes are fitted to the mean of these.

    Returns
    -------
    ndarray, shape (N, 4, 4)
        File coordinates to the common frame. Without fixed shapes the samples' mean is centred; with similarities
        the shapes' normalised sizes have a geometric mean of 1.
    """
    units = np.array([item.scale for item in samples])
    posed = np.stack([item.positions @ r.T for item, r in zip(samples, rotations, strict=True)])
    factors, centre = np.ones(len(samples)), np.zeros(3)
    if fixed:
        factors, centre = _fit_to_fixed(samples, in_label_order(posed, labels), labels, fixed)
    elif scaling == "similarity":
        factors = common_scales(in_label_order(posed, labels))
    if scaling == "rigid":
        factors = units
    shifts = np.tile(centre, (len(samples), 1)) if fixed else -factors[:, None] * posed.mean(axis=1)
    transforms = np.tile(np.eye(4), (len(samples), 1, 1))
    for i, item in enumerate(samples):
        transforms[i, :3, :3] = factors[i] / item.scale * rotations[i]
        transforms[i, :3, 3] = shifts[i] - transforms[i, :3, :3] @ item.offset
    for i, transform in (fixed or {}).items():
        transforms[i] = transform
    return transforms


def common_scales(configurations: FloatArray) -> FloatArray:
    """Return the scales of generalised Procrustes analysis at given rotations, shape (N,), of geometric mean 1.

    Each shape fits the mean of all best: they are the leading eigenvector of ten Berge, Orthogonal Procrustes
    rotation for two or more matrices, Psychometrika 42 (1977), found by way of the mean.

    Parameters
    ----------
    configurations : ndarray, shape (N, k, 3)
        In the order of their labels, and turned to the common frame.
    """
    flat = (configurations - configurations.mean(axis=1, keepdims=True)).reshape(
        len(configurations), -1
    )
    sizes = np.maximum((flat**2).sum(axis=1), 1e-300)
    mean = np.linalg.eigh((flat.T / sizes) @ flat)[1][:, -1]
    scales = flat @ mean / sizes
    scales = np.maximum(scales * np.sign(scales.sum()), 1e-12)
    return np.asarray(scales / np.exp(np.log(scales).mean()))


def _fit_to_fixed(
    samples: Sequence[Samples], posed: FloatArray, labels: IntArray, fixed: Mapping[int, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the scales that fit every shape to the mean of the fixed ones, and the centre of that mean."""
    still = []
    for i, transform in fixed.items():
        raw = samples[i].positions * samples[i].scale + samples[i].offset
        still.append(in_label_order(moved_by(transform, raw)[None], labels[i][None])[0])
    mean = np.mean(still, axis=0)
    centre = mean.mean(axis=0)
    return ((posed * (mean - centre)).sum(axis=(1, 2)) / (posed**2).sum(axis=(1, 2))), centre


def common_positions(samples: Sequence[Samples], transforms: FloatArray) -> FloatArray:
    """Return the samples in the common frame, shape (N, k, 3)."""
    return np.stack(
        [
            moved_by(transform, item.positions * item.scale + item.offset)
            for item, transform in zip(samples, transforms, strict=True)
        ]
    )
