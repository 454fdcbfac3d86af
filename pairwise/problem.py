"""The Procrustes matching problem as data: what is matched to what, at which cost, with which R.

    minimise  E(R, map) = sum_j w_j |R p_j - q_map(j)|^2 + sum_j c[map(j), j]

over R in the group with the given pattern and allowed injective maps (Maron et al. 2016, eq. 1-2).
Points are rows here and everywhere else; the paper's d x n matrices P and Q are ``source.T`` and ``target.T``.

A convex relaxation over a mask has an interior point only on this part, so the solvers prune the rest first.

Every source point gets a target of its own at the origin, which only this point can take and which costs the same in
every pose. So search, relaxation, branch and bound and certificates apply as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
import scipy
from numpy.typing import ArrayLike

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
from data_tools.checks import check_number
from data_tools.errors import InputError, OptionsError
from data_tools.threads import one_blas_thread
from pairwise.rotation_pattern import PatternLike, RotationPattern


def assignment_support(allowed: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Prune a mask to the matches that some feasible assignment uses.

    Alternating cycles through one feasible assignment: a match can occur iff its two ends lie in the same strongly
    connected component of the residual graph (Dulmage and Mendelsohn 1958), where one more node stands for "left
    free".

    Parameters
    ----------
    allowed : ndarray of bool, shape (n, k)
        Column j may go to row i. Every column must be assigned.

    Returns
    -------
    allowed : ndarray of bool, shape (n, k)
        Matches that occur in at least one feasible assignment.
    always_full : ndarray of bool, shape (n,)
        Rows that every feasible assignment fills.

    Raises
    ------
    InputError
        If no assignment fits.
    """
    n, k = allowed.shape
    matched = scipy.sparse.csgraph.maximum_bipartite_matching(
        scipy.sparse.csr_array(allowed), perm_type="row"
    ).astype(np.int64)
    if (matched < 0).any():
        raise InputError(
            f"allowed: no assignment fits them, {int((matched < 0).sum())} points are left over"
        )
    column_label, row_label, free_label = _residual_components(allowed, matched)
    usable = allowed & (row_label[:, None] == column_label[None, :])
    usable[matched, np.arange(k)] = True
    taken = np.zeros(n, dtype=bool)
    taken[matched] = True
    return usable, taken & (row_label != free_label)


def _residual_components(allowed: BoolArray, matched: IntArray) -> tuple[IntArray, IntArray, int]:
    """Return the strongly connected components of columns, rows and the node "free"."""
    n, k = allowed.shape
    free = k + n
    taken = np.zeros(n, dtype=bool)
    taken[matched] = True
    rows, cols = np.nonzero(allowed)
    tails = [cols, k + matched, k + np.flatnonzero(~taken), np.full(k, free)]
    heads = [k + rows, np.arange(k), np.full(int((~taken).sum()), free), k + matched]
    tail, head = np.concatenate(tails), np.concatenate(heads)
    graph = scipy.sparse.coo_array(
        (np.ones(len(tail)), (tail, head)), shape=(free + 1, free + 1)
    ).tocsr()
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=True, connection="strong")
    return labels[:k], labels[k:free], int(labels[free])


@one_blas_thread()
def with_unmatched(problem: Problem, cost: float) -> Problem:
    """Return the problem in which each source point may stay unmatched.

    Its energy is ``sum_j w_j |R p_j - q_map(j)|^2 + c`` over the matched points, plus ``w_j cost`` for every other
    one: robust matching with truncated squares. Bounds and certificates of it are bounds of this energy.

    Parameters
    ----------
    problem : Problem
        n target points and k source points.
    cost : float
        In squared units of the points: a point whose match would be further away than its root stays unmatched.

    Returns
    -------
    Problem
        Of n + k target points. The last k are at the origin; ``map[j] = n + j`` says that point j is unmatched.

    Raises
    ------
    OptionsError
        If the cost is not positive.

    Examples
    --------
    >>> target = np.random.default_rng(0).random((8, 3))
    >>> source = np.vstack([target[:5], [[9.0, 9.0, 9.0]]])
    >>> robust = pairwise.with_unmatched(pairwise.Problem.from_user(target, source), cost=0.01)
    >>> round(robust.energy(np.eye(3), np.array([0, 1, 2, 3, 4, 13])), 6)
    0.01
    """
    check_number("unmatched_cost", cost, positive=True)
    k, d = problem.source.shape
    free = problem.weights * (cost - (problem.source**2).sum(axis=1))
    return replace(
        problem,
        target=read_only(np.concatenate([problem.target, np.zeros((k, d))])),
        allowed=read_only(np.concatenate([problem.allowed, np.eye(k, dtype=bool)])),
        constant_cost=read_only(np.concatenate([problem.constant_cost, np.diag(free)])),
    )


def marked_unmatched(point_map: IntArray, num_target: int) -> IntArray:
    """Return a map (k,) of a problem with unmatched points, -1 where one is unmatched."""
    return read_only(np.where(point_map < num_target, point_map, -1))


#: The largest coordinate of a problem is at most this and at least its inverse: fourth powers must not overflow.
LARGEST_COORDINATE = 1e70
#: So few points of more coordinates each are taken for the columns of a (3, n) array.
MOST_COLUMN_DIM = 3
#: Energies below this share of the points' squared sizes are rounding errors.
ROUNDING_SHARE = 1e-9


class ProblemArguments(TypedDict, total=False):
    """What makes a problem in addition to the points: the other arguments of :meth:`Problem.from_user`."""

    group: str
    allowed: ArrayLike | None
    rotation_pattern: PatternLike
    invariants: tuple[ArrayLike, ArrayLike] | None
    weights: ArrayLike | None


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
    allowed : ndarray of bool, shape (n, k)
        Whether source point j may go to target point i.
    weights : ndarray, shape (k,)
        w_j, non-negative.
    constant_cost : ndarray, shape (n, k)
        c_ij, what a match costs whatever R is (weighted squared differences of invariants).
    """

    target: FloatArray
    source: FloatArray
    pattern: RotationPattern
    allowed: BoolArray
    weights: FloatArray
    constant_cost: FloatArray

    @classmethod
    def from_user(
        cls,
        target: ArrayLike,
        source: ArrayLike,
        *,
        group: str = "SO",
        allowed: ArrayLike | None = None,
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
        allowed : array_like of bool, shape (n, k), optional
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
            If coordinates or invariants are beyond :data:`LARGEST_COORDINATE`, coordinates all tiny, if shapes
            disagree, k > n, no injective map is allowed, or the points look like columns.
        """
        q = as_points(target, "target")
        p = as_points(source, "source", dim=q.shape[1])
        n, k = len(q), len(p)
        if q.shape[1] < 2:
            raise InputError(
                "target and source: points of one coordinate cannot be rotated; give two or more"
            )
        if rotation_pattern is None and max(n, k) <= MOST_COLUMN_DIM < q.shape[1]:
            raise InputError(
                f"target and source: {n} and {k} points of {q.shape[1]} coordinates. Points are rows: give target.T "
                f"and source.T. If they have so many coordinates, give rotation_pattern=({q.shape[1]},)"
            )
        largest = float(max(np.abs(q).max(), np.abs(p).max()))
        if largest and not 1.0 / LARGEST_COORDINATE <= largest <= LARGEST_COORDINATE:
            raise InputError(
                f"target and source: coordinates of up to {largest:.3g} are too large or too small to compute with. "
                f"Use a unit in which the largest is between {1 / LARGEST_COORDINATE:g} and {LARGEST_COORDINATE:g}"
            )
        if k > n:
            raise InputError(
                f"source has {k} points, target {n}: the map is injective, so k <= n; swap the two"
            )
        w = as_weights(weights, "weights", num=k)
        pattern = RotationPattern.from_user(rotation_pattern, q.shape[1], group)
        mask = (
            np.ones((n, k), bool) if allowed is None else as_mask(allowed, "allowed", shape=(n, k))
        )
        _check_feasible(mask)
        constant = np.zeros((n, k)) if invariants is None else _invariant_cost(invariants, n, k)
        return cls(
            target=read_only(q),
            source=read_only(p),
            pattern=pattern,
            allowed=read_only(mask),
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
    def rounding_energy(self) -> float:
        """Energies up to this are rounding errors, see :data:`ROUNDING_SHARE`."""
        size = (self.weights * (self.source**2).sum(axis=1)).sum() + (self.target**2).sum()
        return float(ROUNDING_SHARE * size)

    @property
    def dim(self) -> int:
        """Dimension d of the points."""
        return self.target.shape[1]

    def assignment_costs(self, rotations: FloatArray) -> FloatArray:
        """Return the cost of every match at the given rotations, shape (..., n, k).

        Matches that are not allowed cost ``inf``. Entries are ``w_j |R p_j - q_i|^2 + c_ij``.
        """
        moved = self.source @ np.swapaxes(rotations, -1, -2)
        cross = self.target @ np.swapaxes(moved, -1, -2)
        squares = (self.target**2).sum(axis=1)[:, None] + (self.source**2).sum(axis=1)
        costs = np.maximum(squares - 2.0 * cross, 0.0) * self.weights + self.constant_cost
        return np.where(self.allowed, costs, np.inf)

    def energy(self, rotation: FloatArray, point_map: IntArray) -> float:
        """Return E(R, map), computed from the differences themselves.

        Parameters
        ----------
        rotation : ndarray, shape (d, d)
        point_map : ndarray of int, shape (k,)
            Index on the target of each source point.
        """
        squares = ((self.source @ rotation.T - self.target[point_map]) ** 2).sum(axis=1)
        constant = self.constant_cost[point_map, np.arange(self.num_source)]
        return float((self.weights * squares).sum() + constant.sum())

    def procrustes(self, point_map: IntArray) -> FloatArray:
        """Return the best R for a map, shape (d, d): orthogonal Procrustes within the pattern's blocks."""
        return self.pattern.project(
            self.target[point_map].T @ (self.weights[:, None] * self.source)
        )


def energy_scale(problem: Problem) -> float:
    """Return a typical size of the energy, for absolute tolerances: the spread of both shapes about the origin."""
    weight = float(problem.weights.sum())
    squares = float((problem.weights * (problem.source**2).sum(axis=1)).sum())
    constant = float(np.abs(problem.constant_cost).mean(axis=0).sum())
    return squares + weight * float((problem.target**2).sum(axis=1).mean()) + constant


def _invariant_cost(invariants: tuple[ArrayLike, ArrayLike], n: int, k: int) -> FloatArray:
    if not isinstance(invariants, tuple | list) or len(invariants) != 2:
        raise OptionsError(
            "invariants: expected a pair (target, source) of arrays (n, m) and (k, m)"
        )
    h = as_floats(invariants[0], "invariants of the target", shape=(n, None))
    g = as_floats(invariants[1], "invariants of the source", shape=(k, h.shape[1]))
    if max(np.abs(h).max(initial=0.0), np.abs(g).max(initial=0.0)) > LARGEST_COORDINATE:
        raise InputError(
            f"invariants: beyond {LARGEST_COORDINATE:g}, their squares overflow; give smaller ones"
        )
    return ((h[:, None, :] - g[None, :, :]) ** 2).sum(axis=2)


def num_left_over(allowed: BoolArray) -> int:
    """Return how many columns a largest matching of the allowed entries (n, k) leaves out."""
    matched = scipy.sparse.csgraph.maximum_bipartite_matching(
        scipy.sparse.csr_array(allowed), perm_type="row"
    )
    return int((matched < 0).sum())


def _check_feasible(allowed: BoolArray) -> None:
    if allowed.all():
        return
    empty = np.flatnonzero(~allowed.any(axis=0))
    if len(empty):
        raise InputError(f"allowed: source point {empty[0]} has none ({len(empty)} such points)")
    stuck = num_left_over(allowed)
    if stuck:
        raise InputError(
            f"allowed: no injective map fits them, {stuck} source points are always left over"
        )


def mirror(dim: int) -> FloatArray:
    """Return the reflection F, diagonal (d,), such that every reflection is a rotation times F: -I in odd d."""
    signs = -np.ones(dim)
    if dim % 2 == 0:
        signs[:-1] = 1.0
    return signs


def chiralities(problem: Problem) -> list[tuple[bool, Problem]]:
    """Split a problem over SO(d) or O(d) into problems over SO(d), ``(reflected, problem)``.

    The source of the reflected one is ``source * mirror(d)``, so that its R stands for ``R diag(mirror)``.

    Raises
    ------
    OptionsError
        If R has zeros, more than one rotation block or a dimension other than 2 and 3.
    """
    pattern, dim = problem.pattern, problem.dim
    if (
        dim not in (2, 3)
        or not pattern.mask.all()
        or pattern.special_blocks not in ((), ((0, dim),))
    ):
        raise OptionsError(
            "this needs points in dimension 2 or 3 and a full matrix R in SO(d) or O(d)"
        )
    proper = replace(problem, pattern=RotationPattern(pattern.mask, ((0, dim),)))
    if pattern.special_blocks:
        return [(False, proper)]
    return [(False, proper), (True, replace(proper, source=problem.source * mirror(dim)))]
