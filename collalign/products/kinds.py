"""The kinds of shapes in a collection: who is of which, how sure that is, and whose frame is known from another's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from data_tools.arrays import Holds, IntArray
from data_tools.options import CleaningOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """The shapes of one kind, which are posed by themselves.

    Attributes
    ----------
    called : str
        The folder or the label that says so; ``kind 1``, ``kind 2``, ... where kinds were found.
    shapes : ndarray of int, shape (n,)
        Positions in the collection, ascending; one alone has no other of its kind.
    confidence : float
        How likely it is that these shapes are of another kind than all others; NaN where the caller said so.
    frame : float
        How many of its pairs with the kind of the reference, or with one posed against that, agree on how their
        frames lie: 1 for the kind of the reference itself, 0 where too few agree, so that poses do not compare.
    group : str
        ``SO`` or ``O``: whether its shapes might be reflected.
    cleaning : CleaningOptions
        How its files are read.
    """

    called: str
    shapes: Annotated[IntArray, Holds(shape="n")]
    confidence: Annotated[float, Holds(nan=True)]
    frame: float
    group: str
    cleaning: CleaningOptions

    @property
    def is_alone(self) -> bool:
        """Whether it is of one shape."""
        return len(self.shapes) == 1

    def among(self, position: Mapping[int, int]) -> Kind:
        """Return what is left of it by the new positions of some shapes."""
        left = [position[at] for at in self.shapes.tolist() if at in position]
        return replace(self, shapes=np.array(left, dtype=np.int64))
