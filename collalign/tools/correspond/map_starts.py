"""Where the maps of all vertices of a deformable collection take the surface that is registered to its shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from collalign.products.deformation import VertexMaps
from collalign.registration.pieces import MapGoals
from data_tools.arrays import IntArray
from data_tools.errors import InputError
from data_tools.surface.shape import Shape

#: Changes whenever the same maps would start another registration.
START_VERSION = "map-start-1"


@dataclass(frozen=True, kw_only=True, eq=False)
class MapStart:
    """A map between the registered surface and one shape, both ways; -1 where there is none.

    Attributes
    ----------
    onto : ndarray of int, shape (v,)
        The file's vertex for each vertex of the surface.
    back : ndarray of int, shape (w,)
        The surface's vertex for each vertex of the file.
    """

    onto: IntArray
    back: IntArray

    def goals(self, stored: Shape) -> MapGoals:
        """Return where the map takes the surface's vertices.

        Parameters
        ----------
        stored : Shape
            The posed shape with the vertices of its file.

        Raises
        ------
        InputError
            If the map is of a file with another number of vertices.
        """
        num = len(stored.vertices)
        if len(self.back) != num or self.onto.max(initial=-1) >= num:
            raise InputError(f"{stored.name}: its maps are of {len(self.back)} vertices, its file has {num}")
        forth, back = np.flatnonzero(self.onto >= 0), np.flatnonzero(self.back >= 0)
        return np.concatenate([forth, self.back[back]]), stored.vertices[np.concatenate([self.onto[forth], back])]


def map_starts(maps: VertexMaps, reference: Shape, lender: Shape, file_vertices: IntArray) -> Mapping[str, MapStart]:
    """Return the maps between a surface, whose triangles a shape lends, and all shapes that have maps.

    Parameters
    ----------
    maps : VertexMaps
    reference : Shape
        The shape that lends its triangles, with the vertices of its file.
    lender : Shape
        The same, as it is registered: perhaps decimated.
    file_vertices : ndarray of int, shape (v,)
        The file's vertex for each of the lender's.

    Returns
    -------
    mapping of str to MapStart
        By name; empty where the reference itself has no maps.
    """
    if reference.name not in maps.names:
        return {}
    nearest = np.append(cKDTree(lender.vertices).query(reference.vertices)[1], -1)
    own = np.arange(len(reference.vertices))
    starts = {}
    for name in maps.names:
        onto, back = (
            (own, own) if name == reference.name else (maps[name, reference.name], maps[reference.name, name])
        )
        if len(onto) != len(own):
            raise InputError(f"{name}: its maps are of {len(onto)} vertices of {reference.name}, not {len(own)}")
        starts[name] = MapStart(onto=onto[file_vertices], back=nearest[back])
    return starts
