"""The joint lower bound of a collection: multipliers of the pairs, from the rotations met so far.

Let F_ij be the energy of a pair at R_ij = R_i^T R_j, and G the Gram matrix of all poses, G_ij = R_i^T R_j. For any
matrices L_ij

    sum_ij F_ij(R_i^T R_j)  >=  sum_ij min_R [F_ij(R) - <L_ij, R>]  +  min {sum_ij <L_ij, G_ij> : G >= 0, G_ii = I}.

The first minima are branch and bound (:mod:`pairwise.branch_and_bound.tilted`). For the second, let C be symmetric
with L_ij / 2 beside the diagonal; any block-diagonal symmetric Y gives <C, G> = <C + Y, G> - tr Y
>= dN min(0, lambda_min(C + Y)) - tr Y.

Good multipliers are the dual variables of the same problem with F_ij replaced by its convex envelope over the
rotations met so far (columns): minimise ``sum_c shares_c F_ij(R_c)`` over G with ``G_ij = sum_c shares_c R_c``. It is
solved by alternating direction multipliers (Boyd et al. 2011): shares of each pair's columns, then the projection on
G >= 0, then the scaled dual U. There -rho U is positive semidefinite, has L_ij / 2 beside the diagonal and -Y on it.
That the dual moves little between rounds is what keeps the bounds from swinging as those of a linear master would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import OptionsError

#: Alternations per round, and the penalty as a share of the mean energy of a pair. Of .03, .1, .3 and 1 the second
#: gained most per round on eight teeth of one side (draws 0 and 1 of ``python -m experiments teeth_jobs``).
_STEPS, _PENALTY = 30, 0.1
#: A column is new if some entry differs by this from those of the pair that are known.
_NEW = 1e-4
#: Most rows of the Gram matrix: its eigenvectors are computed in every step, a second for this many.
MOST_ROWS = 1500
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, kw_only=True, eq=False)
class Multipliers:
    """Dual variables of a collection.

    Attributes
    ----------
    tilts : ndarray, shape (E, d, d)
        L_ij of each pair.
    gram_bound : float
        ``sum <L_ij, G_ij>`` is nowhere smaller.
    column_bound : float
        The joint bound that these multipliers would prove if no rotation but the columns existed.
    """

    tilts: FloatArray
    gram_bound: float
    column_bound: float


class JointMaster:
    """The master problem of some pairs of N shapes.

    Parameters
    ----------
    num_shapes : int
    edges : ndarray of int, shape (E, 2)
    rotations : ndarray, shape (E, d, d)
        A first column of each pair, of a consistent arrangement.
    energies : ndarray, shape (E,)
        Of these columns.
    unit : float
        A typical energy of a pair, positive.

    Raises
    ------
    OptionsError
        If the Gram matrix would have more than ``MOST_ROWS`` rows.
    """

    def __init__(
        self, num_shapes: int, edges: IntArray, rotations: FloatArray, energies: FloatArray, *, unit: float
    ) -> None:
        dim = rotations.shape[-1]
        if num_shapes * dim > MOST_ROWS:
            raise OptionsError(
                f"{num_shapes} shapes: the joint bound is for at most {MOST_ROWS // dim} at once; name some of them"
            )
        self._edges, self._dim = edges, dim
        self._columns = list(rotations[:, None])
        self._costs = list(energies[:, None].astype(np.float64))
        self._shares = [np.ones(1) for _ in edges]
        self._gram = np.zeros((num_shapes, dim, num_shapes, dim))
        self._dual = np.zeros_like(self._gram)
        self._write(self._gram, rotations)
        self._write_diagonal(self._gram)
        self._penalty = _PENALTY * unit

    @property
    def gram(self) -> FloatArray:
        """The relaxed Gram matrix of all poses, (dN, dN)."""
        size = self._gram.shape[0] * self._dim
        return self._gram.reshape(size, size)

    def add(self, pair: int, rotations: FloatArray, energies: FloatArray) -> None:
        """Add columns (m, d, d) of a pair, those that are known left out."""
        for rotation, energy in zip(rotations, energies, strict=True):
            if np.abs(self._columns[pair] - rotation).max(axis=(1, 2)).min() > _NEW:
                self._columns[pair] = np.concatenate([self._columns[pair], rotation[None]])
                self._costs[pair] = np.append(self._costs[pair], energy)
                self._shares[pair] = np.append(self._shares[pair], 0.0)

    def used(self, pair: int) -> FloatArray:
        """Return the columns of a pair that have a share, (m, d, d)."""
        return self._columns[pair][self._shares[pair] > 0.0]

    def run(self) -> Multipliers:
        """Alternate for one round and return the multipliers."""
        from collalign.synchronization.bound.simplex import combine

        points = np.concatenate(self._columns).reshape(-1, self._dim**2)
        costs, shares = np.concatenate(self._costs), np.concatenate(self._shares)
        starts = np.cumsum([0, *map(len, self._costs)])
        left, right = self._edges.T
        for _ in range(_STEPS):
            mixed = self._gram - self._dual
            wanted = mixed[left, :, right, :].reshape(len(left), -1)
            combine(points, costs, starts, wanted, self._penalty, shares)
            self._write(mixed, np.add.reduceat(shares[:, None] * points, starts[:-1]).reshape(-1, *[self._dim] * 2))
            self._write_diagonal(mixed)
            self._gram = _positive_part(mixed + self._dual)
            self._dual += mixed - self._gram
        self._shares = np.split(shares, starts[1:-1])
        return self._multipliers()

    def _multipliers(self) -> Multipliers:
        (left, right), every = self._edges.T, np.arange(len(self._dual))
        slack = -self._penalty * self._dual
        tilts = 2.0 * slack[left, :, right, :]
        matrix = np.zeros_like(slack)
        self._write(matrix, 0.5 * tilts)
        blocks = slack[every, :, every, :]
        blocks = 0.5 * (blocks + np.swapaxes(blocks, 1, 2))
        matrix[every, :, every, :] = blocks
        least, size = _least_eigenvalue(matrix), self._dim * len(every)
        gram_bound = float(size * min(0.0, least) - np.trace(blocks, axis1=1, axis2=2).sum())
        values = [
            float((costs - np.tensordot(columns, tilt)).min())
            for costs, columns, tilt in zip(self._costs, self._columns, tilts, strict=True)
        ]
        return Multipliers(tilts=tilts, gram_bound=gram_bound, column_bound=sum(values) + gram_bound)

    def _write(self, matrix: FloatArray, blocks: FloatArray) -> None:
        left, right = self._edges.T
        matrix[left, :, right, :] = blocks
        matrix[right, :, left, :] = np.swapaxes(blocks, 1, 2)

    def _write_diagonal(self, matrix: FloatArray) -> None:
        every = np.arange(len(matrix))
        matrix[every, :, every, :] = np.eye(self._dim)


def _positive_part(blocks: FloatArray) -> FloatArray:
    """Return the nearest positive semidefinite matrix, from its positive eigenvalues alone: its rank is low."""
    size = blocks.shape[0] * blocks.shape[1]
    matrix = blocks.reshape(size, size)
    values, vectors = eigh(0.5 * (matrix + matrix.T), subset_by_value=(0.0, np.inf), driver="evr")
    return np.asarray(((vectors * values) @ vectors.T).reshape(blocks.shape))


def _least_eigenvalue(blocks: FloatArray) -> float:
    """Return a lower bound of the least eigenvalue: the computed one less what rounding can have added."""
    size = blocks.shape[0] * blocks.shape[1]
    matrix = blocks.reshape(size, size)
    least = float(np.linalg.eigvalsh(matrix)[0])
    return least - 8.0 * size * _EPS * float(np.linalg.norm(matrix))
