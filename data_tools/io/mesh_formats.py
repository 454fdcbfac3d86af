"""Mesh formats. PLY, STL and GLB go through trimesh; what it would accept silently is refused here."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.headers import check_ply, check_stl
from data_tools.io.obj import read_obj
from data_tools.io.off import read_off
from data_tools.io.source import Source
from data_tools.poses import moved_by

# What trimesh logs about damaged files is said by our own errors; without a handler Python would print it.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def read_with_trimesh(source: Source) -> tuple[FloatArray, IntArray]:
    """Return the vertices (v, 3) and triangles (f, 3) of a file as they stand, neither merged nor repaired.

    All parts of a scene are put together in the scene's coordinates. Nothing that a file names is opened.
    """
    path, content = source.path, source.content
    kind = path.suffix[1:].lower()
    promised = check_ply(path, content) if kind == "ply" else {}
    if kind == "stl":
        check_stl(path, content)
    options = {"process": False, "validate": False} | ({"skip_materials": True} if kind == "glb" else {})
    import trimesh

    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, **options)
    parts = []
    for node in scene.graph.nodes_geometry:
        transform, geometry_name = scene.graph[node]
        parts.append(_part(path, scene.geometry[geometry_name], transform))
    if not parts:
        raise InputError(f"{path}: holds no geometry")
    vertices, faces = _concatenate(parts)
    if len(vertices) != promised.get("vertex", len(vertices)) or (promised.get("face") and not len(faces)):
        raise InputError(
            f"{path}: its header promises {promised['vertex']} vertices and {promised.get('face', 0)} faces, "
            f"{len(vertices)} and {len(faces)} could be read"
        )
    return vertices, faces


def _part(path: Path, geometry: Any, transform: FloatArray) -> tuple[FloatArray, IntArray]:
    vertices = np.asarray(geometry.vertices, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(f"{path}: points have shape {vertices.shape}, expected 3 coordinates each")
    faces = np.asarray(getattr(geometry, "faces", []))
    faces = faces.reshape(-1, 3) if faces.size else np.empty((0, 3), dtype=np.int64)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        wrong = faces.min() if faces.min() < 0 else faces.max()
        raise InputError(f"{path}: a face names vertex {wrong}, there are {len(vertices)}, counted from 0")
    if not np.allclose(transform, np.eye(4), rtol=0, atol=0):
        vertices = moved_by(transform, vertices)
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
    return vertices, faces


def _concatenate(parts: list[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([v for v, _ in parts])
    faces = np.concatenate([f + start for (_, f), start in zip(parts, starts[:-1], strict=True)])
    return vertices, faces


#: Reader of each suffix.
READERS = {
    **dict.fromkeys((".ply", ".stl", ".glb"), read_with_trimesh),
    ".obj": read_obj,
    ".off": read_off,
}
