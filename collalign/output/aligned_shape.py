"""One shape of a result, all of them in their order, and shapes as objects of trimesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np

from collalign.analysis.procrustes import centroid_sizes
from collalign.output.moved_files import is_there
from collalign.products.consistent_maps import position_of
from collalign.products.incomplete import Incomplete
from collalign.products.pair import Alternative
from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line
from data_tools.errors import InputError, UnavailableError
from data_tools.io.files import composed
from data_tools.io.source import inputs_of
from data_tools.poses import each_moved_by, scales_of
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedShape:
    """One shape of a result.

    Attributes
    ----------
    name, file : str
        The file is empty where the shape came from memory.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    reflected : bool
    confidence : float
        NaN where it is not known.
    centroid_size : float
        Of its corresponding points, in the unit of its file.
    part : int
        Shapes of different parts are not aligned with each other.
    alternatives : tuple of Alternative
        Other poses, the likeliest first.
    """

    name: str
    file: str
    transform: FloatArray
    reflected: bool
    confidence: float
    centroid_size: float
    part: int
    alternatives: tuple[Alternative, ...]

    __repr__ = one_line


class PosedShapes:
    """The shapes of a result in natural order of their names, and what their poses and files say."""

    names: tuple[str, ...]
    files: tuple[str, ...]
    transforms: FloatArray
    confidence: FloatArray
    part_numbers: IntArray
    alternatives: tuple[tuple[Alternative, ...], ...]
    landmarks: FloatArray
    incomplete: tuple[Incomplete, ...]
    own: tuple[str, ...]
    folder: Path | None

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[AlignedShape]:
        return (self[at] for at in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        """Return the transforms, shape (N, 4, 4), for ``np.asarray``; read-only where they are not copied.

        Raises
        ------
        ValueError
            If no copy may be made (``copy=False``) and the type asked for needs one.
        """
        wanted = np.dtype(np.float64 if dtype is None else dtype)
        if copy is False and wanted != self.transforms.dtype:
            raise ValueError(f"the transforms are float64 and cannot be {wanted} without a copy")
        return self.transforms.astype(wanted, copy=bool(copy))

    def __contains__(self, shape: object) -> bool:
        """Whether there is a shape of this name."""
        name = shape.name if isinstance(shape, AlignedShape) else shape
        return (composed(name) if isinstance(name, str) else name) in self.names

    @overload
    def __getitem__(self, shape: str | int) -> AlignedShape: ...
    @overload
    def __getitem__(self, shape: slice) -> tuple[AlignedShape, ...]: ...
    def __getitem__(self, shape: str | int | slice) -> AlignedShape | tuple[AlignedShape, ...]:
        """Return one shape by name or position, or the shapes of a slice.

        Raises
        ------
        UnknownName
            If no shape has the name: a ``KeyError`` and an ``InputError``.
        """
        if isinstance(shape, slice):
            return tuple(self[at] for at in range(len(self))[shape])
        at = self.index(shape)
        return AlignedShape(
            name=self.names[at],
            file=self.files[at],
            transform=self.transforms[at],
            reflected=bool(self.reflected[at]),
            confidence=float(self.confidence[at]),
            centroid_size=float(self.centroid_sizes[at]),
            part=int(self.part_numbers[at]),
            alternatives=self.alternatives[at],
        )

    def index(self, shape: str | int) -> int:
        """Return the position of a shape; an unknown name is an ``UnknownName``."""
        return position_of(self.names, shape)

    @property
    def scales(self) -> FloatArray:
        """Factor of each transform, shape (N,): common-frame length per unit of the file."""
        return scales_of(self.transforms)

    @property
    def centroid_sizes(self) -> FloatArray:
        """Centroid size of each shape's landmarks, in the unit of its file, shape (N,); as exports and R have it."""
        return centroid_sizes(self.landmarks)

    @property
    def rotations(self) -> FloatArray:
        """``R_common_shape``, the orthogonal part of each transform, shape (N, 3, 3)."""
        return self.transforms[:, :3, :3] / self.scales[:, None, None]

    @property
    def reflected(self) -> BoolArray:
        """Whether each shape is mirrored, shape (N,)."""
        return np.linalg.det(self.transforms[:, :3, :3]) < 0

    @property
    def aligned_landmarks(self) -> FloatArray:
        """The landmarks in the common frame, shape (N, L, 3); NaN where missing."""
        return each_moved_by(self.transforms, self.landmarks)

    @property
    def is_incomplete(self) -> BoolArray:
        """Whether parts of each shape are missing, shape (N,)."""
        return np.isin(np.arange(len(self)), [one.shape for one in self.incomplete])

    @property
    def coverage(self) -> FloatArray:
        """Share of its partners' surfaces that each incomplete shape covers, NaN for complete ones, shape (N,)."""
        found = np.full(len(self), np.nan)
        for one in self.incomplete:
            found[one.shape] = one.coverage
        return found

    def file(self, at: int) -> Path:
        """Return the file of one shape.

        Raises
        ------
        InputError
            If the shape came from memory, or its file is not there any more.
        """
        if not self.files[at]:
            raise InputError(
                f"{self.names[at]}: came from memory, not from a file; save the shapes as files and align these"
            )
        if not is_there(self.files[at]):
            raise UnavailableError(
                f"{self.files[at]}: a shape of the collection is not there any more. If the files have moved, say "
                "where they are now (--sources FOLDER)"
            )
        return Path(self.files[at])

    @property
    def inputs(self) -> set[Path]:
        """Files and their folders, in none of which results may lie, nor they in the results' folder."""
        return inputs_of(Path(file) for file in self.files if file)

    def source_files(self) -> tuple[Path, ...]:
        """Return the files that the shapes were read from.

        Raises
        ------
        InputError
            If a shape came from memory, its file has vanished, or samples or invariants were the caller's own.
        """
        if given := {*self.own} & {"invariants", "samples"}:
            raise InputError(
                f"{self.folder}: was aligned with {' and '.join(sorted(given))} of the caller's own, which a "
                "result does not keep; align all shapes again, with them"
            )
        return tuple(self.file(at) for at in range(len(self)))


def trimesh_of(shape: Shape) -> Any:
    """Return a shape as ``trimesh.Trimesh``, or ``trimesh.PointCloud`` where it has no faces."""
    import trimesh

    if not shape.is_mesh:
        return trimesh.PointCloud(shape.vertices.copy())
    return trimesh.Trimesh(shape.vertices.copy(), shape.faces.copy(), process=False)
