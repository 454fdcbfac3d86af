"""A desktop window on an aligned collection, by Polyscope (an extra: ``pip install 'collalign[viewer]'``)."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from collalign.output.evidence.file import load_view
from collalign.output.report.payload import sample_colors
from collalign.products.evidence import CollectionView
from data_tools.arrays import FloatArray
from data_tools.errors import InputError, UnavailableError

#: Distance between neighbours on the grid, in units of the largest shape.
_SPACING = 2.1


def view(
    collection: CollectionView | Path | str,
    *,
    names: Sequence[str] | None = None,
    overlay: bool = False,
    backend: str = "auto",
    show: bool = True,
) -> None:
    """Open a window with the aligned shapes, on a grid or laid over each other, with their samples.

    Every shape can be switched off in the list on the left; samples of equal label have equal colours.

    Parameters
    ----------
    collection : CollectionView or path
        A path is the folder that ``collalign align`` wrote.
    names : sequence of str, optional
        Shapes to show; all by default.
    overlay : bool
        In one place instead of side by side.
    backend : str
        Polyscope's rendering backend.
    show : bool
        Whether to wait until the window is closed; otherwise the scene is left for the caller.

    Raises
    ------
    InputError
        If Polyscope is not installed or cannot open a window, or a name is unknown.
    """
    data = collection if isinstance(collection, CollectionView) else load_view(collection)
    chosen = [data.index(name) for name in names] if names else list(range(data.num_shapes))
    window = _start(backend)
    entries = scene(data, chosen, overlay=overlay)
    for structure, arguments, options in entries:
        _register(window, structure, arguments, options)
    _look_at(window, np.concatenate([arguments[1] for _, arguments, _ in entries]))
    if show:
        window.show()


def scene(
    data: CollectionView, chosen: Sequence[int], *, overlay: bool
) -> list[tuple[str, tuple[Any, ...], dict[str, Any]]]:
    """What is drawn: surfaces or clouds, and samples, each moved to its place.

    Returns
    -------
    list of (structure, arguments, options)
        ``"mesh"`` with (name, vertices, faces), ``"points"`` with (name, positions) and perhaps ``colors``.
    """
    colors = sample_colors(data.aligned_samples)
    aligned = [_moved(data.vertices[at], data.transforms[at]) for at in chosen]
    places = np.zeros((len(chosen), 3)) if overlay else _grid(aligned)
    entries: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
    for at, points, place in zip(chosen, aligned, places, strict=True):
        name, faces = data.names[at], data.faces[at]
        entry = ("mesh", (name, points + place, faces)) if len(faces) else ("points", (name, points + place))
        entries.append((*entry, {}))
        known = ~np.isnan(data.samples[at]).any(axis=1)
        samples = data.aligned_samples[at][known] + place
        entries.append(("points", (f"{name} samples", samples), {"colors": colors[known]}))
    return entries


def _start(backend: str) -> Any:
    try:
        window = import_module("polyscope")
    except ImportError as error:
        raise UnavailableError(
            "the desktop viewer needs Polyscope; install it with: pip install 'collalign[viewer]'; "
            "report.html needs nothing"
        ) from error
    try:
        window.set_verbosity(1)
        window.init(backend)
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"no window can be opened here with backend {backend!r} (is there a display?); "
            "open report.html in a browser instead"
        ) from error
    window.remove_all_structures()
    window.set_ground_plane_mode("none")
    return window


def _register(window: Any, structure: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> None:
    if structure == "mesh":
        window.register_surface_mesh(*arguments, smooth_shade=True)
        return
    cloud = window.register_point_cloud(*arguments)
    if "colors" in options:
        cloud.add_color_quantity("label", options["colors"], enabled=True)


def _look_at(window: Any, points: FloatArray) -> None:
    """Stand back until everything fits into the window."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre = 0.5 * (low + high)
    distance = float(np.linalg.norm(high - low))
    window.look_at(centre + np.array([0.0, 0.0, distance]), centre)


def _moved(points: FloatArray, transform: FloatArray) -> FloatArray:
    return points @ transform[:3, :3].T + transform[:3, 3]


def _grid(shapes: list[FloatArray]) -> FloatArray:
    """Places on a square grid, far enough apart for the largest shape, shape (n, 3)."""
    radius = max(
        (float(np.linalg.norm(points - points.mean(axis=0), axis=1).max()) for points in shapes), default=1.0
    )
    columns = int(np.ceil(np.sqrt(len(shapes)))) or 1
    at = np.arange(len(shapes))
    cells = np.stack([at % columns, -(at // columns), 0 * at], axis=1).astype(np.float64)
    return _SPACING * radius * cells
