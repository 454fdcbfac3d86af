"""What a shape is: vertices, triangles (none for a point cloud), a name, where it came from, and its normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_faces, as_points, read_only, sums_by_owner
from data_tools.notes import Note
from data_tools.poses import moved_by
from data_tools.surface.topology import face_areas, face_crosses

#: Meshes with a larger share of edges on whose side their triangles disagree have normals of unknown sign.
MAX_DEFECTS = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """A triangle mesh or, with no faces, a point cloud. Build it with :meth:`from_arrays`.

    Attributes
    ----------
    name : str
        Unique within a collection; the file's stem by default.
    vertices : ndarray, shape (v, 3)
        In the units of the file. Read-only.
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud. Read-only.
    file : Path or None
        Where it was read from.
    notes : tuple of Note
        What reading and cleaning changed.
    source_indices : ndarray of int, shape (v,), or None
        Where cleaning removed vertices: each vertex's index in the file. Read-only. None: the same as here.
    file_size : int or None
        Where cleaning removed vertices: how many the file has. None: as many as here.
    parts : tuple of (str, int)
        Of a specimen of several parts that move as one: the name of each and how many of the vertices are its own,
        one part after the other. Empty for all others.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    file: Path | None = None
    notes: tuple[Note, ...] = ()
    source_indices: IntArray | None = None
    file_size: int | None = None
    parts: tuple[tuple[str, int], ...] = ()

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike | None = None,
        *,
        name: str = "shape",
        file: Path | None = None,
        notes: tuple[Note, ...] = (),
    ) -> Shape:
        """Check the arrays and build a shape.

        Raises
        ------
        InputError
            If vertices are not finite (v, 3) or a face names a vertex that does not exist.
        """
        points = as_points(vertices, f"{name}: vertices", dim=3)
        triangles = np.empty((0, 3), dtype=np.int64)
        if faces is not None and np.size(faces):
            triangles = as_faces(faces, f"{name}: faces", num_vertices=len(points))
        return cls(
            name=name,
            vertices=read_only(points),
            faces=read_only(triangles),
            file=file,
            notes=notes,
        )

    @classmethod
    def of_parts(cls, name: str, parts: Sequence[Shape], *, file: Path | None = None) -> Shape:
        """Return several meshes, or clouds, that move as one."""
        sizes = [len(part.vertices) for part in parts]
        starts = np.cumsum([0, *sizes[:-1]])
        faces = np.concatenate(
            [part.faces + start for part, start in zip(parts, starts, strict=True)]
        )
        made = Note("made-of-parts", values={"parts": tuple(part.name for part in parts)})
        return replace(
            cls.from_arrays(
                np.concatenate([part.vertices for part in parts]), faces, name=name, file=file
            ),
            notes=(
                made,
                *(replace(note, shapes=(part.name,)) for part in parts for note in part.notes),
            ),
            parts=tuple((part.name, size) for part, size in zip(parts, sizes, strict=True)),
        )

    def split(self) -> dict[str, Shape]:
        """Return the parts by name; nothing where there is only one."""
        found, start = dict[str, Shape](), 0
        for name, size in self.parts:
            faces = (
                self.faces[(self.faces[:, 0] >= start) & (self.faces[:, 0] < start + size)] - start
            )
            found[name] = Shape.from_arrays(self.vertices[start : start + size], faces, name=name)
            start += size
        return found

    @property
    def file_indices(self) -> IntArray:
        """The vertex of the file that each vertex is, shape (v,)."""
        return np.arange(len(self.vertices)) if self.source_indices is None else self.source_indices

    @property
    def file_vertices(self) -> FloatArray:
        """The vertices as the file numbers them, NaN for those that reading left out, shape (w, 3)."""
        vertices = np.full((self.file_size or len(self.vertices), 3), np.nan)
        vertices[self.file_indices] = self.vertices
        return vertices

    @property
    def is_mesh(self) -> bool:
        """Whether the shape has triangles."""
        return len(self.faces) > 0

    @property
    def area(self) -> float:
        """Surface area in squared units of the vertices; NaN for a point cloud."""
        return float(face_areas(self.vertices, self.faces).sum()) if self.is_mesh else float("nan")

    def transformed(self, transform: FloatArray) -> Shape:
        """Return the shape elsewhere; triangles are turned round where the transform mirrors.

        Parameters
        ----------
        transform : ndarray, shape (4, 4)
        """
        faces = self.faces[:, ::-1] if np.linalg.det(transform[:3, :3]) < 0 else self.faces
        vertices = moved_by(transform, self.vertices)
        return replace(
            self, vertices=read_only(vertices), faces=read_only(np.ascontiguousarray(faces))
        )


def outward_normals(
    shape: Shape, *, at: IntArray | None = None, max_defects: float = 0.0
) -> FloatArray:
    """Return unit vertex normals, area-weighted over the triangles, shape (v, 3) or (k, 3).

    They point away from the inside: all are turned round where the signed volume over the centroid is negative, as in
    meshes that are inside out. Empty, shape (0, 3), where the shape has no surface or where its triangles disagree on
    a side (an edge run through twice in the same direction), since normals of random signs are worse than none.

    Parameters
    ----------
    shape : Shape
    at : ndarray of int, shape (k,), optional
        The vertices that matter, by default all.
    max_defects : float
        Share of edges that may be run through twice in the same direction; decimation leaves a few such.
    """
    if not shape.is_mesh or orientation_defects(shape) > max_defects:
        return np.empty((0, 3))
    arms = shape.vertices - shape.vertices.mean(axis=0)
    inside_out = np.vdot(face_crosses(arms, shape.faces), arms.T[:, shape.faces[:, 0]]) < 0
    faces = shape.faces[:, ::-1] if inside_out else shape.faces
    if at is None:
        return vertex_normals(shape.vertices, faces)
    matters = np.zeros(len(shape.vertices), dtype=np.bool_)
    matters[at] = True
    return vertex_normals(shape.vertices, faces[matters[faces].any(axis=1)])[at]


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit vertex normals on the side from which triangles turn left, shape (v, 3); zero where there are none.

    Triangles count by their area.
    """
    at, each = faces.T.ravel(), np.tile(face_crosses(vertices, faces), 3)
    normals = sums_by_owner(each.T, at, len(vertices))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1.0))


def orientation_defects(shape: Shape) -> float:
    """Return the share of directed edges that more than one triangle runs through: 0 where all agree on a side."""
    keys = np.sort((shape.faces * len(shape.vertices) + np.roll(shape.faces, -1, axis=1)).ravel())
    return float((keys[1:] == keys[:-1]).sum() / len(keys))
