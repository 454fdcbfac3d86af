"""A pair of shapes, as every stage of a run fills it in, and another pose of one shape."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from collalign.products.kinds import Kind
from data_tools.arrays import FloatArray, Holds, IntArray, one_line, read_only
from data_tools.errors import UnknownName
from pairwise.certificates.certificate import Certificate

#: Alternatives reported per shape.
MAX_ALTERNATIVES = 3


def _nothing(*shape: int) -> Callable[[], Any]:
    """Return what makes the default of a field that a later stage fills: a read-only array without entries."""
    return lambda: read_only(np.zeros(shape))


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """What is known about a pair of shapes by itself. Each stage fills its own fields, with ``dataclasses.replace``.

    Attributes
    ----------
    target, source : int
        Positions of the two shapes in the collection.
    rotations : ndarray, shape (m, d, d)
        ``R_target_source`` of each candidate pose in the embedding, whose first three coordinates are those of
        space; the lowest energy first, poses that the collection asked for last.
    maps : ndarray of int, shape (m, k)
        The samples matched at each candidate; -1 where unmatched.
    how : {"whole", "map", "part", "overlap"}
        Who proposed the candidates, and so what their energies are: the search over whole shapes; maps of their
        surfaces; complete shapes on which an incomplete one was placed; surfaces of which both are parts.
    energies : ndarray, shape (m,)
        Sum of squared distances of the normalised samples, invariants included; 0 where the two are copies. Of
        "part", the geometric mean over both surfaces of squared distances to the other, at most that of points
        without a counterpart; of "overlap", 1 minus the share of the surfaces that both have.
    mismatches : ndarray, shape (m,)
        Mean distance of the descriptors of neighbourhoods at closest points of each candidate, as a share of the
        median distance of any two; NaN where it is not known, empty where it is not for any.
    log_odds : ndarray, shape (m,)
        How plausible each candidate is by all evidence, up to a constant of the pair; minus infinity for those that
        another one stands for (rigid poses, where maps were made). Empty where energies alone decide.
    evidence : ndarray, shape (m, e)
        Each kind of evidence of each candidate, columns as ``confidence.candidate_model.EVIDENCE``, NaN where
        unknown. Empty where energies alone decide.
    lower_bound : float
        No pose of this pair has a smaller energy; NaN where nothing was certified.
    status : str
        Name of the :class:`pairwise.results.Status` that the pair ended with.
    chirality_proven : bool
        Whether every pose of the other chirality is proven to be worse than the best one.
    certificate : Certificate or None
        Proves a lower bound of this pair's energy, which may be below ``lower_bound``, to anybody.
    complete_within : float
        All poses of at most this factor times the best energy are among the candidates, proven (a pose is a rotation
        that is best for its own map; they lie in the regions); NaN where they were not listed, or not completely.
    regions : ndarray, shape (r, d, d)
        Centres of balls of rotations that hold all of these poses.
    region_radii_rad : ndarray, shape (r,)
    weight : float
        How much the pair counts in synchronization, as the caller asked.
    """

    target: int
    source: int
    rotations: Annotated[FloatArray, Holds(shape="m d d", rotations=True)]
    maps: Annotated[IntArray, Holds(shape="m _", lower=-1)]
    energies: Annotated[FloatArray, Holds(shape="m")]
    how: str = "whole"
    mismatches: Annotated[FloatArray, Holds(shape="m?", nan=True)] = field(
        default_factory=_nothing(0)
    )
    log_odds: Annotated[FloatArray, Holds(shape="m?")] = field(default_factory=_nothing(0))
    evidence: Annotated[FloatArray, Holds(shape="m? _", nan=True)] = field(
        default_factory=_nothing(0, 0)
    )
    lower_bound: Annotated[float, Holds(nan=True)] = float("nan")
    status: str = ""
    chirality_proven: bool = False
    certificate: Certificate | None = None
    complete_within: Annotated[float, Holds(nan=True)] = float("nan")
    regions: Annotated[FloatArray, Holds(shape="r _ _", rotations=True)] = field(
        default_factory=_nothing(0, 3, 3)
    )
    region_radii_rad: Annotated[FloatArray, Holds(shape="r")] = field(default_factory=_nothing(0))
    weight: float = 1.0

    __repr__ = one_line

    @property
    def doubts(self) -> FloatArray:
        """The cost of each candidate by all that is known, shape (m,): minus its log-odds, or its energy."""
        return read_only(-self.log_odds) if len(self.log_odds) else self.energies


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AlignedPair(Pair):
    """A pair of a result: what is known of it by itself (:class:`Pair`), and what the poses of all shapes make of it.

    Attributes
    ----------
    choice : int
        The candidate that synchronization chose, -1 for none.
    inlier : bool
        Whether synchronization trusts the pair.
    disagreement_deg : float
        Angle between the chosen candidate and the common poses.
    map_target_source : ndarray of int, shape (k,)
        The samples matched at the common poses; -1 where unmatched.
    energy : float
        The energy of that match.
    """

    choice: int
    inlier: bool
    disagreement_deg: Annotated[float, Holds(nan=True)]
    map_target_source: Annotated[IntArray, Holds(shape="k", lower=-1)]
    energy: Annotated[float, Holds(nan=True)]


def median_mismatch(pairs: Sequence[Pair]) -> float:
    """Return the median over pairs of the least mismatch of their candidates; NaN where that of some is unknown."""
    least = [float(pair.mismatches.min()) for pair in pairs if len(pair.mismatches)]
    return float(np.median(least)) if least and len(least) == len(pairs) else float("nan")


def are_weighed(pairs: Iterable[Pair]) -> bool:
    """Return whether maps were made: pairs then have log-odds."""
    return any(len(pair.log_odds) for pair in pairs)


class Pairs(tuple[AlignedPair, ...]):
    """Pairs in order, also by the names of their two shapes, either first: ``pairs["tooth1", "tooth2"]``."""

    names: tuple[str, ...]
    _places: dict[frozenset[str], int]

    @classmethod
    def of(cls, pairs: Sequence[AlignedPair], names: tuple[str, ...]) -> Pairs:
        """Return the pairs of shapes that have these names."""
        found = cls(pairs)
        found.names = names
        found._places = {
            frozenset((names[pair.target], names[pair.source])): at for at, pair in enumerate(pairs)
        }
        return found

    def __getitem__(self, which: Any) -> Any:
        """Return a pair by position or by two names, or a slice; an ``UnknownName`` is a ``KeyError``."""
        if not isinstance(which, tuple):
            return super().__getitem__(which)
        if frozenset(which) not in self._places:
            raise UnknownName(f"{' and '.join(map(str, which))} were not matched with each other")
        return super().__getitem__(self._places[frozenset(which)])

    def __contains__(self, which: object) -> bool:
        """Return whether a pair, or two shapes given by their names, are among them."""
        return (
            frozenset(which) in self._places
            if isinstance(which, tuple)
            else tuple.__contains__(self, which)
        )

    def __reduce__(self) -> Any:
        return Pairs.of, (tuple(self), self.names)


@dataclass(frozen=True, kw_only=True, eq=False)
class Alternative:
    """Another pose of a shape, or of a block of shapes, that the pairs also support.

    Attributes
    ----------
    rotation : ndarray, shape (d, d)
        ``R_common_shape`` of that pose (for a block: of its first member; the block moves as one).
    log_odds : float
        Log of how much more probable the reported pose is than this one (0 is a tie); NaN where unknown.
    origin : str
        What proposed it: ``"candidates"`` of the pairs, ``"half turn"``, ...
    transform : ndarray, shape (4, 4), or None
        The whole pose of an incomplete shape, file coordinates to the common frame; None where translation and size
        follow from the rotation.
    """

    rotation: Annotated[FloatArray, Holds(shape="d d", rotations=True)]
    log_odds: Annotated[float, Holds(nan=True)] = float("nan")
    origin: str = "candidates"
    transform: Annotated[FloatArray, Holds(shape="4 4")] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class FormerPairs:
    """The pairs that an earlier run matched among the first ``num_shapes`` shapes, and with which group.

    ``kinds`` are those of these shapes; empty where they are of one.
    """

    num_shapes: int
    edges: IntArray
    group: str
    kinds: tuple[Kind, ...] = ()

    def some(self, chosen: Sequence[int]) -> FormerPairs:
        """Return the pairs among some of the shapes, in order, by position among these.

        The group is that of their kind, where they are of one.
        """
        at = {i: number for number, i in enumerate(chosen)}
        edges = [[at[i], at[j]] for i, j in self.edges.tolist() if i in at and j in at]
        return FormerPairs(
            num_shapes=sum(i < self.num_shapes for i in chosen),
            edges=np.array(edges, dtype=np.int64).reshape(-1, 2),
            group=next(
                (kind.group for kind in self.kinds if {*chosen} & {*kind.shapes.tolist()}),
                self.group,
            ),
        )
