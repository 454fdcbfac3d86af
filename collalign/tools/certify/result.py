"""What is proven about all consistent arrangements of some shapes together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line


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
        What proves it, see :mod:`pairwise.certificates.verify_joint`: *tilts* L (E, 3, 3), *diagonal* Y (N, 3, 3),
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
