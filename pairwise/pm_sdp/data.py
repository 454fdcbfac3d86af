"""PM-SDP as arrays: which matches there are, what they cost, and how they meet the lifted rotation.

Symbols (Maron et al. 2016): X the assignment, R the rotation, [R] the stack of its free entries, written in terms of
the variables rho of :class:`pairwise.pm_sdp.lifted_rotation.LiftedRotation`; M their moments, C its lower right
part. The relaxation over X, B, M reads

    min  sum_ij cost_ij X_ij - 2 <v_ij, B_ij> + constant
    s.t. C >= sum_i B_ij B_ij^T / X_ij,   sum_i B_ij = E[rho],   sum_i X_ij = 1   for every source point j,
         sum_j X_ij <= 1 (= for rows that are always full),   <A_m, M> = 0,   Y(R) >= 0,

which is the paper's (10)-(12) without its redundant first row. ``v_ij`` is w_j vec(q_i p_j^T) in terms of rho.
Unless the relaxation is asked for as published, rows that are always full have ``sum_j B_ij = E[rho]`` as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import InputError
from pairwise.pm_sdp.lifted_rotation import LiftedRotation
from pairwise.problem import Problem, assignment_support


@dataclass(frozen=True, kw_only=True, eq=False)
class RelaxationData:
    """A relaxation as arrays: padded lists of matches, one list for every source point.

    Attributes
    ----------
    lifted : LiftedRotation
        s variables.
    index : ndarray of int, shape (k, c)
        Row (target point) of each match; 0 where padded.
    valid : ndarray of bool, shape (k, c)
        False where padded.
    cost : ndarray, shape (k, c)
        Linear cost of each match, zero where padded.
    vectors : ndarray, shape (k, c, s)
        v_ij of each match.
    equality : ndarray of bool, shape (n,)
        Rows that are always full; elsewhere the row sum is an inequality.
    tied : ndarray of bool, shape (n,)
        Rows under the constraint ``sum_j B_ij = E[rho]``: those that are always full, or none.
    constant : float
        Added to the value.
    """

    lifted: LiftedRotation
    index: IntArray
    valid: BoolArray
    cost: FloatArray
    vectors: FloatArray
    equality: BoolArray
    tied: BoolArray
    constant: float

    @property
    def num_rows(self) -> int:
        """Number n of target points."""
        return len(self.equality)

    @cached_property
    def is_full(self) -> bool:
        """Whether no list is padded."""
        return bool(self.valid.all())

    @cached_property
    def is_complete(self) -> bool:
        """Whether every list holds every row, in order."""
        return self.is_full and self.valid.shape[1] == self.num_rows

    @cached_property
    def incidence(self) -> scipy.sparse.csr_array:
        """Sparse (n, k c) matrix that sums matches over their rows."""
        source, slot = np.nonzero(self.valid)
        columns = source * self.valid.shape[1] + slot
        ones = np.ones(len(columns))
        return scipy.sparse.csr_array(
            (ones, (self.index[source, slot], columns)), shape=(self.num_rows, self.valid.size)
        )

    @cached_property
    def multiplier_slots(self) -> tuple[IntArray, IntArray]:
        """Where the two multipliers of each match's row stand: among n rows, and among the tied ones, (k, c) each.

        Padded matches and rows that are not tied stand behind the last one.
        """
        rank = np.where(self.tied, np.cumsum(self.tied) - 1, self.tied.sum())
        return np.where(self.valid, self.index, self.num_rows), np.where(
            self.valid, rank[self.index], self.tied.sum()
        )

    @cached_property
    def pinned(self) -> BoolArray:
        """One row (n,) of each connected component of rows that are always full: their potentials have a gauge."""
        k, n = len(self.index), self.num_rows
        source, slot = np.nonzero(self.valid)
        edges = (np.ones(len(source)), (source, k + self.index[source, slot]))
        count, labels = scipy.sparse.csgraph.connected_components(
            scipy.sparse.coo_array(edges, shape=(k + n, k + n)), directed=False
        )
        row_labels = labels[k:]
        closed = np.ones(count, dtype=bool)
        closed[row_labels[~self.equality]] = False
        first = np.full(count, n)
        np.minimum.at(first, row_labels, np.arange(n))
        pinned = np.zeros(n, dtype=bool)
        pinned[first[closed & (first < n)]] = True
        return pinned

    def row_sums(self, values: FloatArray) -> FloatArray:
        """Return the sums (n, ...) over each row of matches' values (k, c, ...); padded ones do not count."""
        if self.is_complete:
            return values.sum(axis=0)
        return self.incidence @ values.reshape(self.valid.size, *values.shape[2:])

    def scatter(self, values: FloatArray) -> FloatArray:
        """Return matches' values (k, c, ...) as a full array (n, k, ...), zero elsewhere."""
        full = np.zeros((self.num_rows, len(self.index), *values.shape[2:]))
        source, slot = np.nonzero(self.valid)
        full[self.index[source, slot], source] = values[source, slot]
        return full

    @classmethod
    def from_problem(
        cls,
        problem: Problem,
        *,
        cross_products: bool = False,
        row_sums: bool = True,
    ) -> RelaxationData:
        """Set up the relaxation of a problem.

        Parameters
        ----------
        problem : Problem
        cross_products : bool
            See :meth:`LiftedRotation.build`.
        row_sums : bool
            Tie the rows that are always full; False is the relaxation as published.

        Raises
        ------
        InputError
            If no assignment is allowed, or squared coordinates overflow.
        """
        lifted = LiftedRotation.build(problem.pattern, cross_products=cross_products)
        allowed, always_full = assignment_support(problem.allowed)
        index, valid = _match_lists(allowed)
        with np.errstate(over="ignore", invalid="ignore"):
            cost, vectors = match_costs(problem, lifted)
            constant = float((problem.weights * (problem.source**2).sum(axis=1)).sum())
        if not (np.isfinite(constant) and np.isfinite(cost).all() and np.isfinite(vectors).all()):
            raise InputError(
                "points: their squared coordinates overflow; divide both shapes by one length"
            )
        source = np.arange(problem.num_source)[:, None]
        return cls(
            lifted=lifted,
            index=index,
            valid=valid,
            cost=np.where(valid, cost[index, source], 0.0),
            vectors=np.where(valid[..., None], vectors[index, source], 0.0),
            equality=always_full,
            tied=always_full & row_sums,
            constant=constant,
        )


def _match_lists(allowed: BoolArray) -> tuple[IntArray, BoolArray]:
    """Return the row of every match of each column, padded to the longest list."""
    counts = allowed.sum(axis=0)
    valid = np.arange(counts.max()) < counts[:, None]
    index = np.zeros(valid.shape, dtype=np.int64)
    index[valid] = np.nonzero(allowed.T)[1]
    return index, valid


def match_costs(problem: Problem, lifted: LiftedRotation) -> tuple[FloatArray, FloatArray]:
    """Return the linear costs (n, k) and the vectors v (n, k, s)."""
    rows, cols = problem.pattern.entries
    weighted = problem.weights[:, None] * problem.source
    lifted_vectors = (problem.target[:, None, rows] * weighted[None, :, cols]) @ lifted.basis
    squares = (problem.target**2).sum(axis=1)
    cost = problem.weights * squares[:, None] + problem.constant_cost - 2.0 * lifted_vectors[..., 0]
    return cost, lifted_vectors[..., 1:]
