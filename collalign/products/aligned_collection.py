"""The aligned collection: one transform per shape, consistent maps between all of them, and the evidence for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from collalign.options import AlignOptions
from collalign.products.deformation import VertexMaps
from collalign.products.incomplete import Incomplete
from collalign.products.pair import Alternative, Pair, Pairs
from collalign.products.shapes import Excluded
from collalign.products.trust import Trust
from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line
from data_tools.errors import UnknownName
from data_tools.io.source import Origin

#: Poses below this confidence are called doubtful, on the command line, in the contact sheet and in the report.
DOUBT = 0.95


def position_of(names: Sequence[str], shape: str | int) -> int:
    """Return the position of a shape that is given by its name or position.

    Raises
    ------
    UnknownName
        If no shape has the name: a ``KeyError`` and an ``InputError``.
    IndexError
        If there are not so many shapes.
    """
    if not isinstance(shape, str):
        if not -len(names) <= shape < len(names):
            raise IndexError(f"shape {shape} of {len(names)}")
        return range(len(names))[shape]
    if shape not in names:
        listed = f"{', '.join(names[:5])}{', ...' if len(names) > 5 else ''}"
        raise UnknownName(f"no shape is called {shape!r}; the collection has {listed}")
    return names.index(shape)


@dataclass(frozen=True, eq=False)
class ConsistentMaps:
    """Correspondences of samples between any two shapes, consistent around every cycle by construction.

    Every sample carries the label of a point of the common *universe*; ``maps[a, b]`` sends the samples of b to those
    of a with the same labels, so that ``maps[a, b][maps[b, c]] == maps[a, c]``.

    Attributes
    ----------
    names : tuple of str
    labels : ndarray of int, shape (N, k)
        Universe label of each sample; -1 for a sample that corresponds to nothing.
    vertices : VertexMaps or None
        The same of all vertices, where they were asked for (``options.deformable``).
    """

    names: tuple[str, ...]
    labels: IntArray
    vertices: VertexMaps | None = None

    def __getitem__(self, pair: tuple[str | int, str | int]) -> IntArray:
        """Return ``map_a_b``, shape (k,): the sample on a of each sample of b, -1 where there is none."""
        a, b = (position_of(self.names, shape) for shape in pair)
        inverse = np.full(int(self.labels.max(initial=-1)) + 2, -1)
        inverse[self.labels[a]] = np.arange(self.labels.shape[1])
        inverse[-1] = -1
        return inverse[self.labels[b]]

    __repr__ = one_line


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """How a run went: what may differ between two runs with the same result.

    Attributes
    ----------
    times_s : dict of str to float
        Wall-clock seconds per stage.
    versions : dict of str to str
        Of Python and of the libraries that the numbers depend on.
    num_reused : int
        Shapes and pairs that came out of the store.
    """

    times_s: dict[str, float] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    num_reused: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Collection:
    """An aligned collection; arrays are read-only, shapes in natural order of their names.

    Attributes
    ----------
    names : tuple of str, length N
    files : tuple of Path or Source
        Where each shape was read from; a source in memory where it came from no file.
    digests : tuple of str
        Of the files' contents when they were read; saving refuses a file that has changed since.
    transforms : ndarray, shape (N, 4, 4)
        Each shape's file coordinates to the common frame, scale included.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``, the orthogonal part of each transform.
    reflected : ndarray of bool, shape (N,)
        Whether the shape is mirrored.
    confidence : ndarray, shape (N,)
        Probability that the pose is the right one of those considered; NaN where it was not estimated.
    samples : tuple of ndarray of int, each (k,)
        Vertex indices of each shape's samples, as its file counts them.
    positions : ndarray, shape (N, k, 3)
        The samples in the common frame.
    coordinates, invariants : ndarray, shapes (N, k, d) and (N, k, m)
        The samples as they were matched: embedded, centred and scaled, and what no rotation changes.
    trust : Trust or None
        The evidence behind the confidences; None where none was gathered.
    maps : ConsistentMaps
    consensus : ndarray, shape (num_labels, 3)
        Mean position of every universe label in the common frame.
    pairs : tuple of Pair
    alternatives : tuple of tuple of Alternative
        Other poses of each shape, the likeliest first.
    parts : tuple of ndarray of int
        Shapes that are aligned with each other; more than one part means that the poses between parts are unknown
        or ambiguous.
    excluded : tuple of Excluded
        Files and pairs that were left out.
    skipped : tuple of str
        Files of the folder that are no shapes.
    notes : tuple of str
        What a user must know before trusting the whole, one sentence each.
    shape_notes : tuple of tuple of str
        What was repaired or simplified in each shape before it was matched.
    options : AlignOptions
        As asked for.
    group : str
        "SO" or "O": whether shapes could be mirrored, as asked for or, with ``options.group`` "auto", as decided.
    run : RunRecord
    incomplete : tuple of Incomplete
        The shapes of which parts are missing; what they lack has no labels, and counts in no mean.
    search_gain : float or None
        Log-odds, summed over the pairs, that trying the rival poses of all shapes by maps gained; None where maps
        were not asked.
    """

    names: tuple[str, ...]
    files: tuple[Origin, ...]
    digests: tuple[str, ...]
    transforms: FloatArray
    rotations: FloatArray
    reflected: BoolArray
    confidence: FloatArray
    samples: tuple[IntArray, ...]
    positions: FloatArray
    coordinates: FloatArray
    invariants: FloatArray
    maps: ConsistentMaps
    consensus: FloatArray
    pairs: tuple[Pair, ...]
    alternatives: tuple[tuple[Alternative, ...], ...]
    parts: tuple[IntArray, ...]
    excluded: tuple[Excluded, ...]
    skipped: tuple[str, ...]
    notes: tuple[str, ...]
    shape_notes: tuple[tuple[str, ...], ...]
    options: AlignOptions
    group: str
    run: RunRecord
    trust: Trust | None = None
    incomplete: tuple[Incomplete, ...] = ()
    search_gain: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", Pairs.of(self.pairs, self.names))

    @property
    def complete(self) -> bool:
        """Whether nothing was left out."""
        return not self.excluded
