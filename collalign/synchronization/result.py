"""What synchronization returns."""

from __future__ import annotations

from dataclasses import dataclass

from collalign.products.pair import Alternative
from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakCut:
    """A block of shapes that could be turned as one, at little cost to the pairs that join it to the rest.

    While poses are looked for ``rotation`` is of frames, ``P_i T``; in a result it is of poses.

    Attributes
    ----------
    members : ndarray of int
        Shapes of the block, sorted.
    rotation : ndarray, shape (d, d)
        The turn in the common frame that takes the block from its reported pose to the alternative one.
    log_odds : float
        Log of how much more probable the reported pose is.
    pairs_for, pairs_against : int
        How many pairs across the cut clearly prefer the reported pose, and the alternative.
    structured : bool
        Whether the pairs contradict the reported pose in a way that chance does not explain.
    doubted : bool
        Whether they do, or leave it open.
    """

    members: IntArray
    rotation: FloatArray
    log_odds: float
    pairs_for: int
    pairs_against: int
    structured: bool
    doubted: bool


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
        Partition of the shapes: poses are comparable within a part. Parts that are not connected, or that the pairs
        join in an ambiguous way, are apart.
    components : tuple of ndarray of int
        Connected parts of the graph of pairs.
    weak_cuts : tuple of WeakCut
        The weakest blocks of each connected part under each common turn; those that are doubted come first.
    alternatives : tuple of tuple of Alternative
        For each shape its best other poses, most probable first.
    warnings : tuple of str
        Which poses cannot be compared, one sentence each.
    """

    rotations: FloatArray
    confidence: FloatArray
    edge_inlier: BoolArray
    edge_choice: IntArray
    parts: tuple[IntArray, ...]
    components: tuple[IntArray, ...]
    weak_cuts: tuple[WeakCut, ...]
    alternatives: tuple[tuple[Alternative, ...], ...]
    warnings: tuple[str, ...]

    __repr__ = one_line
