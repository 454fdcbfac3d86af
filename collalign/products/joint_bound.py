"""What is proven about all consistent arrangements of some shapes together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line


@dataclass(frozen=True, kw_only=True, eq=False)
class JointBound:
    """A lower bound of the energy of every arrangement of N shapes, and the cheapest one known. Arrays are read-only.

    The energy of an arrangement, one pose per shape, is the sum over E pairs of the squared distances of their
    matched samples (invariants included), with the best map of each pair; maps need not agree with each other.

    Attributes
    ----------
    names : tuple of str, length N
    edges : ndarray of int, shape (E, 2)
        Target and source of each pair.
    num_points : int
        Samples per shape.
    stated_energy : float
        Of the arrangement that was to be judged, as it stands.
    near_energy : float
        Of the arrangement that descent from there leads to.
    perturbed_energy, rounded_energy : float
        Of the cheapest arrangement that descent from perturbations of that one led to, and of the cheapest that
        rounding the relaxed Gram matrices led to; NaN where there was no round.
    energy : float
        Of the cheapest arrangement known.
    frames : ndarray, shape (N, 3, 3)
        ``R_common_shape`` of the cheapest arrangement known.
    pair_bounds : ndarray, shape (E,)
        Lower bound of each pair's energy, alone.
    bounds : ndarray, shape (1 + rounds,)
        The joint lower bound of each round; the first is the sum of the pairs' own.
    ended : str
        Why there was no further round.
    """

    names: tuple[str, ...]
    edges: IntArray
    num_points: int
    stated_energy: float
    near_energy: float
    perturbed_energy: float
    rounded_energy: float
    energy: float
    frames: FloatArray
    pair_bounds: FloatArray
    bounds: FloatArray
    ended: str

    __repr__ = one_line

    @property
    def bound(self) -> float:
        """No arrangement has a smaller energy."""
        return float(self.bounds.max())

    @property
    def share(self) -> float:
        """The bound as a share of the cheapest known energy; 1 where that is zero."""
        return share_of(self.bound, self.energy)

    @property
    def pair_share(self) -> float:
        """The sum of the pairs' own bounds as a share of the cheapest known energy."""
        return share_of(float(self.pair_bounds.sum()), self.energy)


@dataclass(frozen=True, kw_only=True, eq=False)
class CertifiedCollection:
    """What is proven about the arrangement of a result. Arrays are read-only.

    Attributes
    ----------
    joint : JointBound
        The bound, the energies, and the cheapest arrangement known.
    changes_deg : ndarray, shape (N,)
        By how much that arrangement turns each shape against the others, compared with the result; NaN where it
        mirrors it.
    same_chirality : ndarray of bool, shape (N,)
    """

    joint: JointBound
    changes_deg: FloatArray
    same_chirality: BoolArray

    __repr__ = one_line


def share_of(bound: float, energy: float) -> float:
    """Return a bound as a share of an energy: at most 1, which it is where the energy is zero."""
    return float(np.clip(bound / energy, -np.inf, 1.0)) if energy > 0.0 else 1.0
