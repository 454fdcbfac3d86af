"""The Procrustes matching problem as data: what is matched to what, at which cost, with which R.

    minimise  E(R, map) = sum_j w_j |R p_j - q_map(j)|^2 + sum_j c[map(j), j]

over R in the group with the given pattern and injective maps inside the candidates (Maron et al. 2016, eq. 1-2).
Points are rows here and everywhere else; the paper's d x n matrices P and Q are ``source.T`` and ``target.T``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from data_tools.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    as_mask,
    as_points,
    as_weights,
    read_only,
)
from data_tools.errors import InputError, OptionsError
from pairwise.pattern import PatternLike, RotationPattern


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A checked Procrustes matching problem; build it with :meth:`from_user`.

    Attributes
    ----------
    target : ndarray, shape (n, d)
        The points q_i.
    source : ndarray, shape (k, d)
        The points p_j, k <= n.
    pattern : RotationPattern
        The sparsity of R and its rotation blocks.
    candidates : ndarray of bool, shape (n, k)
        Whether source point j may go to target point i.
    weights : ndarray, shape (k,)
        w_j, non-negative.
    constant_cost : ndarray, shape (n, k)
        c_ij, what a match costs whatever R is (weighted squared differences of invariants).
    """

    target: FloatArray
    source: FloatArray
    pattern: RotationPattern
    candidates: BoolArray
    weights: FloatArray
    constant_cost: FloatArray

    @classmethod
    def from_user(
        cls,
        target: ArrayLike,
        source: ArrayLike,
        *,
        group: str = "SO",
        candidates: ArrayLike | None = None,
        rotation_pattern: PatternLike = None,
        invariants: tuple[ArrayLike, ArrayLike] | None = None,
        weights: ArrayLike | None = None,
    ) -> Problem:
        """Check what callers give.

        Parameters
        ----------
        target, source : array_like, shapes (n, d) and (k, d)
            Points are rows; k <= n.
        group : {"SO", "O"}
            Rotations, or all orthogonal matrices.
        candidates : array_like of bool, shape (n, k), optional
            Which matches are allowed; all by default.
        rotation_pattern : optional
            See :meth:`RotationPattern.from_user`.
        invariants : pair of array_like, shapes (n, m) and (k, m), optional
            Rotation-invariant coordinates of both shapes: a block of the embedding whose R is the identity.
        weights : array_like, shape (k,), optional
            Weight of each source point.

        Raises
        ------
        InputError
            If shapes disagree, k > n, or no injective map lies inside the candidates.
        """
        q = as_points(target, "target")
        p = as_points(source, "source", dim=q.shape[1])
        n, k = len(q), len(p)
        if k > n:
            raise InputError(f"source has {k} points, target {n}: the map is injective, so k <= n; swap the two")
        w = as_weights(weights, "weights", num=k)
        pattern = RotationPattern.from_user(rotation_pattern, q.shape[1], group)
        allowed = np.ones((n, k), bool) if candidates is None else as_mask(candidates, "candidates", shape=(n, k))
        _check_feasible(allowed)
        constant = np.zeros((n, k)) if invariants is None else _invariant_cost(invariants, n, k)
        return cls(
            target=read_only(q),
            source=read_only(p),
            pattern=pattern,
            candidates=read_only(allowed),
            weights=read_only(w),
            constant_cost=read_only(constant * w),
        )

    @property
    def num_target(self) -> int:
        """Number n of target points."""
        return len(self.target)

    @property
    def num_source(self) -> int:
        """Number k of source points."""
        return len(self.source)

    @property
    def dim(self) -> int:
        """Dimension d of the points."""
        return self.target.shape[1]

    def assignment_costs(self, rotations: FloatArray) -> FloatArray:
        """Return the cost of every match at the given rotations, shape (..., n, k).

        Matches outside the candidates cost ``inf``. Entries are ``w_j |R p_j - q_i|^2 + c_ij``.
        """
        moved = self.source @ np.swapaxes(rotations, -1, -2)
        cross = self.target @ np.swapaxes(moved, -1, -2)
        squares = (self.target**2).sum(axis=1)[:, None] + (self.source**2).sum(axis=1)
        costs = np.maximum(squares - 2.0 * cross, 0.0) * self.weights + self.constant_cost
        return np.where(self.candidates, costs, np.inf)

    def energy(self, rotation: FloatArray, point_map: IntArray) -> float:
        """Return E(R, map), computed from the differences themselves.

        Parameters
        ----------
        rotation : ndarray, shape (d, d)
        point_map : ndarray of int, shape (k,)
            Index on the target of each source point.
        """
        residuals = self.source @ rotation.T - self.target[point_map]
        constant = self.constant_cost[point_map, np.arange(self.num_source)]
        return float((self.weights * (residuals**2).sum(axis=1)).sum() + constant.sum())

    def procrustes(self, point_map: IntArray) -> FloatArray:
        """Return the best R for a map, shape (d, d): orthogonal Procrustes within the pattern's blocks."""
        return self.pattern.project(self.target[point_map].T @ (self.weights[:, None] * self.source))


def _invariant_cost(invariants: tuple[ArrayLike, ArrayLike], n: int, k: int) -> FloatArray:
    if not isinstance(invariants, tuple | list) or len(invariants) != 2:
        raise OptionsError("invariants: expected a pair (target, source) of arrays (n, m) and (k, m)")
    h = as_floats(invariants[0], "invariants of the target", shape=(n, None))
    g = as_floats(invariants[1], "invariants of the source", shape=(k, h.shape[1]))
    return ((h[:, None, :] - g[None, :, :]) ** 2).sum(axis=2)


def _check_feasible(allowed: BoolArray) -> None:
    empty = np.flatnonzero(~allowed.any(axis=0))
    if len(empty):
        raise InputError(f"candidates: source point {empty[0]} has none ({len(empty)} such points)")
    matched: Any = maximum_bipartite_matching(csr_array(allowed), perm_type="row")
    if (matched < 0).any():
        stuck = int((matched < 0).sum())
        raise InputError(f"candidates: no injective map fits them, {stuck} source points are always left over")
