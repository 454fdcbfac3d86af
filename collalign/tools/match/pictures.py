"""Both shapes coloured alike: the target by its coordinates, the source by those of its images."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from collalign.output.views import (
    camera,
    display_mesh,
    font_of,
    painted,
    principal_view,
    seen_panel,
    viridis,
)
from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.shape import Shape

if TYPE_CHECKING:
    from PIL.Image import Image

_GREY = np.full(3, 0.6)
#: Triangles of a mesh that are drawn, about.
_MOST_FACES_DRAWN = 10_000
#: Pixels of a panel's side, and of the heights of the title and of other words.
_PANEL, _TITLE, _WORDS = 290, 22.0, 15.0
#: In panels: of the picture, of the base line of the words above a panel, and of the middle of the title.
_HEIGHT, _ABOVE, _TOP = 1.35, 1.05, 1.25
#: Half turn about the vertical axis of the picture.
_FROM_BEHIND = np.diag([-1.0, 1.0, -1.0])


def vertices_map(point_map_target_source: IntArray, target: Shape, source: Shape) -> IntArray:
    """Turn a map between the vertices of two files into one between the vertices of the shapes as they were read.

    Parameters
    ----------
    point_map_target_source : ndarray of int
        Vertex of the target file for each vertex of the source file, -1 where there is none.
    target, source : Shape

    Returns
    -------
    ndarray of int, shape (number of source vertices,)
    """
    of_target, of_source = (shape.file_indices for shape in (target, source))
    size = max(int(of_target.max()), int(point_map_target_source.max(initial=-1))) + 1
    places = np.full(size + 1, -1, dtype=np.int64)
    places[of_target] = np.arange(len(of_target))
    return places[point_map_target_source[of_source]]


def transferred_colours(
    target: Shape, point_map_target_source: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return colours in [0, 1] of the target's vertices and of the source's, shapes (u, 3) and (v, 3).

    Red, green and blue are the target's coordinates as the picture shows it; unmatched vertices are grey.

    Raises
    ------
    InputError
        If the map names a vertex that the target does not have.
    """
    if len(point_map_target_source) and int(point_map_target_source.max()) >= len(target.vertices):
        raise InputError(
            f"the map names vertex {point_map_target_source.max()} of {target.name}, which has fewer"
        )
    places = target.vertices @ principal_view([(target.vertices, target.faces)]).T
    low, high = places.min(axis=0), places.max(axis=0)
    colours = 0.08 + 0.84 * (places - low) / np.where(high > low, high - low, 1.0)
    images = np.maximum(point_map_target_source, 0)
    return colours, np.where((point_map_target_source >= 0)[:, None], colours[images], _GREY)


def match_picture(
    target: Shape,
    source: Shape,
    point_map_target_source: IntArray,
    confidence: FloatArray | None = None,
    *,
    title: str = "",
) -> Image:
    """Draw target and source from the front and from behind, coloured by the map, and the source by its confidence.

    Parameters
    ----------
    target, source : Shape
        As in their files; point clouds are drawn as points.
    point_map_target_source : ndarray of int, shape (v,)
    confidence : ndarray, shape (v,), optional
        Of the image of each vertex of the source; NaN is grey.
    title : str
    """
    from PIL.ImageDraw import Draw

    of_target, of_source = transferred_colours(target, point_map_target_source)
    view = camera([(target.vertices, target.faces)])
    matched = np.flatnonzero(point_map_target_source >= 0)
    rotated = view
    if len(matched):
        rotated = view @ _procrustes(
            target.vertices[point_map_target_source[matched]], source.vertices[matched]
        )
    shown = [(target, of_target, view, target.name), (source, of_source, rotated, source.name)]
    if confidence is not None:
        shown.append(
            (source, _confidence_colours(confidence), rotated, "confidence: dark 0, yellow 1")
        )
    size = (2.0 * len(shown), _HEIGHT)
    panels, words = [], []
    for column, (shape, of_vertices, frame, name) in enumerate(shown):
        vertices, faces, colours = _drawn(shape, of_vertices)
        for place, behind in enumerate((np.eye(3), _FROM_BEHIND)):
            corner = np.array([2.0 * column + place, 0.0])
            panels.append(seen_panel(vertices @ (behind @ frame).T, faces, corner, colours))
            words.append((corner[0] + 0.5, "from behind" if place else name))
    picture = painted(panels, size, _PANEL)
    pen, font = Draw(picture), font_of(_WORDS)
    for middle, said in words:
        pen.text((_PANEL * middle, _PANEL * (_HEIGHT - _ABOVE)), said, "black", font, "ms")
    top = (0.5 * picture.width, _PANEL * (_HEIGHT - _TOP))
    pen.text(top, title, "black", font_of(_TITLE), "mm")
    return picture


def _drawn(shape: Shape, colours: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return vertices, triangles and colours of vertices of what is drawn of a shape."""
    if len(shape.faces) <= _MOST_FACES_DRAWN:
        return shape.vertices, shape.faces, colours
    vertices, faces = display_mesh(shape.vertices, shape.faces, max_faces=_MOST_FACES_DRAWN)
    return vertices, faces, colours[scipy.spatial.cKDTree(shape.vertices).query(vertices)[1]]


def _confidence_colours(confidence: FloatArray) -> FloatArray:
    colours = viridis(np.nan_to_num(confidence))
    return np.where(np.isnan(confidence)[:, None], _GREY, colours)


def _procrustes(target: FloatArray, source: FloatArray) -> FloatArray:
    return nearest_orthogonal(
        (target - target.mean(axis=0)).T @ (source - source.mean(axis=0)), determinant=1.0
    )
