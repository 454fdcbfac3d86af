"""Where the maps of all vertices of a deformable collection take the surface that is registered to its shapes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from scipy.spatial import cKDTree

from collalign.products.consistent_maps import VertexMaps
from collalign.registration.by_map import MapGoals
from data_tools.arrays import IntArray
from data_tools.errors import InputError
from data_tools.surface.shape import Shape

#: Changes whenever the same maps would start another registration.
START_VERSION = "map-start-1"
BothWays: TypeAlias = tuple[IntArray, IntArray]


def goals_of(onto: IntArray, back: IntArray, stored: Shape) -> MapGoals:
    """Return where a map takes the vertices of the registered surface.

    Parameters
    ----------
    onto : ndarray of int, shape (v,)
        The file's vertex for each vertex of the surface, -1 where there is none.
    back : ndarray of int, shape (w,)
        The surface's vertex for each vertex of the file.
    stored : Shape
        The posed shape with the vertices of its file.

    Raises
    ------
    InputError
        If the map is of a file with another number of vertices.
    """
    num = len(stored.vertices)
    if len(back) != num or onto.max(initial=-1) >= num:
        raise InputError(f"{stored.name}: its maps are of {len(back)} vertices, its file has {num}")
    forth, known = np.flatnonzero(onto >= 0), np.flatnonzero(back >= 0)
    return np.concatenate([forth, back[known]]), stored.vertices[np.concatenate([onto[forth], known])]


def map_starts(
    maps: VertexMaps, reference: Shape, template: Shape, file_vertices: IntArray
) -> Mapping[str, BothWays]:
    """Return the maps between the template, one of the shapes, and all shapes that have maps.

    Parameters
    ----------
    maps : VertexMaps
    reference : Shape
        The template, with the vertices of its file.
    template : Shape
        The same, as it is registered: perhaps decimated.
    file_vertices : ndarray of int, shape (v,)
        The file's vertex for each of the template's.

    Returns
    -------
    mapping of str to ``onto`` and ``back`` of :func:`goals_of`
        By name; empty where the reference itself has no maps.
    """
    if reference.name not in maps.names:
        return {}
    nearest = np.append(cKDTree(template.vertices).query(reference.vertices)[1], -1)
    own = np.arange(len(reference.vertices))
    starts = {}
    for name in maps.names:
        onto, back = (
            (own, own) if name == reference.name else (maps[name, reference.name], maps[reference.name, name])
        )
        if len(onto) != len(own):
            raise InputError(f"{name}: its maps are of {len(onto)} vertices of {reference.name}, not {len(own)}")
        starts[name] = onto[file_vertices], nearest[back]
    return starts
