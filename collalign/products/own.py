"""What a caller knows of shapes and of pairs, and gives a run in addition to what it finds out by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import as_rotations
from data_tools.checks import check_number
from data_tools.errors import InputError
from data_tools.io.files import composed
from data_tools.surface.shape import Shape

#: Two shapes by their names.
Names: TypeAlias = tuple[str, str]
#: What may be given of pairs, and in all.
OF_PAIRS = ("candidates", "correspondences", "pair_weights")
GIVEN = ("invariants", "samples", *OF_PAIRS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Own:
    """Descriptors, samples, landmarks, poses and trust of the caller's own, by the names of shapes.

    Parameters
    ----------
    invariants : mapping of str to array_like, shape (v, m), or callable
        What no rotation changes, shape (v, m), one row per vertex of the file, of every shape; or a function that
        returns it of a shape with ``vertices`` and ``faces`` as its file stores them. It takes the place of the
        descriptors of ``EmbeddingOptions``; columns are standardised over the samples as those are.
    invariants_weight : float
        Squared norm of the invariants over all samples, relative to that of the positions; by default as much as
        those that they replace.
    samples : mapping of str to array_like of int, shape (k,)
        The vertices of each file that are matched, shape (k,), equally many of every shape.
    marks : mapping of str to mapping of str to array_like, shape (3,)
        Landmarks of the reference by their names, in the coordinates of its file: ``{"a": {"base": (0, 0, 1)}}``.
        ``AlignOptions.up``, ``front`` and ``origin`` name them. Without a reference the shape becomes it.
    candidates : mapping of (str, str) to array_like, shape (3, 3) or (m, 3, 3)
        ``R_a_b`` of pairs (a, b), shape (3, 3) or (m, 3, 3), taking b's coordinates to a's.
    correspondences : mapping of (str, str) to array_like of int, shape (m, 2)
        Vertices of pairs (a, b) that belong together, shape (m, 2) with m >= 3: of a's file, and of b's. The rotation
        that takes b's nearest to a's, both about their centroids (Kabsch 1976), is a candidate of the pair.
    pair_weights : mapping of (str, str) to float
        How much more or less than the others pairs count in synchronization; 0 leaves a pair out.
    order : sequence of str
        Scans of one object or room in the order in which they were taken: those that follow each other probably
        overlap. With ``incomplete="all"``, where candidates are rough poses, too: both make poses more probable.

    Raises
    ------
    InputError
        If poses are no rotations, a pair is none of two shapes, or is weighed twice, or the order is no list of
        different names.
    OptionsError
        If a weight is no number, or negative.
    """

    invariants: Mapping[str, ArrayLike] | Callable[[Shape], ArrayLike] = field(default_factory=dict)
    invariants_weight: float = 0.4
    samples: Mapping[str, ArrayLike] = field(default_factory=dict)
    marks: Mapping[str, Mapping[str, ArrayLike]] = field(default_factory=dict)
    candidates: Mapping[Names, ArrayLike] = field(default_factory=dict)
    correspondences: Mapping[Names, ArrayLike] = field(default_factory=dict)
    pair_weights: Mapping[Names, float] = field(default_factory=dict)
    order: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_number("invariants_weight", self.invariants_weight)
        for name in (*GIVEN, "marks"):
            given = getattr(self, name)
            if not isinstance(given, Mapping) and not (name == "invariants" and callable(given)):
                raise InputError(
                    f"{name}: expected values by the names of shapes, got {type(given).__name__}"
                )
        for name in OF_PAIRS:
            for pair in getattr(self, name):
                is_pair = isinstance(pair, tuple) and len(pair) == 2 and pair[0] != pair[1]
                if not is_pair or not all(isinstance(one, str) for one in pair):
                    raise InputError(f"{name}: expected pairs of two names, got {pair!r}")
        for name in (*GIVEN, "marks"):
            given = getattr(self, name)
            if isinstance(given, Mapping):
                object.__setattr__(
                    self, name, {_composed(names): value for names, value in given.items()}
                )
        order = self.order
        if isinstance(order, str) or not all(isinstance(name, str) for name in order):
            raise InputError(f"order: expected the names of scans, got {order!r}")
        if len(order) == 1 or len({*map(composed, order)}) < len(order):
            raise InputError(f"order: expected two or more different names, got {', '.join(order)}")
        object.__setattr__(self, "order", tuple(map(composed, order)))
        for pair, weight in self.pair_weights.items():
            check_number(f"pair_weights[{', '.join(pair)}]", weight)
            if pair[::-1] in self.pair_weights:
                raise InputError(f"pair_weights: {' and '.join(pair)} are there twice")
        for pair, poses in self.candidates.items():
            if as_rotations(poses, f"candidates[{', '.join(pair)}]", dim=3).ndim > 3 or not np.size(
                poses
            ):
                raise InputError(
                    f"candidates[{', '.join(pair)}]: expected shape (3, 3) or (m, 3, 3)"
                )

    def some(self, names: Iterable[str]) -> Own:
        """Return what is given of some shapes, and of pairs of these."""
        known = {*names}
        own: dict[str, Any] = {
            name: {key: value for key, value in given.items() if {key} <= known}
            for name in ("invariants", "samples", "marks")
            if isinstance(given := getattr(self, name), Mapping)
        }
        of_pairs: dict[str, Any] = {
            name: {pair: value for pair, value in getattr(self, name).items() if {*pair} <= known}
            for name in OF_PAIRS
        }
        order = tuple(name for name in self.order if name in known)
        return replace(self, **own, **of_pairs, order=order if len(order) > 1 else ())

    @property
    def kinds(self) -> tuple[str, ...]:
        """The names of what is given."""
        return tuple(name for name in (*GIVEN, "order") if getattr(self, name))


class OwnKeywords(TypedDict, total=False):
    """The fields of :class:`Own` as keywords."""

    invariants: Mapping[str, ArrayLike] | Callable[[Shape], ArrayLike]
    invariants_weight: float
    samples: Mapping[str, ArrayLike]
    marks: Mapping[str, Mapping[str, ArrayLike]]
    candidates: Mapping[Names, ArrayLike]
    correspondences: Mapping[Names, ArrayLike]
    pair_weights: Mapping[Names, float]
    order: Sequence[str]


def _composed(names: str | Names) -> str | Names:
    """Return one name, or those of a pair, as names are compared."""
    return composed(names) if isinstance(names, str) else (composed(names[0]), composed(names[1]))
