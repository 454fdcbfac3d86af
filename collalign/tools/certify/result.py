"""What is proven about all consistent arrangements of some shapes together, and descent to cheaper ones.

An arrangement is one pose per shape; its energy is ``sum over pairs of F_ij(R_i^T R_j)``, F_ij the least matching
energy of any map. Maps of different pairs are independent of each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line
from pairwise.problem import Problem


@dataclass(frozen=True, kw_only=True, eq=False)
class JointBound:
    """A lower bound of the energy of every arrangement of N shapes, and the cheapest one known. Arrays are read-only.

    The energy of an arrangement, one pose per shape, is the sum over E pairs of the squared distances of their
    matched samples (invariants included), with the best map of each pair; maps need not agree with each other.

    Attributes
    ----------
    edges : ndarray of int, shape (E, 2)
        Target and source of each pair.
    stated_energy : float
        Of the arrangement that was to be judged, as it stands.
    near_energy : float
        Of the arrangement that descent from there leads to.
    energy : float
        Of the cheapest arrangement known.
    frames : ndarray, shape (N, 3, 3)
        ``R_common_shape`` of the cheapest arrangement known.
    bounds : tuple of float
        The joint lower bound of each round of proofs, also where the time ended within it.
    ended : str
        Why there was no further round.
    bound : float
        No arrangement has a smaller energy: the best of all rounds, at least 0.
    proof : mapping of name to ndarray
        What proves it, see :mod:`pairwise.certificates.verify`: *tilts* L (E, 3, 3), *diagonal* Y (N, 3, 3),
        the *depths* of all cells, and *num_cells*, how many each chirality of each pair has, (E, 1) or (E, 2).
    """

    edges: IntArray
    stated_energy: float
    near_energy: float
    energy: float
    frames: FloatArray
    bounds: tuple[float, ...]
    ended: str
    bound: float
    proof: Mapping[str, NDArray[Any]]

    __repr__ = one_line

    @property
    def share(self) -> float:
        """The bound as a share of the cheapest known energy; 1 where that is zero."""
        return share_of(self.bound, self.energy)


@dataclass(frozen=True, kw_only=True, eq=False)
class CertifiedCollection:
    """What is proven about the arrangement of a result. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
    members : ndarray of int, shape (N,)
        Positions of these shapes in the result.
    coordinates, invariants : ndarray, shapes (N, k, 3) and (N, k, m)
        The samples as they are matched.
    joint : JointBound
    changes_deg : ndarray, shape (N,)
        By how much the cheapest arrangement known rotates each shape against the others, compared with the result;
        NaN where it mirrors it.
    same_chirality : ndarray of bool, shape (N,)
    confidence : ndarray, shape (N,)
        Of the poses of the result.
    """

    names: tuple[str, ...]
    members: IntArray
    coordinates: FloatArray
    invariants: FloatArray
    joint: JointBound
    changes_deg: FloatArray
    same_chirality: BoolArray
    confidence: FloatArray

    __repr__ = one_line


def share_of(bound: float, energy: float) -> float:
    """Return a bound as a share of an energy: at most 1, which it is where the energy is zero."""
    return float(np.clip(bound / energy, -np.inf, 1.0)) if energy > 0.0 else 1.0


#: Most alternations of maps and poses, and most sweeps over the poses between two of them.
_MOST_ROUNDS, _MOST_SWEEPS = 100, 50
#: Poses and maps stay when the energy falls by less than this share of it; poses alone from this change on.
_LEAST_GAIN, _LEAST_STEP = 1e-5, 1e-9
#: Perturbations: rotations of this many degrees (one drawn each time) of each shape with one of these probabilities.
_ANGLES_DEG, _SHARES = (2.0, 4.0, 6.0, 10.0, 15.0, 25.0), (0.15, 0.3, 0.5, 1.0)


#: One pose per shape, ``R_common_i`` (N, d, d), and the energy of all pairs with the best map of each.
Arrangement: TypeAlias = tuple[FloatArray, float]


class PairEnergies:
    """The energies of some pairs of N shapes.

    Parameters
    ----------
    num_shapes : int
    edges : ndarray of int, shape (E, 2)
        Target and source of each pair.
    problems : sequence of Problem
        Of each pair.
    """

    def __init__(self, num_shapes: int, edges: IntArray, problems: Sequence[Problem]) -> None:
        self.num_shapes = num_shapes
        self.edges = edges
        self.problems = tuple(problems)
        self.pattern = self.problems[0].pattern

    def at(self, frames: FloatArray) -> FloatArray:
        """Return the energy of each pair at poses (N, d, d), shape (E,)."""
        return self._assign(frames)[0]

    def relative(self, frames: FloatArray) -> FloatArray:
        """Return ``R_i^T R_j`` of each pair, shape (E, d, d)."""
        left, right = self.edges.T
        return np.swapaxes(frames[left], 1, 2) @ frames[right]

    def descend(self, frames: FloatArray) -> Arrangement:
        """Alternate exact maps of all pairs with closed-form poses (N, 3, 3) until neither lowers the energy."""
        energy = np.inf
        for _ in range(_MOST_ROUNDS):
            energies, moments = self._assign(frames)
            before, energy = energy, float(energies.sum())
            if before - energy <= _LEAST_GAIN * energy:
                break
            frames = self._sweep(frames, moments)
        return frames, energy

    def perturb(self, known: Arrangement, rng: np.random.Generator, num: int) -> Arrangement:
        """Rotate shapes of the cheapest arrangement a little and descend again, ``num`` times."""
        best = known
        for _ in range(num):
            vectors = np.deg2rad(rng.choice(_ANGLES_DEG)) * rng.standard_normal(
                (self.num_shapes, 3)
            )
            vectors *= (rng.random(self.num_shapes) < rng.choice(_SHARES))[:, None]
            found = self.descend(
                best[0] @ scipy.spatial.transform.Rotation.from_rotvec(vectors).as_matrix()
            )
            best = min(best, found, key=lambda one: one[1])
        return best

    def rounded(self, gram: FloatArray) -> FloatArray:
        """Return poses (N, d, d) from a Gram matrix (dN, dN) of all of them: its leading eigenvectors, projected."""
        dim = self.pattern.dim
        blocks = np.linalg.eigh(gram)[1][:, -dim:].reshape(self.num_shapes, dim, dim)
        return np.swapaxes(self.pattern.project(blocks @ blocks[0].T), 1, 2)

    def _assign(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each pair's energy and its cross-covariance under the best map, shapes (E,) and (E, d, d)."""
        energies, moments = [], []
        for problem, rotation in zip(self.problems, self.relative(frames), strict=True):
            costs = problem.assignment_costs(rotation).T
            rows, columns = scipy.optimize.linear_sum_assignment(costs)
            energies.append(costs[rows, columns].sum())
            moments.append(
                problem.target[columns].T @ (problem.weights[rows, None] * problem.source[rows])
            )
        return np.array(energies), np.array(moments)

    def _sweep(self, frames: FloatArray, moments: FloatArray) -> FloatArray:
        """Maximise ``sum <R_i^T R_j, M_ij>`` shape by shape, each in closed form, until little changes."""
        left, right = self.edges.T
        dense = np.zeros((self.num_shapes, self.num_shapes, *moments.shape[1:]))
        dense[left, right], dense[right, left] = moments, np.swapaxes(moments, 1, 2)
        frames = frames.copy()
        for _ in range(_MOST_SWEEPS):
            before = frames.copy()
            for shape, pulls in enumerate(dense):
                frames[shape] = self.pattern.project(
                    (frames @ np.swapaxes(pulls, 1, 2)).sum(axis=0)
                )
            if np.abs(frames - before).max() < _LEAST_STEP:
                break
        return frames
