"""Correspondences of samples between all shapes of a collection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import IntArray, one_line
from data_tools.errors import UnknownName
from data_tools.io.files import composed


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
    shape = composed(shape)
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
    """

    names: tuple[str, ...]
    labels: IntArray

    def __getitem__(self, pair: tuple[str | int, str | int]) -> IntArray:
        """Return ``map_a_b``, shape (k,): the sample on a of each sample of b, -1 where there is none."""
        a, b = (position_of(self.names, shape) for shape in pair)
        inverse = np.full(int(self.labels.max(initial=-1)) + 2, -1)
        inverse[self.labels[a]] = np.arange(self.labels.shape[1])
        inverse[-1] = -1
        return inverse[self.labels[b]]

    __repr__ = one_line
