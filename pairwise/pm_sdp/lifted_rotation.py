"""The lifted rotation: variables for the entries of R, and the linear equations of their second moments.

Every free entry of R is plus or minus one of the variables ``rho`` (or 1), so that patterns and SO(2) blocks
need no equations of their own. The *moment matrix* is ``M = E[(1, rho)(1, rho)^T]`` with M_00 = 1; its lower right
part is the C of Maron et al. 2016. Orthogonality (R^T R = R R^T = I) and the cross-product identities (cof R = R) are
quadratic in R, so they are linear in M: ``<A_m, M> = 0``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.problem import assignment_support
from pairwise.rotation_pattern import RotationPattern

#: Relative size below which a pivot of the equations counts as zero.
_RANK_TOL = 1e-10

#: Sinkhorn's rounds converge linearly on a mask with total support; this many are never needed in practice.
_MAX_SINKHORN_ROUNDS = 10_000


@dataclass(frozen=True, eq=False)
class LiftedRotation:
    """Variables and equations of the lifted rotation.

    Attributes
    ----------
    pattern : RotationPattern
        r free entries.
    variable : ndarray of int, shape (r,)
        Which of (1, rho) each free entry is, up to sign; -1 for entries that are zero in every orthogonal matrix
        with this pattern.
    sign : ndarray, shape (r,)
        +1 or -1.
    equations : ndarray, shape (e, s+1, s+1)
        Symmetric A_m with ``<A_m, M> = 0``, linearly independent; s is the number of variables.
    labels : tuple of (kind, row, col)
        What each equation is: ``("columns", s, t)`` is (R^T R)_st, ``("rows", s, t)`` is (R R^T)_st,
        ``("cross", s, t)`` is (cof R - R)_st within the rotation block that holds (s, t).
    quaternion_blocks : tuple of (start, map)
        Blocks under the conv SO(3) constraint, and the array (s, 4, 4) with ``Y = I/4 + sum_a rho_a map[a]``.
    """

    pattern: RotationPattern
    variable: IntArray
    sign: FloatArray
    equations: FloatArray
    labels: tuple[tuple[str, int, int], ...]
    quaternion_blocks: tuple[tuple[int, FloatArray], ...]

    @classmethod
    def build(cls, pattern: RotationPattern, *, cross_products: bool = False) -> LiftedRotation:
        """Set up the equations of a pattern.

        Parameters
        ----------
        pattern : RotationPattern
        cross_products : bool
            Use the identities cof R = R of the 3x3 rotation blocks instead of conv SO(3): stronger.
        """
        variable, sign = _variables(pattern)
        blocks = [start for start, stop in pattern.special_blocks if stop - start == 3]
        terms = _orthogonality_terms(pattern)
        if cross_products:
            terms.update(_cross_product_terms(blocks))
        equations, labels = _independent_equations(pattern, variable, sign, terms)
        num = int(variable.max(initial=0))
        quaternions = (
            ()
            if cross_products
            else tuple((b, _quaternion_map(pattern, variable, b, num)) for b in blocks)
        )
        return cls(pattern, variable, sign, equations, labels, quaternions)

    @property
    def num_variables(self) -> int:
        """Number s of variables rho."""
        return self.equations.shape[1] - 1

    @cached_property
    def quaternion_slopes(self) -> FloatArray:
        """The maps of all blocks under the conv SO(3) constraint, (q, s, 4, 4)."""
        slopes = np.zeros((len(self.quaternion_blocks), self.num_variables, 4, 4))
        for block, (_, block_map) in zip(slopes, self.quaternion_blocks, strict=True):
            block[:] = block_map
        return slopes

    @cached_property
    def _flat_slopes(self) -> FloatArray:
        return np.ascontiguousarray(
            np.swapaxes(self.quaternion_slopes, 0, 1).reshape(self.num_variables, -1)
        )

    def quaternion_change(self, direction: FloatArray) -> FloatArray:
        """Return the change (q, 4, 4) of Y along a change (s,) of rho."""
        return (direction @ self._flat_slopes).reshape(-1, 4, 4)

    @cached_property
    def basis(self) -> FloatArray:
        """Matrix (r, s+1) with ``[R] = basis @ (1, rho)``."""
        basis = np.zeros((len(self.variable), self.num_variables + 1))
        used = self.variable >= 0
        basis[np.flatnonzero(used), self.variable[used]] = self.sign[used]
        return basis

    @cached_property
    def interior_moments(self) -> FloatArray:
        """A positive definite diagonal matrix (s, s) that satisfies every equation together with rho = 0.

        Its entries are a doubly stochastic matrix on the pattern (Sinkhorn 1964): E[R_st^2].
        """
        rows, cols = self.pattern.entries
        mask = np.zeros((self.pattern.dim, self.pattern.dim))
        mask[rows, cols] = self.variable >= 0
        for _ in range(_MAX_SINKHORN_ROUNDS):
            mask /= mask.sum(axis=0)
            mask /= mask.sum(axis=1, keepdims=True)
            if np.abs(mask.sum(axis=0) - 1.0).max() < 1e-14:
                break
        squares = np.zeros(self.num_variables + 1)
        used = self.variable >= 0
        squares[self.variable[used]] = mask[rows[used], cols[used]]
        return np.diag(squares[1:])


def _variables(pattern: RotationPattern) -> tuple[IntArray, FloatArray]:
    """Assign a variable to each entry that can be non-zero, two for an SO(2) block."""
    rows, cols = pattern.entries
    possible = assignment_support(pattern.mask)[0][rows, cols]
    representative = np.arange(len(rows))
    sign = np.ones(len(rows))
    position = {(int(s), int(t)): e for e, (s, t) in enumerate(zip(rows, cols, strict=True))}
    for start, stop in pattern.special_blocks:
        if stop - start == 2:
            _tie_planar_block(position, start, representative, sign, possible)
    own = possible & (representative == np.arange(len(rows)))
    number = np.cumsum(own)
    variable = np.where(possible, number[representative], -1)
    return variable.astype(np.int64), sign


def _tie_planar_block(
    position: dict[tuple[int, int], int],
    start: int,
    representative: IntArray,
    sign: FloatArray,
    possible: BoolArray,
) -> None:
    """Write an SO(2) block as [[c, -s], [s, c]] in place."""
    a, b = start, start + 1
    for first, second, factor in (((a, a), (b, b), 1.0), ((b, a), (a, b), -1.0)):
        if first in position and second in position:
            representative[position[second]] = position[first]
            sign[position[second]] = factor
            possible[position[second]] &= possible[position[first]]


#: A quadratic equation of R: terms (coefficient, (row, col), (row, col)); None stands for the constant 1.
_Entry = tuple[int, int] | None
_Terms = dict[tuple[str, int, int], list[tuple[float, _Entry, _Entry]]]


def _orthogonality_terms(pattern: RotationPattern) -> _Terms:
    """Return equations of R^T R = I and R R^T = I, without those that are empty."""
    terms: _Terms = {}
    mask = pattern.mask
    for s in range(pattern.dim):
        for t in range(s, pattern.dim):
            constant: list[tuple[float, _Entry, _Entry]] = [(-1.0, None, None)] if s == t else []
            columns = [
                (1.0, (int(a), s), (int(a), t)) for a in np.flatnonzero(mask[:, s] & mask[:, t])
            ]
            rows = [(1.0, (s, int(a)), (t, int(a))) for a in np.flatnonzero(mask[s] & mask[t])]
            terms["columns", s, t] = [*columns, *constant]
            terms["rows", s, t] = [*rows, *constant]
    return terms


def _cross_product_terms(blocks: list[int]) -> _Terms:
    """Return nine equations cof R = R of each 3x3 rotation block: columns are cross products of the others."""
    terms: _Terms = {}
    for b in blocks:
        for s in range(3):
            for t in range(3):
                s1, s2, t1, t2 = (b + (i + o) % 3 for i, o in ((s, 1), (s, 2), (t, 1), (t, 2)))
                terms["cross", b + s, b + t] = [
                    (1.0, (s1, t1), (s2, t2)),
                    (-1.0, (s1, t2), (s2, t1)),
                    (-1.0, None, (b + s, b + t)),
                ]
    return terms


def _independent_equations(
    pattern: RotationPattern, variable: IntArray, sign: FloatArray, terms: _Terms
) -> tuple[FloatArray, tuple[tuple[str, int, int], ...]]:
    """Assemble the equations and drop those that vanish or depend on the others (one gauge per component)."""
    rows, cols = pattern.entries
    lookup: dict[_Entry, tuple[int, float]] = {None: (0, 1.0)}
    for e, (s, t) in enumerate(zip(rows, cols, strict=True)):
        lookup[int(s), int(t)] = (int(variable[e]), float(sign[e]))
    size = int(variable.max(initial=0)) + 1
    matrices, labels = [], []
    for label, products in terms.items():
        matrix = np.zeros((size, size))
        for factor, first, second in products:
            a, sign_a = lookup.get(first, (-1, 0.0))
            b, sign_b = lookup.get(second, (-1, 0.0))
            if a >= 0 and b >= 0:
                matrix[a, b] += 0.5 * factor * sign_a * sign_b
                matrix[b, a] += 0.5 * factor * sign_a * sign_b
        if np.abs(matrix).max() > 0.0:
            matrices.append(matrix)
            labels.append(label)
    upper = np.triu_indices(size)
    stacked = np.stack(matrices)
    _, triangle, order = scipy.linalg.qr(
        stacked[:, upper[0], upper[1]].T, mode="economic", pivoting=True
    )
    pivots = np.abs(np.diag(triangle))
    kept = np.sort(order[: len(pivots)][pivots > _RANK_TOL * pivots[0]])
    return stacked[kept], tuple(labels[m] for m in kept)


def _quaternion_map(
    pattern: RotationPattern, variable: IntArray, start: int, num: int
) -> FloatArray:
    """Return dY/drho (s, 4, 4) of the quaternion moment matrix Y(R) (Saunderson, Parrilo, Willsky 2015)."""
    slopes = np.zeros((3, 3, 4, 4))
    for t, signs in enumerate(((1, 1, -1, -1), (1, -1, 1, -1), (1, -1, -1, 1))):
        slopes[t, t] = np.diag(signs)
    for t in range(3):
        a, b = (t + 1) % 3, (t + 2) % 3
        slopes[b, a, 0, t + 1], slopes[a, b, 0, t + 1] = 1.0, -1.0
        slopes[a, b, a + 1, b + 1] = slopes[b, a, a + 1, b + 1] = 1.0
    slopes = 0.25 * (slopes + np.swapaxes(slopes, 2, 3)) / np.where(np.eye(4) > 0, 2.0, 1.0)
    rows, cols = pattern.entries
    result = np.zeros((num + 1, 4, 4))
    inside = (rows >= start) & (rows < start + 3) & (variable > 0)
    result[variable[inside]] = slopes[rows[inside] - start, cols[inside] - start]
    return result[1:]
