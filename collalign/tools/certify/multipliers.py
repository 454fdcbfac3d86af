"""Multipliers L_ij of a joint lower bound (:mod:`pairwise.certificates.verify_joint`), from rotations met so far.

Good ones are the dual variables of: minimise ``sum_c shares_c F_ij(R_c)`` over G >= 0 with identity blocks and
``G_ij = sum_c shares_c R_c``, F_ij being replaced by its convex envelope over the rotations met so far (columns). It
is solved by alternating direction multipliers (Boyd et al. 2011): shares of each pair's columns, then the projection
on G >= 0, then the scaled dual U. There -rho U is positive semidefinite, has L_ij / 2 beside the diagonal and Y on
it.

A multiple of ``3 - <R*_ij, R>`` is taken off every energy, R* the cheapest arrangement known. It adds to S a
Laplacian that vanishes at R* alone, so that the bound falls a little, and says how far as cheap poses can be from R*.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from data_tools.arrays import FloatArray, IntArray
from data_tools.threads import one_blas_thread

#: Alternations per round, steps of the shares in each, and the penalty as a share of the mean energy of a pair. Of
#: .03, .1, .3 and 1 it gained most per round on eight teeth (draws 0 and 1 of ``python -m experiments teeth_jobs``).
_STEPS, _SHARE_STEPS, _PENALTY = 30, 8, 0.1
#: What is taken off per unit of 3 - <R*, R>, as a share of the mean energy of a pair: of 0, .003, .01, .03 and .1 the
#: largest that lowers the bound by less than .001 of the energy (eight teeth, draws 0 to 4).
_CURVATURE = 0.03
#: Energies are not taken for smaller than this.
_LEAST_UNIT = 1e-12
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
    rotations : ndarray, shape (E, d, d)
        R*_ij, a first column of each pair.
    energies : ndarray, shape (E,)
        Of these columns.

    Attributes
    ----------
    tilts : ndarray, shape (E, d, d)
        L_ij; zero before the first round, and for ever with more than ``MOST_ROWS`` rows.
    diagonal : ndarray, shape (N, d, d)
        Y_i.
    """

    def __init__(self, num_shapes: int, edges: IntArray, rotations: FloatArray, energies: FloatArray) -> None:
        dim, unit = rotations.shape[-1], max(float(energies.mean()), _LEAST_UNIT)
        self._edges, self._known, self._dim = edges, rotations, dim
        self._columns, self._costs = rotations[:, None], energies[:, None].astype(np.float64)
        self._shares = np.ones((len(edges), 1))
        self.is_large = num_shapes * dim > MOST_ROWS
        self._penalty, self._curvature = _PENALTY * unit, _CURVATURE * unit
        self.tilts, self.diagonal = np.zeros_like(rotations), np.zeros((num_shapes, dim, dim))
        if not self.is_large:
            self._gram = self._with_diagonal(np.eye(dim), rotations)
            self._dual = np.zeros_like(self._gram)

    @property
    def gram(self) -> FloatArray:
        """The relaxed Gram matrix of all poses, (dN, dN)."""
        size = len(self.diagonal) * self._dim
        return self._gram.reshape(size, size)

    def add(self, pair: int, rotations: FloatArray, energies: FloatArray) -> None:
        """Add columns (m, d, d) of a pair with their energies F (m,), those that are known left out."""
        for rotation, energy in zip(rotations, energies, strict=True):
            if np.abs(self._columns[pair] - rotation).max(axis=(1, 2)).min() > _NEW:
                if np.isfinite(self._costs[pair, -1]):
                    self._grow()
                at = int(np.argmax(np.isinf(self._costs[pair])))
                self._columns[pair, at] = rotation
                lowered = self._curvature * (self._dim - float((rotation * self._known[pair]).sum()))
                self._costs[pair, at] = energy - lowered

    def recentre(self, rotations: FloatArray, energies: FloatArray) -> None:
        """Take R* (E, d, d) of energies (E,) for the cheapest arrangement known from now on."""
        self._costs += self._lowered()
        self._known, self._curvature = rotations, _CURVATURE * max(float(energies.mean()), _LEAST_UNIT)
        self._costs -= self._lowered()
        for pair in range(len(rotations)):
            self.add(pair, rotations[pair : pair + 1], energies[pair : pair + 1])

    def _lowered(self) -> FloatArray:
        """Return what is taken off the energies of all columns, (E, m)."""
        cosines = (self._columns * self._known[:, None]).sum(axis=(2, 3))
        return np.asarray(self._curvature * (self._dim - cosines))

    def _grow(self) -> None:
        """Make room for more columns of every pair; what is not one has infinite costs."""
        num = self._costs.shape[1]
        self._columns = np.concatenate([self._columns, np.zeros_like(self._columns)], axis=1)
        self._costs = np.pad(self._costs, ((0, 0), (0, num)), constant_values=np.inf)
        self._shares = np.pad(self._shares, ((0, 0), (0, num)))

    def used(self, pair: int) -> FloatArray:
        """Return the columns of a pair that have a share, (m, d, d)."""
        return self._columns[pair][self._shares[pair] > 0.0]

    @one_blas_thread()
    def run(self) -> float:
        """Alternate for one round; return the bound that holds if there is no rotation but the columns."""
        left, right = self._edges.T
        for _ in range(_STEPS):
            mixed = self._gram - self._dual
            self._improve_shares(mixed[left, :, right])
            means = (self._shares[..., None, None] * self._columns).sum(axis=1)
            wanted = self._dual.copy() + self._with_diagonal(np.eye(self._dim), means, mixed)
            self._gram = _positive_part(wanted)
            self._dual = wanted - self._gram
        every, slack = np.arange(len(self.diagonal)), -self._penalty * self._dual
        tilts = 2.0 * slack[left, :, right]
        values = np.where(
            np.isinf(self._costs), np.inf, self._costs - (self._columns * tilts[:, None]).sum(axis=(2, 3))
        )
        degrees = np.bincount(self._edges.ravel(), minlength=len(every))
        diagonal = slack[every, :, every]
        self.tilts = tilts - self._curvature * self._known
        self.diagonal = diagonal + 0.5 * self._curvature * degrees[:, None, None] * np.eye(self._dim)
        return float(values.min(axis=1).sum() - np.trace(diagonal, axis1=1, axis2=2).sum())

    def _improve_shares(self, wanted: FloatArray) -> None:
        """Lower ``<costs, shares> + penalty |columns^T shares - wanted|^2`` of all pairs, step by step.

        Each step moves share from the column of largest gradient that has some to that of least gradient.
        """
        pairs, points = np.arange(len(wanted)), self._columns.reshape(*self._costs.shape, -1)
        away = (self._shares[..., None] * points).sum(axis=1) - wanted.reshape(len(wanted), -1)
        gradient = self._costs + 2.0 * self._penalty * (points @ away[..., None])[..., 0]
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
