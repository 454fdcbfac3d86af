"""Dense samples of two shapes matched at a pose: nearest neighbours both ways."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_floats, as_points, read_only
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
    invariants : ndarray, shape (l, m)
        Coordinates that no rotation changes, in units of the points; m may be 0.
    """

    points: FloatArray
    normals: FloatArray | None
    invariants: FloatArray

    @classmethod
    def from_user(
        cls, points: ArrayLike, normals: ArrayLike | None = None, invariants: ArrayLike | None = None
    ) -> DensePoints:
        """Check the arrays.

        Raises
        ------
        InputError
            If they are not finite, of different shapes, or all points lie in one place.
        """
        checked = as_points(points, "points", min_points=2)
        if not np.ptp(checked, axis=0).any():
            raise InputError("points: all lie in one place")
        directions = None if normals is None else read_only(as_floats(normals, "normals", shape=checked.shape))
        scalars = np.empty((len(checked), 0)) if invariants is None else invariants
        return cls(
            read_only(checked), directions, read_only(as_floats(scalars, "invariants", shape=(len(checked), None)))
        )

    @cached_property
    def radius(self) -> float:
        """Root mean square distance from the centroid."""
        return float(np.sqrt(((self.points - self.points.mean(axis=0)) ** 2).sum(axis=1).mean()))


class DenseMatcher:
    """Matches the dense samples of two shapes at any pose.

    Parameters
    ----------
    target, source : DensePoints
    normal_weight : float
        Weight of the unit normals, in units of the target; 0 leaves them out.
    """

    def __init__(self, target: DensePoints, source: DensePoints, *, normal_weight: float = 0.0) -> None:
        self.target, self.source = target, source
        has_normals = target.normals is not None and source.normals is not None
        self._normal_weight = normal_weight if has_normals else 0.0
        self._target_features = np.hstack([target.points, *self._fixed_features(target)])
        ones = np.ones((len(target.points), 1))
        self._target_factor = np.hstack(
            [self._target_features, (self._target_features**2).sum(axis=1)[:, None], ones]
        )

    def mean_cost(self, pairs: tuple[IntArray, IntArray], pose: Similarity) -> float:
        """Return the mean over the pairs of squared distance of points and of invariants; normals are left out."""
        of_target, of_source = pairs
        gaps = self.target.points[of_target] - pose.apply(self.source.points[of_source])
        other = self.target.invariants[of_target] - self.source.invariants[of_source]
        return float(((gaps**2).sum() + (other**2).sum()) / len(gaps))

    def _fixed_features(self, shape: DensePoints, turn: FloatArray | None = None) -> list[FloatArray]:
        if not self._normal_weight or shape.normals is None:
            return [shape.invariants]
        normals = shape.normals if turn is None else shape.normals @ turn.T
        return [shape.invariants, self._normal_weight * normals]

    def pair_up(self, pose: Similarity) -> tuple[IntArray, IntArray]:
        """Return indices on target and source of nearest neighbours both ways at a pose, in slabs of the source."""
        features = np.hstack([pose.apply(self.source.points), *self._fixed_features(self.source, pose.rotation)])
        num_target, num_source = len(self._target_factor), len(features)
        factor = _cost_factor(features)
        slab = max(1, _CHUNK_ENTRIES // num_target)
        least = np.full(num_target, np.inf)
        back = np.zeros(num_target, dtype=np.int64)
        there = np.empty(num_source, dtype=np.int64)
        for first in range(0, num_source, slab):
            part = factor[first : first + slab]
            # A second product, since minima along rows are many times faster than along columns.
            there[first : first + slab] = (part @ self._target_factor.T).argmin(axis=1)
            costs = self._target_factor @ part.T
            nearest = costs.argmin(axis=1)
            values = costs[np.arange(num_target), nearest]
            better = values < least
            least[better], back[better] = values[better], nearest[better] + first
        return np.concatenate([there, np.arange(num_target)]), np.concatenate([np.arange(num_source), back])


def _cost_factor(features: FloatArray) -> FloatArray:
    """Return the rows whose products with (t, |t|^2, 1) are the squared distances |t - f|^2."""
    return np.hstack([-2.0 * features, np.ones((len(features), 1)), (features**2).sum(axis=1)[:, None]])
