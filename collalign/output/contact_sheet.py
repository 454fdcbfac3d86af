"""A picture of every shape before and after alignment, side by side from the same viewpoint."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from collalign.output.views import FEWEST_FACES, UNNAMED, camera, display_mesh
from collalign.products.named_frame import NamedFrame
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray, IntArray
from data_tools.html_pages import new_figure
from data_tools.percent import percent
from data_tools.poses import moved_by
from data_tools.surface.shape import Shape

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LIGHT = np.array([0.3, 0.5, 0.81])
_COLOUR = np.array([0.85, 0.8, 0.68])
_CELL_INCHES = 1.5
#: In cells: of a row with its line of text, and of the space left free around a shape.
_ROW_HEIGHT, _MARGIN = 1.2, 0.03
#: From the cell of a shape before alignment to the one after.
_RIGHT = np.array([1.0, 0.0])
#: Half the time of the usual level, for 4 % more bytes.
_PNG = {"compress_level": 3}
#: A shape as it is seen, the farthest first: corners of triangles (f, 3, 2) or points (v, 2), and their colours.
Panel: TypeAlias = tuple[FloatArray, FloatArray]


#: One shape for the sheet (decimated), its transform (4, 4), and how far it is trusted (NaN: unknown).
Tile: TypeAlias = tuple[Shape, FloatArray, float]


def tile_of(shape: Shape, transform: FloatArray, confidence: float) -> Tile:
    """Decimate a shape for drawing.

    Parameters
    ----------
    shape : Shape
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    confidence : float
    """
    vertices, faces = display_mesh(shape.vertices, shape.faces, max_faces=FEWEST_FACES)
    return Shape.from_arrays(vertices, faces, name=shape.name), transform, confidence


def write_contact_sheet(path: Path, tiles: Iterable[Tile], frame: NamedFrame = UNNAMED) -> None:
    """Draw the picture of all tiles and write it as PNG."""
    contact_sheet(tiles, frame).savefig(path, format="png", metadata={"Software": None}, pil_kwargs=_PNG)


def contact_sheet(tiles: Iterable[Tile], frame: NamedFrame = UNNAMED) -> Figure:
    """Return a figure of all tiles, each before (left) and after (right) alignment, seen as ``frame`` names it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    tiles = list(tiles)
    columns = max(2, int(np.ceil(np.sqrt(len(tiles)))))
    rows = -(-len(tiles) // columns)
    size = (2.0 * columns, rows * _ROW_HEIGHT)
    figure = new_figure(figsize=(size[0] * _CELL_INCHES, size[1] * _CELL_INCHES), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, size[0]), ylim=(0.0, size[1]))
    axes.set_axis_off()
    sure = [tile for tile in tiles if not tile[2] < DOUBT] or tiles
    view = camera(((moved_by(transform, shape.vertices), shape.faces) for shape, transform, _ in sure), frame)
    panels = []
    for position, (shape, transform, confidence) in enumerate(tiles):
        row, column = divmod(position, columns)
        corner = np.array([2.0 * column, size[1] - (row + 1) * _ROW_HEIGHT])
        linear = transform[:3, :3]
        panels.append(seen_panel(shape.vertices @ view.T, shape.faces, corner, _COLOUR))
        moved = shape.vertices @ (view @ linear).T
        flipped = bool(np.linalg.det(linear) < 0)
        panels.append(seen_panel(moved, shape.faces, corner + _RIGHT, _COLOUR, flipped=flipped))
        words: dict[str, Any] = {"fontsize": 7, "va": "bottom", "parse_math": False}
        axes.text(corner[0] + _MARGIN, corner[1] + 1.0, shape.name, **words)
        if not np.isnan(confidence):
            right = corner[0] + 2.0 - _MARGIN
            axes.text(
                right,
                corner[1] + 1.0,
                percent(confidence),
                ha="right",
                color="tab:green" if confidence >= DOUBT else "tab:red",
                **words,
            )
    draw_panels(axes, panels)
    return figure


def seen_panel(
    vertices: FloatArray, faces: IntArray, corner: FloatArray, colours: FloatArray, *, flipped: bool = False
) -> Panel:
    """Project a mesh (or point cloud) into the cell of unit size at ``corner``, with Lambert shading.

    Parameters
    ----------
    vertices, faces : ndarray
        Rotated to the screen: to the right, upwards and to the viewer.
    corner : ndarray, shape (2,)
    colours : ndarray, shape (3,) or (v, 3)
        Of all or each of the vertices, in [0, 1].
    flipped : bool
        Whether the triangles face inwards.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = (vertices - 0.5 * (low + high)) / (0.5 * (high - low)[:2].max() or 1.0)
    flat = corner + 0.5 + (0.5 - _MARGIN) * points[:, :2]
    colours = np.broadcast_to(colours, vertices.shape)
    if not len(faces):
        order = np.argsort(points[:, 2])
        depth = np.clip(0.6 + 0.4 * points[order, 2:], 0.0, 1.0)
        return flat[order], depth * colours[order]
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    shades = np.clip(0.25 + 0.7 * np.abs(normals @ _LIGHT * (-1.0 if flipped else 1.0)), 0.0, 1.0)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    lit = np.clip(shades[:, None] * colours[faces].mean(axis=1), 0.0, 1.0)
    return flat[faces][order], lit[order]


def draw_panels(axes: Any, panels: list[Panel]) -> None:
    """Draw the triangles of all panels at once, in order (the painter's algorithm), and the points of clouds."""
    from matplotlib.collections import TriMesh
    from matplotlib.tri import Triangulation

    if meshes := [panel for panel in panels if panel[0].ndim == 3]:
        corners = np.concatenate([corners for corners, _ in meshes]).reshape(-1, 2)
        triangles = np.arange(len(corners)).reshape(-1, 3)
        mesh = TriMesh(Triangulation(corners[:, 0], corners[:, 1], triangles))
        colours: Any = np.repeat(np.concatenate([lit for _, lit in meshes]), 3, axis=0)
        mesh.set_facecolor(colours)
        axes.add_collection(mesh, autolim=False)
    for points, lit in panels:
        if points.ndim == 2:
            axes.scatter(points[:, 0], points[:, 1], s=1, c=lit, linewidths=0)
