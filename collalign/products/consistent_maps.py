"""Correspondences of samples, and maps of all vertices, between all shapes of a collection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
import scipy

from data_tools.arrays import FloatArray, Holds, IntArray, one_line
from data_tools.errors import UnknownName
from data_tools.io.files import composed
from data_tools.names import nearest_names
from data_tools.notes import listed


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
        advice = nearest_names(shape, names) or f"; the collection has {listed(names)}"
        raise UnknownName(f"no shape is called {shape!r}{advice}")
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
    labels: Annotated[IntArray, Holds(shape="n k", lower=-1)]

    def __getitem__(self, pair: tuple[str | int, str | int]) -> IntArray:
        """Return ``map_a_b``, shape (k,): the sample on a of each sample of b, -1 where there is none."""
        a, b = (position_of(self.names, shape) for shape in pair)
        inverse = np.full(int(self.labels.max(initial=-1)) + 2, -1)
        inverse[self.labels[a]] = np.arange(self.labels.shape[1])
        inverse[-1] = -1
        return inverse[self.labels[b]]

    __repr__ = one_line


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexMaps:
    """Maps of all vertices between any two shapes, through one of them; arrays are read-only.

    ``maps[a, b]`` sends the vertices of b to those of a: to the one whose place on the reference is nearest. All maps
    come from these places, so they compose around cycles up to the spacing of vertices.

    Attributes
    ----------
    names : tuple of str, length M
        Shapes that have maps.
    reference : str
        The shape that maps go through: the one that the others' maps agree with best.
    places : tuple of ndarray, each (v_i, 3)
        Where each vertex of a shape belongs on the reference, as their files count vertices and in the coordinates of
        the reference's file: a point of its surface, NaN where there is none.
    confidence : ndarray, shape (M,)
        Probability that a shape's vertices belong less than .1 sqrt(area) from their places in the mean, see
        :mod:`collalign.confidence.map_model`; a map of two shapes is right where both are.
    vertex_confidence : tuple of ndarray, each (v_i,)
        Probability that the place of each vertex is within that; NaN where there is none.
    left_out : tuple of (str, str)
        Names of the other shapes, and why they have none.
    """

    names: tuple[str, ...]
    reference: str
    places: tuple[Annotated[FloatArray, Holds(shape="_ 3", nan=True)], ...]
    confidence: Annotated[FloatArray, Holds(shape="_", nan=True)]
    vertex_confidence: tuple[Annotated[FloatArray, Holds(shape="_", nan=True)], ...]
    left_out: tuple[tuple[str, str], ...] = ()

    def __getitem__(self, pair: tuple[str, str]) -> IntArray:
        """Return ``map_a_b``, shape (v_b,): the vertex of a for each vertex of b, -1 where there is none."""
        a, b = (self._position(name) for name in pair)
        tree, vertices = self._trees[a]
        known = self._trees[b][1]
        found = np.full(len(self.places[b]), -1)
        if len(vertices):
            found[known] = vertices[tree.query(self.places[b][known])[1]]
        return found

    @cached_property
    def _trees(self) -> tuple[tuple[scipy.spatial.cKDTree, IntArray], ...]:
        """Of each shape the tree of its places, and the vertices that have them."""
        known = [np.flatnonzero(np.isfinite(own).all(axis=1)) for own in self.places]
        return tuple(
            (scipy.spatial.cKDTree(own[rows]), rows)
            for own, rows in zip(self.places, known, strict=True)
        )

    __repr__ = one_line

    def _position(self, name: str) -> int:
        name = composed(name)
        if name not in self.names:
            reason = dict(self.left_out).get(name, "")
            raise UnknownName(f"no maps of {name!r}{': ' + reason if reason else ''}")
        return self.names.index(name)
