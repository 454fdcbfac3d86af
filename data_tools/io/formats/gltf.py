"""glTF 2.0, as GLB or as JSON with its buffers: every kind of number, strip, node and morph target of its meshes."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import (
    RawShape,
    checked_indices,
    fan_triangles,
    joined,
    no_faces,
    not_kept,
    strip_triangles,
)
from data_tools.io.source import Room, Source
from data_tools.poses import moved_by

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_MODES = {0: "points", **dict.fromkeys((1, 2, 3), "lines"), 4: "triangles", 5: "strip", 6: "fan"}
_COMPRESSIONS = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
_ATTRIBUTES = {"COLOR_0": "colours", "TEXCOORD_0": "texture coordinates"}


def read_gltf(source: Source) -> RawShape:
    """Return the vertices and triangles of all meshes of a scene, in its coordinates.

    Parameters
    ----------
    source : Source
        A GLB file, or a glTF file whose buffers it holds itself or has as ``companions``.

    Raises
    ------
    InputError
        If it is no glTF 2.0, ends early, is compressed with Draco or meshopt, or refers to what is not there.
    """
    path, content = source.path, source.content
    text, binary = _glb_chunks(path, content) if content[:4] == b"glTF" else (content, None)
    try:
        document = json.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        raise InputError(f"{path}: not a glTF file, it holds no readable JSON") from None
    if (
        not isinstance(document, dict)
        or str(document.get("asset", {}).get("version", "2.0"))[:1] != "2"
    ):
        raise InputError(
            f"{path}: not glTF 2.0; open and save it with a program of today, such as Blender"
        )
    return _Document(source, document, binary).shape()


def _glb_chunks(path: Path, content: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON and, where there are any, the binary data of a GLB file."""
    version, length = (int.from_bytes(content[at : at + 4], "little") for at in (4, 8))
    if version != 2:
        raise InputError(
            f"{path}: GLB of version {version}, 2 is read; open and save it with a program of today"
        )
    if length > len(content):
        raise InputError(
            f"{path}: truncated, its header promises {length} bytes and it has {len(content)}"
        )
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= len(content) and len(chunks) < 2:
        size = int.from_bytes(content[at : at + 4], "little")
        if at + 8 + size > len(content):
            raise InputError(f"{path}: truncated, a part of {size} bytes goes beyond its end")
        chunks.setdefault(content[at + 4 : at + 8], content[at + 8 : at + 8 + size])
        at += 8 + size
    return chunks.get(b"JSON", b""), chunks.get(b"BIN\0")


class _Document:
    """The tables of one glTF file."""

    def __init__(self, source: Source, document: dict[str, Any], binary: bytes | None) -> None:
        self.path = source.path
        self._tables = document
        self._binary = binary
        self._files = source.companions
        self._buffers: dict[int, bytes] = {}
        self._lost: set[str] = set()
        self._room = Room.of(source)  # copies of one mesh, or a count, could ask for any memory

    def shape(self) -> RawShape:
        parts = [
            part
            for mesh, weights, matrix in self._placed_meshes()
            for part in self._mesh(mesh, weights, matrix)
        ]
        if not parts:
            raise InputError(f"{self.path}: holds no geometry")
        return RawShape(*joined(parts), not_kept(self._lost))

    def _entry(self, table: str, index: Any) -> dict[str, Any]:
        """Return an entry of a table by its number."""
        entries = self._tables.get(table, [])
        if (
            not isinstance(index, int)
            or not isinstance(entries, list)
            or not 0 <= index < len(entries)
        ):
            raise InputError(
                f"{self.path}: refers to number {index!r:.20} of its {table}, which is not there"
            )
        if not isinstance(entries[index], dict):
            raise InputError(f"{self.path}: damaged, number {index} of its {table} is no entry")
        return entries[index]

    def _placed_meshes(self) -> Iterator[tuple[dict[str, Any], Any, FloatArray]]:
        """Go through the meshes of the scene, each with the weights of its morph targets and its place."""
        nodes = self._tables.get("nodes", [])
        if self._tables.get("scenes"):
            roots = self._entry("scenes", self._tables.get("scene", 0)).get("nodes", [])
        else:
            below = {child for node in nodes for child in node.get("children", [])}
            roots = [at for at in range(len(nodes)) if at not in below]
        waiting = [(root, np.eye(4)) for root in reversed(roots)]
        seen: set[int] = set()
        while waiting:
            at, above = waiting.pop()
            node = self._entry("nodes", at)
            if at in seen:
                raise InputError(f"{self.path}: damaged, its node {at} is in two places")
            seen.add(at)
            if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
                raise InputError(
                    f"{self.path}: places copies of a mesh by EXT_mesh_gpu_instancing, which is not read; "
                    "export it without instancing"
                )
            place = above @ _matrix(node)
            if "mesh" in node:
                # The skeleton places a skinned mesh, not its node (glTF 2.0, 3.7.3.3).
                is_skinned = "skin" in node
                self._lost |= {"the pose of its skeleton"} if is_skinned else set()
                mesh = self._entry("meshes", node["mesh"])
                weights = node.get("weights", mesh.get("weights", []))
                yield mesh, weights, np.eye(4) if is_skinned else place
            waiting += [(child, place) for child in reversed(node.get("children", []))]

    def _mesh(
        self, mesh: dict[str, Any], weights: Any, place: FloatArray
    ) -> Iterator[tuple[FloatArray, IntArray]]:
        """Return the parts of a mesh; those that share vertices are one."""
        shared: dict[str, tuple[FloatArray, list[IntArray]]] = {}
        for primitive in mesh["primitives"]:
            mode = _MODES[primitive.get("mode", 4)]
            if mode == "lines":
                self._lost.add("lines")
                continue
            if "POSITION" not in primitive["attributes"]:
                continue
            key = json.dumps([primitive["attributes"]["POSITION"], primitive.get("targets")])
            if key not in shared:
                shared[key] = self._vertices(primitive, weights), []
            shared[key][1].append(self._faces(primitive, mode, len(shared[key][0])))
            self._lost |= {
                thing for name, thing in _ATTRIBUTES.items() if name in primitive["attributes"]
            }
            self._lost |= {"materials"} if "material" in primitive else set()
        is_mirrored = np.linalg.det(place[:3, :3]) < 0
        for vertices, faces in shared.values():
            triangles = np.concatenate(faces)
            yield moved_by(place, vertices), triangles[:, ::-1] if is_mirrored else triangles

    def _vertices(self, primitive: dict[str, Any], weights: Any) -> FloatArray:
        vertices = self._numbers(primitive["attributes"]["POSITION"], 3, primitive)
        for weight, target in zip(weights, primitive.get("targets", []), strict=False):
            if weight and "POSITION" in target:
                vertices = vertices + float(weight) * self._numbers(
                    target["POSITION"], 3, primitive
                )
        return vertices

    def _faces(self, primitive: dict[str, Any], mode: str, num_vertices: int) -> IntArray:
        if mode == "points":
            return no_faces()
        if "indices" in primitive:
            corners = checked_indices(
                self.path, self._numbers(primitive["indices"], 1, primitive)[:, 0], num_vertices
            )
        else:
            self._take(num_vertices)
            corners = np.arange(num_vertices)
        sizes = np.array([len(corners)])
        if mode == "strip":
            return strip_triangles(corners, sizes)
        if mode == "fan":
            return fan_triangles(corners, sizes)
        if len(corners) % 3:
            raise InputError(
                f"{self.path}: damaged, a mesh of triangles has {len(corners)} corners"
            )
        return corners.reshape(-1, 3)

    def _numbers(self, index: Any, width: int, primitive: dict[str, Any]) -> FloatArray:
        """Return the rows of an accessor, shape (count, width); normalised integers as the fractions they mean."""
        accessor = self._entry("accessors", index)
        count = _whole(accessor["count"])
        if _WIDTHS.get(accessor["type"]) != width:
            raise InputError(
                f"{self.path}: damaged, an accessor of type {accessor['type']!r:.20} is in a wrong place"
            )
        kind = np.dtype(_COMPONENTS[accessor["componentType"]])
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            values = self._rows(accessor, count, kind, width)
        elif sparse is None:
            raise self._without_data(primitive)
        else:
            self._take(count * width)
            values = np.zeros((count, width))
        if sparse is not None:
            num, at = _whole(sparse["count"]), sparse["indices"]
            places = self._rows(at, num, np.dtype(_COMPONENTS[at["componentType"]]), 1)[:, 0]
            values = values.copy()
            values[checked_indices(self.path, places, count)] = self._rows(
                sparse["values"], num, kind, width
            )
        if accessor.get("normalized") and kind.kind != "f":
            return np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def _take(self, num: int) -> None:
        """Count numbers that are going to be made."""
        self._room.take(8 * num, "export it with fewer copies of its meshes, all accessors in full")

    def _rows(
        self, view: dict[str, Any], count: int, kind: np.dtype[Any], width: int
    ) -> FloatArray:
        """Return numbers of a buffer view, which must lie in it, shape (count, width)."""
        entry = self._entry("bufferViews", view["bufferView"])
        data = self._buffer(entry)
        first, length = _whole(entry.get("byteOffset", 0)), _whole(entry["byteLength"])
        stride, size = (
            _whole(entry.get("byteStride", 0)) or kind.itemsize * width,
            kind.itemsize * width,
        )
        start = first + _whole(view.get("byteOffset", 0))
        if count and (
            start + (count - 1) * stride + size > min(first + length, len(data)) or stride < size
        ):
            raise InputError(
                f"{self.path}: truncated, {count} entries of {size} bytes go beyond the end of their data"
            )
        self._take(count * width)
        rows = np.ndarray(
            (count, width),
            dtype=kind,
            buffer=data,
            offset=start if count else 0,
            strides=(stride, kind.itemsize),
        )
        return rows.astype(np.float64)

    def _buffer(self, view: dict[str, Any]) -> bytes:
        """Return the buffer of a view: the file's own, one that its text holds, or a file next to it."""
        at = view["buffer"]
        entry = self._entry("buffers", at)
        if at not in self._buffers:
            uri = entry.get("uri")
            if uri is None and at == 0 and self._binary is not None:
                self._buffers[at] = self._binary
            elif isinstance(uri, str) and uri.startswith("data:"):
                self._buffers[at] = _data_of(self.path, uri)
            elif isinstance(uri, str) and uri in self._files:
                self._buffers[at] = self._files[uri]
            else:
                raise self._without_data(view)
        return self._buffers[at]

    def _without_data(self, entry: dict[str, Any]) -> InputError:
        """Return the error of a mesh whose numbers are not there, which names the compression that has them."""
        named = [
            word for name, word in _COMPRESSIONS.items() if name in entry.get("extensions", {})
        ]
        if named:
            return InputError(
                f"{self.path}: is compressed with {named[0]}, which is not read. Export it without compression, or "
                "unpack it with `npx @gltf-transform/cli copy IN.glb OUT.glb`"
            )
        return InputError(f"{self.path}: damaged, it names data that is not in it")


def _matrix(node: dict[str, Any]) -> FloatArray:
    """Return what takes a node's coordinates to those above it, shape (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1]), dtype=np.float64).reshape(4)
    norm = x * x + y * y + z * z + w * w
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    place = np.eye(4)
    place[:3, :3] += 2.0 / norm * (w * cross + cross @ cross)
    place[:3, :3] *= np.array(node.get("scale", [1, 1, 1]), dtype=np.float64).reshape(3)
    place[:3, 3] = np.array(node.get("translation", [0, 0, 0]), dtype=np.float64).reshape(3)
    return place


def _whole(value: Any) -> int:
    if not isinstance(value, int) or value < 0:
        raise ValueError("a count or place of a glTF file is no whole number")
    return value


def _data_of(path: Path, uri: str) -> bytes:
    """Return what a data URI holds."""
    head, _, body = uri.partition(",")
    try:
        return (
            base64.b64decode(body, validate=True)
            if head.endswith(";base64")
            else unquote_to_bytes(body)
        )
    except binascii.Error:
        raise InputError(f"{path}: damaged, a buffer in its text is not base64") from None
