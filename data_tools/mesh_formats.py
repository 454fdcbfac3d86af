"""Mesh formats, read by trimesh; what it would accept silently is refused here."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.headers import check_obj, check_off, check_ply, check_stl

# What trimesh logs about damaged files is said by our own errors; without a handler Python would print it.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def read_with_trimesh(path: Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices (v, 3) and triangles (f, 3) of a file as they stand, neither merged nor repaired.

    All parts of a scene are put together in the scene's coordinates. Names inside a file reach only files of its own
    folder, and materials are never opened.
    """
    kind = path.suffix[1:].lower()
    content = path.read_bytes()
    _CHECKS.get(kind, _no_check)(path, content)
    resolver = _SiblingResolver(path.parent) if kind == "gltf" else None
    options: dict[str, Any] = {"process": False, "validate": False}
    if kind in ("obj", "glb", "gltf"):
        options["skip_materials"] = True
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=resolver, **options)
    parts = []
    for node in scene.graph.nodes_geometry:
        transform, geometry_name = scene.graph[node]
        parts.append(_part(path, scene.geometry[geometry_name], transform))
    if not parts:
        raise InputError(f"{path}: holds no geometry")
    return _concatenate(parts)


def _part(path: Path, geometry: Any, transform: FloatArray) -> tuple[FloatArray, IntArray]:
    vertices = np.asarray(geometry.vertices, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(f"{path}: points have shape {vertices.shape}, expected 3 coordinates each")
    faces = np.asarray(getattr(geometry, "faces", None) if hasattr(geometry, "faces") else [])
    faces = faces.reshape(-1, 3) if faces.size else np.empty((0, 3), dtype=np.int64)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise InputError(f"{path}: a face names vertex {faces.max()}, there are {len(vertices)}")
    if not np.allclose(transform, np.eye(4), rtol=0, atol=0):
        vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
    return vertices, faces


def _concatenate(parts: list[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([v for v, _ in parts])
    faces = np.concatenate([f + start for (_, f), start in zip(parts, starts[:-1], strict=True)])
    return vertices, faces


class _SiblingResolver(trimesh.resolvers.Resolver):
    """Opens buffers named by a GLTF file, in the same folder only."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def get(self, name: str) -> bytes:
        path = (self._folder / name.strip()).resolve()
        if path.parent != self._folder:
            raise InputError(f"{name}: named by a file outside of its folder")
        return path.read_bytes()

    def write(self, name: str, data: Any) -> None:
        raise InputError(f"{name}: files are not written while reading")

    def namespaced(self, namespace: str) -> _SiblingResolver:
        raise InputError(f"{namespace}: folders are not followed")

    def keys(self) -> list[str]:
        return []


def _no_check(path: Path, content: bytes) -> None:
    """GLB and GLTF state their lengths, and trimesh checks them."""


_CHECKS = {"ply": check_ply, "off": check_off, "obj": check_obj, "stl": check_stl}

#: Reader of each suffix.
READERS = {f".{kind}": read_with_trimesh for kind in ("ply", "off", "obj", "stl", "glb", "gltf")}
