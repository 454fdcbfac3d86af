"""Poses of two depth images: those on which both agree how far the object reaches, and what contradicts a pose.

What contradicts a pose are points where what saw the other surface would have seen them.

What is outermost in a direction is seen from everywhere on that side: nothing can hide it. So a depth image knows the
support function of the whole object, h(d) = max x.d, for all directions d towards what saw it. At the right pose
(R, t) of a source on a target, h_target(d) = h_source(R^T d) + t.d for all directions that face both. The shift
follows by least squares for any rotation, and what is left over says which rotations are possible.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from data_tools.arrays import FloatArray
from data_tools.local_surface import MOST_COMPARED, LocalSurface
from data_tools.rotations import half_sphere
from pairwise.rotation_sets import rotation_set

#: Unit of shares of points in front of what was seen or beside it. At right poses they are mostly below it.
#: Larger shares of points beside what was seen than the second tell no more: a scanner may have missed a part.
FRONT_UNIT, MOST_BESIDE = 0.01, 0.05


class ExtentTuning(NamedTuple):
    """Numbers of the search for poses of depth images by their extents.

    Of views of a person, a bird, a chair, a teddy and an armadillo, 24 to 120 degrees apart, 93 to 100 % have a start
    within 20 degrees among the 100 of the least residuals.
    """

    num_rotations: int = 3000
    """Rotations that are tried, some 15 degrees apart."""
    num_directions: tuple[int, int] = (200, 1500)
    """Directions of a half sphere in which extents of the target and of the source are compared and looked up."""
    num_cells: int = 32
    """Cells along a side of the cube by which a direction is looked up."""
    facing: float = 0.1
    """A direction faces what saw a surface from this cosine."""
    least_shared: float = 0.08
    """Share of all directions that must face both."""
    num_compared: int = 100
    """Poses whose conflicts with lines of sight are looked at, ..."""
    num_points: int = 200
    """... by so many points of each surface."""
    residual_weight: float = 2.0
    """Of what is left over, in parts of the median of these poses, beside conflicts."""
    num_proposed: int = 24
    """Poses that are proposed, refined on as few points, ..."""
    num_kept: int = 2
    """... and of which so many for each wanted one are refined on all points. Of 288 pairs of views, scans of a bunny
    among them, the first pose is right as often as where all are."""


#: The numbers in use.
TUNED = ExtentTuning()


class _Directions(NamedTuple):
    """Rotations (r, 3, 3), directions (m, 3), finer ones (f, 3), and which of these each is in the source (r, m)."""

    rotations: FloatArray
    coarse: FloatArray
    fine: FloatArray
    in_source: NDArray[np.int16]


@lru_cache(maxsize=1)
def _directions() -> _Directions:
    """Return what all pairs have in common, made once a process."""
    coarse, fine = (
        np.concatenate([half, -half]) for half in map(half_sphere, TUNED.num_directions)
    )
    steps = (np.arange(TUNED.num_cells) + 0.5) * 2.0 / TUNED.num_cells - 1.0
    cube = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    nearest = scipy.spatial.cKDTree(fine).query(cube)[1].astype(np.int16)
    rotations = rotation_set(3, TUNED.num_rotations)
    cells = np.floor((coarse @ rotations + 1.0) * (0.5 * TUNED.num_cells)).astype(np.int64)
    cells = np.clip(cells, 0, TUNED.num_cells - 1)
    return _Directions(
        rotations, coarse, fine, nearest[cells[..., 0], cells[..., 1], cells[..., 2]]
    )


def extent_poses(
    target: LocalSurface, source: LocalSurface, num: int
) -> tuple[FloatArray, FloatArray]:
    """Return rigid poses on which extents of two depth images agree, rotations (p, 3, 3) and shifts (p, 3).

    None where a surface was not seen from one direction.

    Parameters
    ----------
    target, source : LocalSurface
        In one unit of length.
    num : int
        At most so many poses: those of the least residuals and conflicts with lines of sight.
    """
    if not (len(target.sights) and len(source.sights)):
        return np.empty((0, 3, 3)), np.empty((0, 3))
    tables = _directions()
    centres = target.points.mean(axis=0), source.points.mean(axis=0)
    faces_target = np.flatnonzero(tables.coarse @ target.sights[0] > TUNED.facing)
    faces_source = tables.fine @ source.sights[0] > TUNED.facing
    directions = tables.coarse[faces_target]
    looked_up = tables.in_source.take(faces_target, axis=1)
    is_shared = faces_source.take(looked_up)
    enough = np.flatnonzero(is_shared.sum(axis=1) >= TUNED.least_shared * len(tables.coarse))
    reach, reach_source = (
        (ways.astype(np.float32) @ (surface.points - centre).T.astype(np.float32)).max(axis=1)
        for ways, surface, centre in zip(
            (directions, tables.fine), (target, source), centres, strict=True
        )
    )
    gaps = reach - reach_source.take(looked_up[enough])
    shifts, residuals = _fitted(directions, gaps, is_shared[enough].astype(np.float32))
    order = np.argsort(residuals, kind="stable")[: TUNED.num_compared]
    rotations, residuals = tables.rotations[enough[order]], residuals[order]
    shifts = shifts[order] + centres[0] - rotations @ centres[1]
    conflicts = conflict(
        *sight_conflicts(target, source, rotations, shifts, num_points=TUNED.num_points)
    )
    usual = max(float(np.median(residuals)) if len(residuals) else 0.0, np.finfo(float).tiny)
    best = np.argsort(conflicts + TUNED.residual_weight * residuals / usual, kind="stable")[:num]
    return rotations[best], shifts[best]


def _fitted(
    directions: FloatArray, gaps: NDArray[np.float32], shared: NDArray[np.float32]
) -> tuple[FloatArray, FloatArray]:
    """Return the shifts (r, 3) that explain gaps (r, m) along directions (m, 3) best, and the mean residuals (r,).

    Least squares, once more with Cauchy's weights: what a scan lacks shortens its extent in some directions. Those
    of which both surfaces know their extent are ``shared`` (r, m), 0 or 1.
    """
    along = directions.astype(np.float32)
    products = (along[:, :, None] * along[:, None]).reshape(-1, 9)
    weights, counts = shared, np.maximum(shared.sum(axis=1), 1.0)
    for _ in range(2):
        moments = (weights @ products).reshape(-1, 3, 3) + 1e-6 * np.eye(3)
        slopes = (weights * gaps) @ directions
        shifts = np.asarray(np.linalg.solve(moments, slopes[:, :, None])[:, :, 0], dtype=np.float64)
        residuals = np.abs(gaps - shifts.astype(np.float32) @ along.T)
        squares = residuals * residuals
        spread = np.maximum((shared * squares).sum(axis=1) / counts, np.finfo(np.float32).tiny)
        weights = shared / (1.0 + squares / spread[:, None])
    return shifts, np.asarray((shared * residuals).sum(axis=1) / counts)


def sight_conflicts(
    target: LocalSurface,
    source: LocalSurface,
    rotations: FloatArray,
    shifts: FloatArray,
    *,
    num_points: int = MOST_COMPARED,
) -> tuple[FloatArray, FloatArray]:
    """Return the shares of points in front of what was seen of the other surface, and beside it, each (p, 2).

    Those of the target come first, along the possible line of sight that they contradict least. NaN where no single
    direction saw all of the other surface.

    Parameters
    ----------
    target, source : LocalSurface
    rotations : ndarray, shape (p, 3, 3)
        Of determinant 1.
    shifts : ndarray, shape (p, 3)
        Source coordinates to those of the target, with the rotations.
    num_points : int
        Points of either surface that are looked at, at most.
    """
    to, of = target.few(num_points), source.few(num_points)
    shares = np.full((2, len(rotations), 2), np.nan)
    inverses = np.swapaxes(rotations, 1, 2)
    for side, seen, points, normals in (
        (
            0,
            source,
            (target.points[to] - shifts[:, None]) @ rotations,
            target.normals[to] @ rotations,
        ),
        (
            1,
            target,
            source.points[of] @ inverses + shifts[:, None],
            source.normals[of] @ inverses,
        ),
    ):
        if seen.depth_images:
            possible = np.stack([image.conflicts(points, normals) for image in seen.depth_images])
            least = possible.sum(axis=2).argmin(axis=0)
            shares[:, :, side] = possible[least, np.arange(len(points))].T
    return shares[0], shares[1]


def conflict(in_front: FloatArray, beside: FloatArray) -> FloatArray:
    """Return how shares (p, 2) in front of what was seen and beside it contradict poses, at least 0, shape (p,)."""
    front = np.nan_to_num(in_front.max(axis=1, initial=0.0))
    return np.asarray(
        np.log1p(front / FRONT_UNIT)
        + np.log1p(
            np.minimum(np.nan_to_num(beside.max(axis=1, initial=0.0)), MOST_BESIDE) / FRONT_UNIT
        )
    )
