"""What synchronization returns."""

from __future__ import annotations

from dataclasses import dataclass

from collalign.products.pair import Alternative
from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line
from data_tools.notes import Note


@dataclass(frozen=True, kw_only=True, eq=False)
class SynchronizationResult:
    """One pose per shape, and how far each can be trusted. All arrays are read-only.

    Attributes
    ----------
    rotations : ndarray, shape (N, d, d)
        ``R_common_i``. Shapes of different components have no common frame: each has its own gauge.
    confidence : ndarray, shape (N,)
        Probability that the shape's pose is right relative to its group; NaN where it was not estimated.
    edge_inlier : ndarray of bool, shape (E,)
        Whether the pair agrees with the answer.
    edge_choice : ndarray of int, shape (E,)
        The candidate of each pair nearest to the answer.
    parts : tuple of ndarray of int
        Partition of the shapes: poses are comparable within a part. Here the components; a run may split further.
    components : tuple of ndarray of int
        Connected parts of the graph of pairs.
    alternatives : tuple of tuple of Alternative
        For each shape its best other poses, most probable first.
    warnings : tuple of Note
        Which poses cannot be compared.
    """

    rotations: FloatArray
    confidence: FloatArray
    edge_inlier: BoolArray
    edge_choice: IntArray
    parts: tuple[IntArray, ...]
    components: tuple[IntArray, ...]
    alternatives: tuple[tuple[Alternative, ...], ...]
    warnings: tuple[Note, ...]

    __repr__ = one_line
