"""What a collection looks like: meshes of few triangles, seen from between front, side and top, and their picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from collalign.products.named_frame import NamedFrame
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray, IntArray
from data_tools.html_pages import new_figure
from data_tools.notes import percent
from data_tools.poses import moved_by
from data_tools.surface.cleaning import decimate
from data_tools.surface.shape import Shape

#: A picture shows the front rotated to the left by the first and from above by the second, which shows three sides.
_AZIMUTH_RAD, _ABOVE_RAD = np.deg2rad([30.0, 20.0])
#: No direction has a name.
UNNAMED = NamedFrame()


def camera(
    surfaces: Iterable[tuple[FloatArray, IntArray]], frame: NamedFrame = UNNAMED
) -> FloatArray:
    """Return the rotation from the common frame to the screen in three-quarter view.

    Parameters
    ----------
    surfaces : iterable of (vertices, faces)
        In the common frame, shapes (v, 3) and (f, 3); no faces for a point cloud.
    frame : NamedFrame
        Up and front. Without them they are those of :func:`principal_view`; where only up has a name, the front is
        the level direction in which the surfaces are thinnest.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows are the directions to the right, upwards and to the viewer.
    """
    up, front = frame.directions
    if up is None:
        view = principal_view(surfaces)
    else:
        if front is None:
            level = np.eye(3) - np.outer(up, up)
            second, third = _moments(surfaces)
            third = np.einsum("ijk,ia,jb,kc->abc", third, level, level, level, optimize=True)
            front = _principal(level @ second @ level, third)[1]
        view = np.stack([np.cross(up, front), up, front])
    (c, s), (a, b) = ((np.cos(angle), np.sin(angle)) for angle in (_AZIMUTH_RAD, _ABOVE_RAD))
    rotation = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    above = np.array([[1.0, 0.0, 0.0], [0.0, a, -b], [0.0, b, a]])
    return np.asarray(above @ rotation @ view)


def principal_view(surfaces: Iterable[tuple[FloatArray, IntArray]]) -> FloatArray:
    """Return the rotation that shows the longest axis level and the shortest to the viewer, shape (3, 3).

    The axes are the principal ones of all surfaces, each centred and brought to one size, so they rotate with the
    collection. Of the three directions the two in which mass lies least evenly (by skewness) have the thin end in
    front, handedness decides the third.
    """
    return _principal(*_moments(surfaces))


def _moments(surfaces: Iterable[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, FloatArray]:
    """Return the second and third moments of all surfaces, shapes (3, 3) and (3, 3, 3)."""
    second, third = np.zeros((3, 3)), np.zeros((3, 3, 3))
    for vertices, faces in surfaces:
        points, weights = _spread(vertices, faces)
        second += np.einsum("n,ni,nj->ij", weights, points, points)
        third += np.einsum("n,ni,nj,nk->ijk", weights, points, points, points, optimize=True)
    return second, third


def _principal(second: FloatArray, third: FloatArray) -> FloatArray:
    variances, vectors = np.linalg.eigh(second)
    axes = vectors[:, ::-1].T
    skewness = np.einsum("ijk,ai,aj,ak->a", third, axes, axes, axes, optimize=True)
    skewness /= np.maximum(variances[::-1], np.finfo(float).eps * max(variances[-1], 1.0)) ** 1.5
    axes *= np.where(skewness < 0, -1.0, 1.0)[:, None]
    if np.linalg.det(axes) < 0:
        axes[np.abs(skewness).argmin()] *= -1.0
    return np.asarray(axes)


def _spread(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return points of a surface about its centroid, root mean square radius one, and their shares of its area."""
    points, weights = vertices, np.ones(len(vertices))
    if len(faces):
        corners = vertices[faces]
        points = corners.mean(axis=1)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        weights = np.linalg.norm(np.cross(first, second), axis=1)
    weights = weights / (weights.sum() or 1.0)
    points = points - weights @ points
    return points / (np.sqrt(weights @ (points**2).sum(axis=1)) or 1.0), weights


#: A report holds about this many triangles in all, but each shape between the two limits.
_FACES_IN_ALL = 200_000
FEWEST_FACES, _MOST_FACES = 1_500, 4_000
#: No collection holds more triangles than this: of many thousand shapes each has fewer than :data:`FEWEST_FACES`.
_MOST_IN_ALL = 4_000_000


def faces_per_shape(num_shapes: int) -> int:
    """Return triangles per shape that keep a report of ``num_shapes`` shapes small enough to send."""
    num = max(num_shapes, 1)
    return min(
        int(np.clip(_FACES_IN_ALL // num, FEWEST_FACES, _MOST_FACES)), max(_MOST_IN_ALL // num, 1)
    )


def display_mesh(
    vertices: FloatArray, faces: IntArray, *, max_faces: int
) -> tuple[FloatArray, IntArray]:
    """Decimate a mesh, quickly rather than accurately, or thin out a point cloud evenly.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud.
    max_faces : int
        Triangles (points for a cloud) to keep, about.

    Returns
    -------
    vertices : ndarray, shape (w, 3)
    faces : ndarray of int, shape (g, 3)
    """
    if not len(faces):
        stride = -(-len(vertices) // max_faces)
        return np.ascontiguousarray(vertices[::stride]), np.empty((0, 3), dtype=np.int64)
    return decimate(vertices, faces, max_faces, most_collapsed=5 * max_faces)


if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

_LIGHT = np.array([0.3, 0.5, 0.81])
#: Of shapes on pictures, red, green and blue.
BONE_COLOUR = np.array([0.85, 0.8, 0.68])
#: Pixels of a cell on the contact sheet, and of the height of its words.
_CELL, _WORDS = 150, 9.7
#: A picture is drawn so many times as large, and reduced: edges are smooth then.
_FINER = 2
#: Widths of the points of a cloud, in pixels: of many, of a few, and of any number times its root.
_FINE_POINT, _COARSE_POINT, _POINTS = 1.5, 5.0, 16.0
#: In cells: of a row with its line of text, and of the space left free around a shape.
_ROW_HEIGHT, _PANEL_MARGIN = 1.2, 0.03
#: From the cell of a shape before alignment to the one after.
_RIGHT = np.array([1.0, 0.0])
#: Half the time of the usual level, for 4 % more bytes.
_PNG = {"compress_level": 3}
#: Pixels of an inch of a figure.
_DPI = 100
#: Stops of viridis, as on the pages of a report.
_VIRIDIS = bytes.fromhex("440154 482878 3e4989 31688e 26828e 1f9e89 35b779 6ece58 b5de2b fde725")
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
    write_picture(path, contact_sheet(tiles, frame))


def write_picture(path: Path, picture: Image) -> None:
    """Write a picture as PNG."""
    picture.save(path, format="png", **_PNG)


def figure_of(picture: Image) -> Figure:
    """Return a picture as a figure of Matplotlib, which notebooks show."""
    figure = new_figure(figsize=(picture.width / _DPI, picture.height / _DPI), dpi=_DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.imshow(np.asarray(picture))
    return figure


def viridis(shares: FloatArray) -> FloatArray:
    """Return colours in [0, 1], shape (n, 3), of shares in [0, 1], shape (n,), dark blue to yellow."""
    stops = np.frombuffer(_VIRIDIS, dtype=np.uint8).reshape(-1, 3) / 255.0
    places = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(shares, places, channel) for channel in stops.T], axis=1)


def contact_sheet(tiles: Iterable[Tile], frame: NamedFrame = UNNAMED) -> Image:
    """Return a picture of all tiles, each before (left) and after (right) alignment, seen as ``frame`` names it.

    It is drawn by Pillow, which starts in a fortieth of the time of Matplotlib.
    """
    from PIL.ImageDraw import Draw

    tiles = list(tiles)
    columns = max(2, int(np.ceil(np.sqrt(len(tiles)))))
    height = -(-len(tiles) // columns) * _ROW_HEIGHT
    sure = [tile for tile in tiles if not tile[2] < DOUBT] or tiles
    posed = ((moved_by(transform, shape.vertices), shape.faces) for shape, transform, _ in sure)
    view, panels, corners = camera(posed, frame), [], []
    for position, (shape, transform, _) in enumerate(tiles):
        row, column = divmod(position, columns)
        corners.append(corner := np.array([2.0 * column, height - (row + 1) * _ROW_HEIGHT]))
        linear = transform[:3, :3]
        panels.append(seen_panel(shape.vertices @ view.T, shape.faces, corner, BONE_COLOUR))
        moved = shape.vertices @ (view @ linear).T
        flipped = bool(np.linalg.det(linear) < 0)
        panels.append(seen_panel(moved, shape.faces, corner + _RIGHT, BONE_COLOUR, flipped=flipped))
    sheet = painted(panels, (2.0 * columns, height), _CELL)
    pen, font = Draw(sheet), font_of(_WORDS)
    for (shape, _, confidence), (left, low) in zip(tiles, corners, strict=True):
        bottom = _CELL * (height - low - 1.0)
        pen.text((_CELL * (left + _PANEL_MARGIN), bottom), shape.name, "black", font, "ls")
        if not np.isnan(confidence):
            colour = "green" if confidence >= DOUBT else "red"
            place = (_CELL * (left + 2.0 - _PANEL_MARGIN), bottom)
            pen.text(place, percent(confidence), colour, font, "rs")
    return sheet


def font_of(height: float) -> FreeTypeFont:
    """Return the font of Matplotlib, which has the letters of more languages than Pillow's, without importing it.

    The height of its words is in pixels.
    """
    from PIL.ImageFont import truetype

    place = find_spec("matplotlib")
    assert place is not None
    assert place.origin is not None
    fonts = Path(place.origin).parent / "mpl-data" / "fonts" / "ttf"
    return truetype(fonts / "DejaVuSans.ttf", height)


def seen_panel(
    vertices: FloatArray,
    faces: IntArray,
    corner: FloatArray,
    colours: FloatArray,
    *,
    flipped: bool = False,
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
    points = cell_places(vertices, vertices, corner)
    flat = points[:, :2]
    colours = np.broadcast_to(colours, vertices.shape)
    if not len(faces):
        order = np.argsort(points[:, 2])
        depth = np.clip(0.6 + 0.4 * points[order, 2:] / (0.5 - _PANEL_MARGIN), 0.0, 1.0)
        return flat[order], depth * colours[order]
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    shades = np.clip(0.25 + 0.7 * np.abs(normals @ _LIGHT * (-1.0 if flipped else 1.0)), 0.0, 1.0)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    lit = np.clip(shades[:, None] * colours[faces].mean(axis=1), 0.0, 1.0)
    return flat[faces][order], lit[order]


def cell_places(points: FloatArray, vertices: FloatArray, corner: FloatArray) -> FloatArray:
    """Return where points (n, 3) lie in the cell that shows a surface, to the right, upwards and to the viewer.

    Parameters
    ----------
    points, vertices : ndarray, shapes (n, 3) and (v, 3)
        Rotated to the screen.
    corner : ndarray, shape (2,)
        Of the cell.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    places = (points - 0.5 * (low + high)) / (0.5 * (high - low)[:2].max() or 1.0)
    return (0.5 - _PANEL_MARGIN) * places + np.append(corner + 0.5, 0.0)


def painted(panels: Sequence[Panel], size: tuple[float, float], pixels: float) -> Image:
    """Paint the triangles of panels, and the points of clouds, each over what comes before (the painter's algorithm).

    Parameters
    ----------
    panels : sequence of Panel
    size : tuple of float
        Width and height of the picture, in cells.
    pixels : float
        Of a cell.
    """
    from PIL import Image
    from PIL.ImageDraw import Draw

    width, height = (_FINER * round(length * pixels) for length in size)
    picture = Image.new("RGB", (width, height), "white")
    pen = Draw(picture)
    for places, lit in panels:
        flipped = (places * [1.0, -1.0] + [0.0, size[1]]) * (_FINER * pixels)
        colours = map(tuple, np.round(255.0 * lit).astype(np.int64).tolist())
        if places.ndim == 3:
            for corners, colour in zip(flipped.reshape(-1, 6).tolist(), colours, strict=True):
                pen.polygon(corners, colour)
        else:
            point = np.clip(_POINTS / len(places) ** 0.5, _FINE_POINT, _COARSE_POINT)
            half = 0.5 * _FINER * point
            boxes = np.hstack([flipped - half, flipped + half]).tolist()
            for box, colour in zip(boxes, colours, strict=True):
                pen.ellipse(box, colour)
    return picture.reduce(_FINER)


def draw_panels(axes: Any, panels: Sequence[Panel]) -> None:
    """Paint panels into axes of Matplotlib whose limits are those of the cells."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    pixels = axes.get_window_extent().width / (right - left)
    axes.imshow(
        np.asarray(painted(panels, (right, high), pixels)),
        extent=(left, right, low, high),
        aspect=axes.get_aspect(),
    )
