"""How much two surfaces explain of each other at a pose: overlap, mismatch of descriptors, share of matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np

from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.checks import check_choice
from data_tools.local_surface import MOST_COMPARED, LocalSurface
from data_tools.poses import Similarity
from data_tools.threads import one_blas_thread
from pairwise.features.depth_images import TUNED, conflict, extent_poses, sight_conflicts
from pairwise.features.poses import (
    FIRST_STEPS,
    LAST_STEPS,
    SAME_CELLS,
    consensus_poses,
    feature_distances,
    match_features,
    poses_apart,
    refine_on_planes,
)

#: A point has a partner if a point of the other surface is within so many cells, ...
PARTNER_CELLS = 1.2
#: ... and the cosine between both normals is above this.
PARTNER_COSINE = 0.7
#: Descriptors are compared at closest points that are within so many cells, twice the reach of a partner.
COMPARED_CELLS = 2.4
#: Descriptors of which any two differ by less than this, usually, are all alike, as on a sphere (.001).
LEAST_USUAL = 0.02
#: How much a conflict counts beside overlap where both are known. The other number is added to the share of
#: consistent matches there, of which views from different sides have none.
CONFLICT_POWER, UNMATCHED = 4.0, 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalPoses:
    """Rigid poses of a source on a target and the local evidence of each.

    Attributes
    ----------
    rotations : ndarray, shape (p, 3, 3)
        ``R_target_source``, orthogonal.
    shifts : ndarray, shape (p, 3)
        ``x -> rotation x + shift`` takes the source to the target.
    overlaps : ndarray, shape (p, 2)
        Share of the target's and of the source's points with a partner: a point of the other surface within 1.2
        cells whose normal agrees.
    mismatch : ndarray, shape (p,)
        Mean distance of the descriptors at closest points, as a share of the median distance of any two; points
        without a closest point count as 1.
    consensus : ndarray, shape (p,)
        Share of the matched descriptors that lie within 1.5 cells of each other.
    in_front : ndarray, shape (p, 2)
        Share of the target's and of the source's points that lie in front of the other surface, where what saw that
        one would have seen them instead; NaN where no single direction saw all of the other surface.
    beside : ndarray, shape (p, 2)
        The same of those that lie where it saw nothing.
    """

    rotations: Annotated[FloatArray, Holds(shape="p 3 3", rotations=True)]
    shifts: Annotated[FloatArray, Holds(shape="p 3")]
    overlaps: Annotated[FloatArray, Holds(shape="p 2")]
    mismatch: Annotated[FloatArray, Holds(shape="p")]
    consensus: Annotated[FloatArray, Holds(shape="p")]
    in_front: Annotated[FloatArray, Holds(shape="p 2", nan=True)]
    beside: Annotated[FloatArray, Holds(shape="p 2", nan=True)]

    @property
    def overlap(self) -> FloatArray:
        """Geometric mean of both overlaps, shape (p,)."""
        return np.asarray(np.sqrt(self.overlaps.prod(axis=1)))

    @classmethod
    def joined(cls, several: Sequence[LocalPoses]) -> LocalPoses:
        """Return the poses of several in one."""
        arrays = {
            one.name: read_only(np.concatenate([getattr(poses, one.name) for poses in several]))
            for one in fields(cls)
        }
        return cls(**arrays)

    def inverse(self) -> LocalPoses:
        """Return the poses of the target on the source."""
        rotations = np.swapaxes(self.rotations, 1, 2)
        return LocalPoses(
            rotations=read_only(rotations),
            shifts=read_only(-(rotations @ self.shifts[:, :, None])[:, :, 0]),
            overlaps=self.overlaps[:, ::-1],
            mismatch=self.mismatch,
            consensus=self.consensus,
            in_front=self.in_front[:, ::-1],
            beside=self.beside[:, ::-1],
        )

    def __len__(self) -> int:
        return len(self.shifts)

    def __getitem__(self, which: IntArray | list[int] | slice) -> LocalPoses:
        """Return some of the poses."""
        return LocalPoses(
            rotations=self.rotations[which],
            shifts=self.shifts[which],
            overlaps=self.overlaps[which],
            mismatch=self.mismatch[which],
            consensus=self.consensus[which],
            in_front=self.in_front[which],
            beside=self.beside[which],
        )


@one_blas_thread()
def evaluate_poses(
    target: LocalSurface,
    source: LocalSurface,
    rotations: FloatArray,
    shifts: FloatArray,
    *,
    matches: tuple[IntArray, IntArray] | None = None,
    num_points: int = MOST_COMPARED,
) -> LocalPoses:
    """Return what descriptors and overlap say of rigid poses, rotations (p, 3, 3) of either determinant.

    Parameters
    ----------
    target, source : LocalSurface
        In one unit of length.
    rotations : ndarray, shape (p, 3, 3)
    shifts : ndarray, shape (p, 3)
        Source coordinates to those of the target, with the rotations.
    matches : pair of ndarray of int, each (m,), optional
        What :func:`pairwise.features.poses.match_features` says of both, if that is known; not for mirror images.
    num_points : int
        Points of either surface that are compared, at most.

    Returns
    -------
    LocalPoses
        In the same order.

    Examples
    --------
    >>> directions = np.random.default_rng(0).normal(size=(500, 3)) * [1.0, 0.7, 0.5]
    >>> normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    >>> surface = pairwise.LocalSurface.from_user(normals, normals, cell=0.15)
    >>> found = pairwise.evaluate_poses(surface, surface, np.eye(3)[None], np.zeros((1, 3)))
    >>> float(found.overlap[0])
    1.0
    """
    proper = np.linalg.det(rotations) > 0
    evidence = np.empty((len(rotations), 8))
    for flip in (1.0, -1.0):
        chosen = np.flatnonzero(proper == (flip > 0))
        if len(chosen):
            other = source if flip > 0 else source.mirrored
            of_pair = matches or match_features(feature_distances(target.features, other.features))
            poses = Similarity.rigid(rotations[chosen] * [flip, 1.0, 1.0], shifts[chosen])
            evidence[chosen] = _evidence(target, other, poses, of_pair, num_points=num_points)
    return _local_poses(rotations, shifts, evidence)


@one_blas_thread()
def match_overlapping(
    target: LocalSurface, source: LocalSurface, *, group: str = "SO", num_candidates: int = 8
) -> LocalPoses:
    """Return distinct rigid poses on which neighbourhoods of two surfaces agree, the most overlap first.

    Parameters
    ----------
    target, source : LocalSurface
        In one unit of length, with cells of about the same size.
    group : {"SO", "O"}
        O looks among mirror images as well.
    num_candidates : int
        At most so many poses.

    Returns
    -------
    LocalPoses

    Raises
    ------
    OptionsError
        If the group is unknown.

    Examples
    --------
    A hilly landscape, of which both surfaces see two thirds, the second one after a quarter rotation about z:

    >>> import numpy as np
    >>> import pairwise
    >>> x, y = np.mgrid[0.0:30.0, 0.0:30.0].reshape(2, -1)
    >>> z = 3.0 * np.sin(0.3 * x + 0.01 * y * y) + 2.0 * np.cos(0.5 * y)
    >>> slope_x = 0.9 * np.cos(0.3 * x + 0.01 * y * y)
    >>> slope_y = 0.06 * y * np.cos(0.3 * x + 0.01 * y * y) - np.sin(0.5 * y)
    >>> normals = np.stack([-slope_x, -slope_y, np.ones(900)], axis=1)
    >>> points, normals = np.stack([x, y, z], axis=1), normals / np.linalg.norm(normals, axis=1, keepdims=True)
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> target = pairwise.LocalSurface.from_user(points[x < 20], normals[x < 20], 1.0)
    >>> source = pairwise.LocalSurface.from_user(points[x >= 10] @ quarter, normals[x >= 10] @ quarter, 1.0)
    >>> found = pairwise.match_overlapping(target, source)
    >>> bool(np.allclose(found.rotations[0], quarter, atol=0.01)), found.overlaps[0].round(1).tolist()
    (True, [0.5, 0.5])
    """
    check_choice("group", group, ("SO", "O"))
    cell = max(target.cell, source.cell)
    rotations, shifts, evidence = [], [], []
    for flip in (1.0,) if group == "SO" else (1.0, -1.0):
        other = source if flip > 0 else source.mirrored
        matches = match_features(feature_distances(target.features, other.features))
        starts = zip(
            consensus_poses(target, other, matches, num_candidates),
            extent_poses(target, other, TUNED.num_proposed),
            strict=True,
        )
        poses = Similarity.rigid(*map(np.concatenate, starts))
        cutoffs: tuple[float, ...] = FIRST_STEPS + LAST_STEPS
        if len(poses) > (num_kept := TUNED.num_kept * num_candidates):
            few = TUNED.num_points
            poses = refine_on_planes(target, other, poses, cutoffs=FIRST_STEPS, num_points=few)
            rough = _evidence(target, other, poses, matches, num_points=few)
            score = _score(_local_poses(poses.rotation, poses.shift, rough))
            poses = poses[np.argsort(-score, kind="stable")[:num_kept]]
            cutoffs = LAST_STEPS
        poses = refine_on_planes(target, other, poses, cutoffs=cutoffs)
        rotations.append(poses.rotation * [flip, 1.0, 1.0])
        shifts.append(poses.shift)
        evidence.append(_evidence(target, other, poses, matches))
    found = _local_poses(
        np.concatenate(rotations), np.concatenate(shifts), np.concatenate(evidence)
    )
    score = _score(found)
    return found[poses_apart(found.rotations, found.shifts, score, source, cell, num_candidates)]


def _score(poses: LocalPoses) -> FloatArray:
    """Return by which poses a search keeps, shape (p,): where lines of sight are known, matches need not agree."""
    is_seen = ~np.isnan(poses.in_front).any(axis=1)
    conflicts = conflict(poses.in_front, poses.beside) * np.where(is_seen, CONFLICT_POWER, 1.0)
    matched = poses.consensus + np.where(is_seen, UNMATCHED, 0.0)
    return np.asarray(poses.overlap * matched * np.exp(-conflicts))


def _evidence(
    target: LocalSurface,
    source: LocalSurface,
    poses: Similarity,
    matches: tuple[IntArray, IntArray],
    *,
    num_points: int = MOST_COMPARED,
) -> FloatArray:
    """Return the columns of :func:`_local_poses` of rigid poses of determinant 1, shape (p, 8)."""
    cell = max(target.cell, source.cell)
    ends = target, source, poses.rotation, poses.shift
    to, of = matches
    overlaps, mismatches = closeness(*ends, num_points=num_points)
    gaps = poses.apply(source.points[of]) - target.points[to]
    consensus = ((gaps * gaps).sum(axis=2) < (SAME_CELLS * cell) ** 2).mean(axis=1)
    return np.column_stack(
        [
            overlaps,
            mismatches.mean(axis=1),
            consensus,
            *sight_conflicts(*ends, num_points=num_points),
        ]
    )


def _local_poses(rotations: FloatArray, shifts: FloatArray, evidence: FloatArray) -> LocalPoses:
    """Return poses with overlaps, mismatch, consensus, and shares in front and beside, shape (p, 8)."""
    return LocalPoses(
        rotations=read_only(rotations),
        shifts=read_only(shifts),
        overlaps=read_only(evidence[:, :2]),
        mismatch=read_only(evidence[:, 2]),
        consensus=read_only(evidence[:, 3]),
        in_front=read_only(evidence[:, 4:6]),
        beside=read_only(evidence[:, 6:]),
    )


@one_blas_thread()
def closeness(
    target: LocalSurface,
    source: LocalSurface,
    rotations: FloatArray,
    shifts: FloatArray,
    *,
    num_points: int = MOST_COMPARED,
) -> tuple[FloatArray, FloatArray]:
    """Return the overlaps (p, 2) of poses of determinant 1, as :class:`LocalPoses` has them, and mismatches (p, 2).

    The first mismatch is that of the target's points, the second that of the source's.

    Parameters
    ----------
    target, source : LocalSurface
        In one unit of length.
    rotations : ndarray, shape (p, 3, 3)
    shifts : ndarray, shape (p, 3)
    num_points : int
        Points of either surface that are compared, at most.
    """
    from pairwise.features.partners import nearest_facing

    cell = max(target.cell, source.cell)
    on_target, on_source = target.few(num_points), source.few(num_points)
    ends = target.features[on_target], source.features[on_source]
    usual = max(float(np.median(feature_distances(*ends))), LEAST_USUAL)
    inverses = np.swapaxes(rotations, 1, 2)
    backwards = -(inverses @ shifts[:, :, None])[:, :, 0]
    sides = (
        (source, target.points[on_target], target.normals[on_target], inverses, backwards),
        (target, source.points[on_source], source.normals[on_source], rotations, shifts),
    )
    overlaps, costs = np.empty((2, len(rotations), 2))
    for side, (others, points, normals, matrices, moves) in enumerate(sides):
        back = np.swapaxes(matrices, 1, 2)
        placed = points @ back + moves[:, None]
        found = nearest_facing(
            others,
            (placed.reshape(-1, 3), (normals @ back).reshape(-1, 3)),
            reach=COMPARED_CELLS * cell,
            cosine=PARTNER_COSINE,
        )
        squares, nearest = (one.reshape(placed.shape[:2]) for one in found)
        products = np.einsum("lf,plf->pl", ends[side], others.features[nearest])
        overlaps[:, side] = (squares < (PARTNER_CELLS * cell) ** 2).mean(axis=1)
        costs[:, side] = np.where(np.isfinite(squares), (2.0 - 2.0 * products) / usual, 1.0).mean(
            axis=1
        )
    return overlaps, costs
