"""Maps of all vertices between all shapes of a collection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexMaps:
    """Maps of all vertices between any two shapes, through one of them; arrays are read-only.

    ``maps[a, b]`` sends the vertices of b to those of a. All maps come from one common basis of functions, so they
    compose around cycles up to the spacing of vertices.

    Attributes
    ----------
    names : tuple of str, length M
        Shapes that have maps.
    reference : str
        The shape that maps go through: the one that the others' maps agree with best.
    to_reference : tuple of ndarray of int, each (v_i,)
        The reference's vertex for each vertex of a shape, as their files count them; -1 where there is none.
    from_reference : tuple of ndarray of int, each (v_reference,)
        The shape's vertex for each vertex of the reference, -1 where there is none.
    residuals : ndarray, shape (M,)
        Median disagreement of a shape's pairwise maps with the common basis: 0 agrees, about 1.4 has nothing to do
        with it.
    left_out : tuple of (str, str)
        Names of the other shapes, and why they have none.
    """

    names: tuple[str, ...]
    reference: str
    to_reference: tuple[IntArray, ...]
    from_reference: tuple[IntArray, ...]
    residuals: FloatArray
    left_out: tuple[tuple[str, str], ...] = ()

    def __getitem__(self, pair: tuple[str, str]) -> IntArray:
        """Return ``map_a_b``, shape (v_b,): the vertex of a for each vertex of b, -1 where there is none."""
        a, b = (self._position(name) for name in pair)
        onto = np.append(self.from_reference[a], -1)
        return np.asarray(onto[self.to_reference[b]])

    def _position(self, name: str) -> int:
        if name not in self.names:
            reason = dict(self.left_out).get(name, "")
            raise InputError(f"no maps of {name!r}{': ' + reason if reason else ''}")
        return self.names.index(name)
