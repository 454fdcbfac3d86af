"""Multipliers L_ij of a joint lower bound (:mod:`pairwise.certificates.verify_joint`), from rotations met so far.

Good ones are the dual variables of: minimise ``sum_c shares_c F_ij(R_c)`` over G >= 0 with identity blocks and
``G_ij = sum_c shares_c R_c``, F_ij being replaced by its convex envelope over the rotations met so far (columns). It
is solved by alternating direction multipliers (Boyd et al. 2011): shares of each pair's columns, then the projection
on G >= 0, then the scaled dual U. There -rho U is positive semidefinite, has L_ij / 2 beside the diagonal and Y on
it.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from data_tools.arrays import FloatArray, IntArray
from data_tools.threads import one_blas_thread

#: Alternations per round, steps of the shares in each, and the penalty as a share of the mean energy of a pair. Of
#: .03, .1, .3 and 1 it gained most per round on eight teeth (draws 0 and 1 of ``python -m experiments teeth_jobs``).
_STEPS, _SHARE_STEPS, _PENALTY = 30, 8, 0.1
#: A column is new if some entry differs by this from those of the pair that are known.
_NEW = 1e-4
#: Most rows of the Gram matrix: its eigenvectors are computed in every step, a second for this many.
MOST_ROWS = 1500


class JointMaster:
    """The columns and dual variables of some pairs of N shapes.

    Parameters
    ----------
    num_shapes : int
    edges : ndarray of int, shape (E, 2)
    known : ndarray, shape (E, d, d)
        A first column of each pair: those of one arrangement.
    energies : ndarray, shape (E,)
        Of these columns.
    unit : float
        Of the energy of a pair.

    Attributes
    ----------
    tilts : ndarray, shape (E, d, d)
        L_ij; zero before the first round.
    diagonal : ndarray, shape (N, d, d)
        Y_i.
    """

    def __init__(
        self, num_shapes: int, edges: IntArray, known: FloatArray, energies: FloatArray, unit: float
    ) -> None:
        self._edges, self._dim, self._penalty = edges, known.shape[-1], _PENALTY * unit
        self._columns, self._energies, self._shares = known[:, None], energies[:, None], np.ones((len(edges), 1))
        self.tilts, self.diagonal = np.zeros_like(known), np.zeros((num_shapes, self._dim, self._dim))
        self._blocks = self._with_diagonal(np.eye(self._dim), known)
        self._dual = np.zeros_like(self._blocks)

    @property
    def is_large(self) -> bool:
        """Whether there are too many shapes for anything but L = 0."""
        return self.tilts.shape[-1] * len(self.diagonal) > MOST_ROWS

    @property
    def gram(self) -> FloatArray:
        """The relaxed Gram matrix of all poses, (dN, dN)."""
        return self._blocks.reshape(len(self.diagonal) * self._dim, -1)

    def add(self, pair: int, rotations: FloatArray, energies: FloatArray) -> None:
        """Add columns (m, d, d) of a pair with their energies F (m,), those that are known left out."""
        for rotation, energy in zip(rotations, energies, strict=True):
            if np.abs(self._columns[pair] - rotation).max(axis=(1, 2)).min() > _NEW:
                at = int(np.isfinite(self._energies[pair]).sum())
                if at == self._energies.shape[1]:
                    room = ((0, 0), (0, at))
                    self._columns = np.pad(self._columns, (*room, (0, 0), (0, 0)))
                    self._energies = np.pad(self._energies, room, constant_values=np.inf)
                    self._shares = np.pad(self._shares, room)
                self._columns[pair, at], self._energies[pair, at] = rotation, energy

    def used(self, pair: int) -> FloatArray:
        """Return the columns of a pair that have a share, (m, d, d)."""
        return self._columns[pair][self._shares[pair] > 0.0]

    @one_blas_thread()
    def run(self) -> float:
        """Alternate for one round; return the bound that holds if there is no rotation but the columns."""
        left, right = self._edges.T
        for _ in range(_STEPS):
            mixed = self._blocks - self._dual
            self._improve_shares(mixed[left, :, right])
            means = (self._shares[..., None, None] * self._columns).sum(axis=1)
            wanted = self._dual + self._with_diagonal(np.eye(self._dim), means, mixed)
            self._blocks = _positive_part(wanted)
            self._dual = wanted - self._blocks
        every, slack = np.arange(len(self.diagonal)), -self._penalty * self._dual
        self.tilts, self.diagonal = 2.0 * slack[left, :, right], slack[every, :, every]
        return float(self.least().sum() - np.trace(self.diagonal, axis1=1, axis2=2).sum())

    def least(self) -> FloatArray:
        """Return the least of F - <L, .> over the columns of each pair, shape (E,)."""
        return np.asarray((self._energies - (self._columns * self.tilts[:, None]).sum(axis=(2, 3))).min(axis=1))

    def _improve_shares(self, wanted: FloatArray) -> None:
        """Lower ``<energies, shares> + penalty |columns^T shares - wanted|^2`` of all pairs, step by step.

        Each step moves share from the column of largest gradient that has some to that of least gradient.
        """
        pairs, points = np.arange(len(wanted)), self._columns.reshape(*self._energies.shape, -1)
        away = (self._shares[..., None] * points).sum(axis=1) - wanted.reshape(len(wanted), -1)
        gradient = self._energies + 2.0 * self._penalty * (points @ away[..., None])[..., 0]
        for _ in range(_SHARE_STEPS):
            low = gradient.argmin(axis=1)
            high = np.where(self._shares > 0.0, gradient, -np.inf).argmax(axis=1)
            step = points[pairs, low] - points[pairs, high]
            fall = gradient[pairs, high] - gradient[pairs, low]
            bend = 2.0 * self._penalty * (step**2).sum(axis=1)
            moved = np.minimum(self._shares[pairs, high], fall / np.maximum(bend, 1e-300))
            self._shares[pairs, low] += moved
            self._shares[pairs, high] -= moved
            gradient += 2.0 * self._penalty * moved[:, None] * (points @ step[..., None])[..., 0]
        self._shares = np.maximum(self._shares, 0.0)

    def _with_diagonal(self, own: FloatArray, blocks: FloatArray, start: FloatArray | None = None) -> FloatArray:
        """Return a matrix (N, d, N, d) with blocks of the pairs, the same on the diagonal, and else the start's."""
        (left, right), every = self._edges.T, np.arange(len(self.diagonal))
        matrix = np.zeros((len(every), self._dim, len(every), self._dim)) if start is None else start
        matrix[left, :, right], matrix[right, :, left] = blocks, np.swapaxes(blocks, 1, 2)
        matrix[every, :, every] = own
        return matrix


def _positive_part(blocks: FloatArray) -> FloatArray:
    """Return the nearest positive semidefinite matrix, from its positive eigenvalues alone: its rank is low."""
    size = blocks.shape[0] * blocks.shape[1]
    matrix = blocks.reshape(size, size)
    values, vectors = eigh(0.5 * (matrix + matrix.T), subset_by_value=(0.0, np.inf), driver="evr")
    return np.asarray(((vectors * values) @ vectors.T).reshape(blocks.shape))
