"""What stays of a result when the alignment is repeated otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.output.evidence.members import Members
from data_tools.arrays import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Stability:
    """How N shapes fared in V repetitions of their alignment, against the result. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
    confidence : ndarray, shape (N,)
        Of the result.
    repetitions : tuple of str, length V
        What was changed, in words.
    present : ndarray of bool, shape (V, N)
        Whether the shape took part.
    changes_deg : ndarray, shape (V, N)
        By how much its pose relative to the others differs; NaN where it is mirrored differently, absent or alone.
    same_chirality : ndarray of bool, shape (V, N)
        True where absent.
    stay_deg : float
        A pose that changes by at most this stays.
    who : Members
        Whose shapes count in the shares of all together.
    """

    names: tuple[str, ...]
    confidence: FloatArray
    repetitions: tuple[str, ...]
    present: BoolArray
    changes_deg: FloatArray
    same_chirality: BoolArray
    stay_deg: float
    who: Members

    @property
    def known(self) -> BoolArray:
        """Where poses were compared, shape (V, N): present, and with another shape to be compared with."""
        return np.asarray(self.present & ~(np.isnan(self.changes_deg) & self.same_chirality))

    @property
    def pose_stays(self) -> FloatArray:
        """Share of the repetitions in which each pose stays, shape (N,); NaN where it was in none."""
        return _shares(np.nan_to_num(self.changes_deg, nan=np.inf) <= self.stay_deg, self.known)

    @property
    def chirality_stays(self) -> FloatArray:
        """Share of the repetitions in which each shape is mirrored as in the result, shape (N,)."""
        return _shares(self.same_chirality, self.known)


def _shares(values: BoolArray, known: BoolArray) -> FloatArray:
    """Return the mean of the known entries of each column, NaN where there is none."""
    counts = known.sum(axis=0)
    return np.where(counts > 0, (values * known).sum(axis=0) / np.maximum(counts, 1), np.nan)
