"""Both shapes coloured alike: the target by its coordinates, the source by those of its images."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.nonrigid.surface.geometry import summed_normals
from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.figures import new_figure
from data_tools.io.files import write_atomic
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.shape import Shape

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GREY = np.full(3, 0.6)
_LIGHT = np.array([0.3, 0.4, 0.87])
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
    of_target, of_source = (_file_indices(shape) for shape in (target, source))
    size = max(int(of_target.max()), int(point_map_target_source.max(initial=-1))) + 1
    places = np.full(size + 1, -1, dtype=np.int64)
    places[of_target] = np.arange(len(of_target))
    return places[point_map_target_source[of_source]]


def values_at_vertices(values: FloatArray, shape: Shape) -> FloatArray:
    """Return values of a file's vertices at the vertices of the shape as it was read, NaN where there is none."""
    return np.asarray(np.append(values, np.nan)[np.minimum(_file_indices(shape), len(values))])


def _file_indices(shape: Shape) -> IntArray:
    indices = shape.source_indices
    return np.arange(len(shape.vertices)) if indices is None else indices


def transferred_colours(target: Shape, point_map_target_source: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return colours in [0, 1] of the target's vertices and of the source's, shapes (u, 3) and (v, 3).

    Red, green and blue are the target's coordinates in its principal axes; unmatched vertices are grey.

    Raises
    ------
    InputError
        If the map names a vertex that the target does not have.
    """
    if len(point_map_target_source) and int(point_map_target_source.max()) >= len(target.vertices):
        raise InputError(f"the map names vertex {point_map_target_source.max()} of {target.name}, which has fewer")
    places = (target.vertices - target.vertices.mean(axis=0)) @ _axes(target.vertices)
    low, high = places.min(axis=0), places.max(axis=0)
    colours = 0.08 + 0.84 * (places - low) / np.where(high > low, high - low, 1.0)
    images = np.maximum(point_map_target_source, 0)
    return colours, np.where((point_map_target_source >= 0)[:, None], colours[images], _GREY)


def draw_match(
    path: Path | str,
    target: Shape,
    source: Shape,
    point_map_target_source: IntArray,
    confidence: FloatArray | None = None,
) -> Path:
    """Write the picture of :func:`match_figure` as a PNG."""
    buffer = BytesIO()
    figure = match_figure(target, source, point_map_target_source, confidence)
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return write_atomic(Path(path), buffer.getvalue())


def match_figure(
    target: Shape,
    source: Shape,
    point_map_target_source: IntArray,
    confidence: FloatArray | None = None,
    *,
    title: str = "",
) -> Figure:
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
    of_target, of_source = transferred_colours(target, point_map_target_source)
    frame = _axes(target.vertices)
    matched = np.flatnonzero(point_map_target_source >= 0)
    turned = frame
    if len(matched):
        turned = _procrustes(target.vertices[point_map_target_source[matched]], source.vertices[matched]).T @ frame
    panels = [(target, of_target, frame, target.name), (source, of_source, turned, source.name)]
    if confidence is not None:
        panels.append((source, _confidence_colours(confidence), turned, "confidence: dark 0, yellow 1"))
    figure = new_figure(figsize=(4.5 * len(panels), 3.6), dpi=130)
    for column, (shape, colours, axes, name) in enumerate(panels):
        for view, behind in enumerate((np.eye(3), _FROM_BEHIND)):
            panel = figure.add_subplot(1, 2 * len(panels), 2 * column + view + 1)
            _draw(panel, shape, colours, axes @ behind)
            panel.set_title(name if view == 0 else "from behind", fontsize="small")
    figure.suptitle(title, fontsize="small")
    return figure


def _confidence_colours(confidence: FloatArray) -> FloatArray:
    from matplotlib import colormaps

    colours = np.asarray(colormaps["viridis"](np.nan_to_num(confidence)))[:, :3]
    return np.where(np.isnan(confidence)[:, None], _GREY, colours)


def _axes(vertices: FloatArray) -> FloatArray:
    """Return the frame of the picture as columns: second axis across, longest up, shortest towards the viewer."""
    centred = vertices - vertices.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    frame = vectors[:, [1, 2, 0]]
    frame[:, 2] *= np.sign(np.linalg.det(frame))
    return np.ascontiguousarray(frame)


def _procrustes(target: FloatArray, source: FloatArray) -> FloatArray:
    return nearest_orthogonal((target - target.mean(axis=0)).T @ (source - source.mean(axis=0)), determinant=1.0)


def _draw(panel: Any, shape: Shape, colours: FloatArray, axes: FloatArray) -> None:
    """Draw a shape by the painter's algorithm: far triangles first."""
    from matplotlib.collections import PolyCollection

    seen = (shape.vertices - shape.vertices.mean(axis=0)) @ axes
    if shape.is_mesh:
        shade = np.abs(summed_normals(shape) @ axes @ _LIGHT)[:, None]
        lit = colours * (0.45 + 0.55 * shade)
        order = np.argsort(seen[shape.faces, 2].mean(axis=1), kind="stable")
        faces = shape.faces[order]
        corners = seen[faces][:, :, :2]
        panel.add_collection(
            PolyCollection(corners, facecolors=lit[faces].mean(axis=1), edgecolors="face", linewidths=0.2)
        )
    else:
        order = np.argsort(seen[:, 2], kind="stable")
        panel.scatter(seen[order, 0], seen[order, 1], c=colours[order], s=1.0)
    panel.set_aspect("equal")
    panel.set_axis_off()
    panel.autoscale_view()
