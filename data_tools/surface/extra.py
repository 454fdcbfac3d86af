"""Surface that belongs to something else than the shape, such as a stand: what it is, and the shape without it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, Holds, read_only
from data_tools.options import CleaningOptions
from data_tools.surface.cleaning import clean
from data_tools.surface.shape import Shape
from data_tools.surface.topology import mesh_edges, vertex_components


@dataclass(frozen=True, kw_only=True, eq=False)
class ExtraSurface:
    """Points spread over a surface, and which of them are extra material.

    Attributes
    ----------
    points : ndarray, shape (l, 3)
        In the coordinates of the file.
    is_extra : ndarray of bool, shape (l,)
    """

    points: Annotated[FloatArray, Holds(shape="l 3")]
    is_extra: Annotated[BoolArray, Holds(shape="l")]

    @property
    def digest(self) -> str:
        """The same for the same points."""
        content = np.ascontiguousarray(self.points[self.is_extra]).tobytes()
        return hashlib.sha256(self.points.tobytes() + content).hexdigest()

    def holds(self, places: FloatArray) -> BoolArray:
        """Return which places (p, 3) on the surface are extra material: those whose nearest point is."""
        return np.asarray(self.is_extra[scipy.spatial.cKDTree(self.points).query(places)[1]])


def without_extra(
    shape: Shape, extra: ExtraSurface, options: CleaningOptions | None = None
) -> Shape:
    """Return a shape without its extra material, as :func:`without_vertices` does.

    Parameters
    ----------
    shape : Shape
    extra : ExtraSurface
    options : CleaningOptions, optional
        What the rest is cleaned by.
    """
    return without_vertices(shape, extra.holds(shape.vertices), options)


def without_vertices(
    shape: Shape,
    goes: BoolArray,
    options: CleaningOptions | None = None,
    *,
    apart: bool = False,
) -> Shape:
    """Return a shape without some of its vertices.

    A hole in a mesh is closed by the corners of its border: each vertex that goes collapses to the nearest one of
    them.

    Parameters
    ----------
    shape : Shape
    goes : ndarray of bool, shape (v,)
    options : CleaningOptions, optional
        What the rest is cleaned by.
    apart : bool
        Whether several holes are closed one by one: triangles that would join their borders go.
    """
    place, faces = np.arange(len(goes)), shape.faces
    if shape.is_mesh:
        edges = mesh_edges(faces)
        across = edges[goes[edges].sum(axis=1) == 1]
        border = np.unique(across[~goes[across]])
        if len(border):
            nearest = scipy.spatial.cKDTree(shape.vertices[border]).query(shape.vertices[goes])[1]
            place[goes] = border[nearest]
        at_border = np.zeros(len(goes), dtype=np.bool_)
        at_border[border] = True
        ring = vertex_components(len(goes), [edges[at_border[edges].all(axis=1)]])[1]
        closes = goes[faces].any(axis=1)
        faces = place[faces]
        rings = ring[faces]
        kept = ~goes[faces].any(axis=1) & (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        if apart:
            kept &= ~closes | (rings == rings[:, :1]).all(axis=1)
        faces = faces[kept]
    starts = np.cumsum([0, *(size for _, size in shape.parts)])
    parts = [
        (name, int((~goes[start : start + size]).sum()))
        for start, (name, size) in zip(starts, shape.parts, strict=False)
    ]
    rest = Shape(
        name=shape.name,
        vertices=read_only(shape.vertices[~goes]),
        faces=read_only((np.cumsum(~goes) - 1)[faces]),
        file=shape.file,
        notes=shape.notes,
        source_indices=read_only(shape.file_indices[~goes]),
        file_size=shape.file_size or len(goes),
        parts=tuple(parts),
    )
    return rest if shape.parts else replace(clean(rest, options), notes=shape.notes)
