"""What is known of a shape of which parts are missing."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.arrays import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Incomplete:
    """A shape that was posed on others by what has a counterpart on them.

    Attributes
    ----------
    shape : int
        Its position in the collection.
    reason : str
        Why it counts as incomplete.
    partners : ndarray of int, shape (n,)
        The shapes that it was posed on.
    overlaps : ndarray, shape (n, 2)
        Share of each partner's points with a counterpart on this shape, and of this shape's points on the partner.
    beyond : float
        Share of their points that lie beyond its rim.
    """

    shape: int
    reason: str
    partners: IntArray
    overlaps: FloatArray
    beyond: float = float("nan")

    @property
    def coverage(self) -> float:
        """The share of its partners' surfaces that it covers."""
        return float(self.overlaps[:, 0].mean()) if len(self.overlaps) else float("nan")
