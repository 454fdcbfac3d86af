"""Dense samples of surfaces, and which points of two of them are nearest to each other at a pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_floats, as_points, as_rotations, read_only
from data_tools.errors import InputError
from data_tools.poses import Similarity

#: Entries of the cost matrix that nearest neighbours hold at once.
_CHUNK_ENTRIES = 1_000_000


@dataclass(frozen=True, eq=False)
class DensePoints:
    """The dense samples of one shape, prepared once for many pairs; build it with :meth:`from_user`.

    Attributes
    ----------
    points : ndarray, shape (l, d)
    normals : ndarray, shape (l, d), or None
        Of unit length; None where the shape has no surface.
    """

    points: FloatArray
    normals: FloatArray | None

    @classmethod
    def from_user(cls, points: ArrayLike, normals: ArrayLike | None = None) -> DensePoints:
        """Check points (n, d) and their normals (n, d).

        Raises
        ------
        InputError
            If they are not finite, of different shapes, or all points lie in one place.
        """
        checked = as_points(points, "points", min_points=2)
        if not np.ptp(checked, axis=0).any():
            raise InputError("points: all lie in one place")
        directions = (
            None
            if normals is None
            else read_only(as_floats(normals, "normals", shape=checked.shape))
        )
        return cls(read_only(checked), directions)

    @cached_property
    def radius(self) -> float:
        """Root mean square distance from the centroid."""
        return float(np.sqrt(((self.points - self.points.mean(axis=0)) ** 2).sum(axis=1).mean()))

    @cached_property
    def spacing(self) -> float:
        """Root mean square distance of a point from the nearest one at another place."""
        places = np.unique(self.points, axis=0)
        nearest = scipy.spatial.cKDTree(places).query(places, k=2)[0][:, 1]
        return float(np.sqrt((nearest**2).mean()))


class DenseMatcher:
    """Matches the dense samples of two shapes at any pose.

    Parameters
    ----------
    target, source : DensePoints
    normal_weight : float
        Weight of the unit normals, in units of the target; 0 leaves them out.
    """

    def __init__(
        self, target: DensePoints, source: DensePoints, *, normal_weight: float = 0.0
    ) -> None:
        self.target, self.source = target, source
        has_normals = target.normals is not None and source.normals is not None
        self._normal_weight = normal_weight if has_normals else 0.0
        dim = target.points.shape[1]
        still = Similarity(rotation=np.eye(dim), scale=1.0, shift=np.zeros(dim))
        self._target, self._source = self._columns(target, still), self._columns(source, still)
        self._from_target = _squared_from(self._target)
        self._there, self._back = _Nearest(len(source.points)), _Nearest(len(target.points))

    def mean_cost(self, pairs: tuple[IntArray, IntArray], pose: Similarity) -> float:
        """Return the mean over pairs of squared distances of points; normals are left out.

        Parameters
        ----------
        pairs : tuple of ndarray of int, shape (p,) each
            Indices on target and source.
        pose : Similarity
            Takes the source to the target.
        """
        of_target, of_source = pairs
        gaps = self.target.points[of_target] - pose.apply(self.source.points[of_source])
        return float((gaps**2).sum() / len(gaps))

    def _columns(self, shape: DensePoints, pose: Similarity) -> FloatArray:
        """Return columns (f, 1) of what is compared at a pose: places and weighted normals."""
        features = [(pose.scale * pose.rotation) @ shape.points.T + pose.shift[:, None]]
        if self._normal_weight and shape.normals is not None:
            features.append((self._normal_weight * pose.rotation) @ shape.normals.T)
        return np.concatenate([*features, np.ones((1, len(shape.points)))])

    def pair_up(self, pose: Similarity) -> tuple[IntArray, IntArray]:
        """Return indices on target and source, shape (p,) each, of nearest neighbours both ways at a pose."""
        former, self._source = self._source, self._columns(self.source, pose)
        moved = np.sqrt(np.square(self._source - former).sum(axis=0))
        from_source = _squared_from(self._source)
        self._there.look(self._source, from_source[-1], self._from_target, 2.0 * moved)
        self._back.look(
            self._target, self._from_target[-1], from_source, moved[self._back.rows] + moved.max()
        )
        own = [np.arange(len(one.rows)) for one in (self._there, self._back)]
        return np.concatenate([self._there.rows, own[1]]), np.concatenate([own[0], self._back.rows])


def _squared_from(columns: FloatArray) -> FloatArray:
    """Return (-2 f, |f|^2) of columns (f, 1): their products with (t, 1) are |t - f|^2 - |t|^2."""
    doubled = -2.0 * columns
    np.einsum("kl,kl->l", columns[:-1], columns[:-1], out=doubled[-1])
    return doubled


class _Nearest:
    """The nearest one of others to each of some features, while these move: looked for where it may have changed.

    It has not while its lead over the second nearest is more than what both have moved since (Hamerly 2010).
    """

    def __init__(self, num: int) -> None:
        self.rows, self._leads = np.zeros(num, dtype=np.int64), np.full(num, -np.inf)

    def look(
        self, own: FloatArray, sizes: FloatArray, others: FloatArray, moved: FloatArray
    ) -> None:
        """Find what is nearest, in slabs; no lead has shrunk by more than ``moved``, ``sizes`` are |own|^2."""
        self._leads -= moved
        unsure, slab = np.flatnonzero(self._leads <= 0.0), max(1, _CHUNK_ENTRIES // others.shape[1])
        rounding = (
            4.0 * np.finfo(float).eps * (len(own) + 1) * float(sizes.max() + others[-1].max())
        )
        for first in range(0, len(unsure), slab):
            rows = unsure[first : first + slab]
            costs, each = own.take(rows, axis=1).T @ others, np.arange(len(rows))
            self.rows[rows] = nearest = costs.argmin(axis=1)
            least = np.maximum(costs[each, nearest] + sizes[rows], 0.0)
            costs[each, nearest] = np.inf
            second = np.maximum(costs.min(axis=1) + sizes[rows] - rounding, 0.0)
            self._leads[rows] = np.sqrt(second) - np.sqrt(least + rounding)


def centred_pose(
    target: DensePoints, source: DensePoints, R_target_source: ArrayLike, *, estimate_scale: bool
) -> Similarity:
    """Return the checked rotation with centroids, and sizes where the scale is free, brought together.

    Raises
    ------
    InputError
        If the rotation is none, or the shapes' arrays do not fit each other.
    """
    dim = target.points.shape[1]
    if source.points.shape[1] != dim:
        raise InputError(
            f"source: expected {dim} coordinates as the target has, got {source.points.shape[1]}"
        )
    rotation = as_rotations(R_target_source, "R_target_source", dim=dim)
    scale = target.radius / source.radius if estimate_scale else 1.0
    shift = target.points.mean(axis=0) - scale * rotation @ source.points.mean(axis=0)
    return Similarity(rotation=rotation, scale=scale, shift=shift)
