"""A picture of every shape before and after alignment, side by side from the same viewpoint."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.collection import DOUBT
from collalign.output.evidence.display_mesh import display_mesh
from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.shape import Shape

_LIGHT = np.array([0.3, 0.5, 0.81])
_VIEW = np.array([[0.9, 0.0, -0.44], [-0.2, 0.89, -0.41], [0.39, 0.46, 0.8]])
_MAX_FACES = 1500
_CELL_INCHES = 1.5
_MAX_COLUMNS = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Tile:
    """One shape for the sheet: its mesh (decimated), its transform, and how far it is trusted (NaN: unknown)."""

    name: str
    vertices: FloatArray
    faces: IntArray
    transform: FloatArray
    confidence: float


def tile_of(shape: Shape, transform: FloatArray, confidence: float) -> Tile:
    """Decimate a shape for drawing.

    Parameters
    ----------
    shape : Shape
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    confidence : float
    """
    vertices, faces = display_mesh(shape.vertices, shape.faces, max_faces=_MAX_FACES)
    return Tile(name=shape.name, vertices=vertices, faces=faces, transform=transform, confidence=confidence)


def draw_contact_sheet(tiles: Iterable[Tile], path: Path) -> None:
    """Draw all tiles, each before (left) and after (right) alignment, and write a PNG.

    Parameters
    ----------
    tiles : iterable of Tile
    path : Path
        The PNG to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    tiles = list(tiles)
    columns = min(_MAX_COLUMNS, max(2, int(np.ceil(np.sqrt(len(tiles))))))
    rows = -(-len(tiles) // columns)
    figure = Figure(figsize=(columns * 2 * _CELL_INCHES, rows * _CELL_INCHES * 1.2), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns * 2, squeeze=False)
    for axes in grid.ravel():
        axes.set_axis_off()
        axes.set_aspect("equal")
    for position, tile in enumerate(tiles):
        row, column = divmod(position, columns)
        before, after = grid[row, 2 * column], grid[row, 2 * column + 1]
        _draw(before, tile.vertices, tile.faces, flipped=False)
        moved = tile.vertices @ tile.transform[:3, :3].T
        _draw(after, moved, tile.faces, flipped=bool(np.linalg.det(tile.transform[:3, :3]) < 0))
        before.set_title(tile.name, fontsize=7, loc="left", parse_math=False)
        if not np.isnan(tile.confidence):
            after.set_title(f"{tile.confidence:.2f}", fontsize=7, loc="right", color=_colour(tile.confidence))
    figure.savefig(path, format="png", metadata={"Software": None})


def _draw(axes: Any, vertices: FloatArray, faces: IntArray, *, flipped: bool) -> None:
    """Draw one shaded mesh (or point cloud), centred and scaled to the cell: painter's algorithm, Lambert shading."""
    from matplotlib.collections import PolyCollection

    points = (vertices - vertices.mean(axis=0)) @ _VIEW.T
    points /= np.abs(points).max() or 1.0
    axes.set_xlim(-1.05, 1.05)
    axes.set_ylim(-1.05, 1.05)
    if not len(faces):
        order = np.argsort(points[:, 2])
        axes.scatter(points[order, 0], points[order, 1], s=1, c=points[order, 2], cmap="bone", linewidths=0)
        return
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    facing = normals @ _LIGHT * (-1.0 if flipped else 1.0)
    shade = np.clip(0.25 + 0.7 * np.abs(facing), 0.0, 1.0)[:, None]
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    colours = np.clip(shade * np.array([0.85, 0.8, 0.68]), 0, 1)[order]
    axes.add_collection(
        PolyCollection(corners[order][:, :, :2], facecolors=colours, edgecolors=colours, linewidths=0.2)
    )


def _colour(confidence: float) -> str:
    return "tab:green" if confidence >= DOUBT else "tab:orange" if confidence >= 0.5 else "tab:red"
