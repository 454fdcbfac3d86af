"""Reading and writing shapes: one door for every format, one kind of error, arrays checked before anything else."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import CollalignError, InputError, UnavailableError
from data_tools.io.files import natural_key, readable_name, write_atomic
from data_tools.io.mesh_formats import READERS as MESH_READERS
from data_tools.io.points import READERS as POINT_READERS
from data_tools.io.source import Origin, Source, read_source
from data_tools.options import CleaningOptions
from data_tools.surface.cleaning import clean, drop_non_finite
from data_tools.surface.outliers import without_outliers
from data_tools.surface.shape import Shape

#: Reader of each suffix: (vertices, faces) from a file.
READERS: dict[str, Callable[[Source], tuple[FloatArray, IntArray]]] = {**MESH_READERS, **POINT_READERS}
#: Suffixes that :func:`write_mesh` knows.
WRITABLE = (".ply", ".off", ".obj", ".stl", ".glb")
#: Largest number of triangles around one vertex. Decimation takes its square: 4 s at 10 000, minutes at 50 000; the
#: polygons of a file are split into triangles at their first corner.
MAX_TRIANGLES_OF_VERTEX = 10_000


@dataclass(frozen=True, kw_only=True)
class FolderListing:
    """The shapes of a collection, mostly files of a folder that nothing has read yet.

    Attributes
    ----------
    files : tuple of Path or Source
        In natural order, with distinct ``names``.
    names : tuple of str
        The stem of each file, as readable text; the whole file name where two stems are equal.
    skipped : tuple of Path
        Other files and folders, in natural order.
    """

    files: tuple[Origin, ...]
    names: tuple[str, ...]
    skipped: tuple[Path, ...] = ()


def read_shape(
    path: Origin | str,
    cleaning: CleaningOptions | None = None,
    *,
    name: str | None = None,
    digest: str | None = None,
) -> Shape:
    """Read and clean a mesh or point cloud; its suffix names the format.

    Meshes: PLY, OFF, OBJ, STL, GLB, GLTF. Points: PLY, OBJ, PCD, XYZ, TXT, CSV. Either: NPZ with ``vertices`` (or
    ``points``) and perhaps ``faces``. Polygons are split into triangles.

    Parameters
    ----------
    path : Path, str or Source
    cleaning : CleaningOptions, optional
    name : str, optional
        The file's stem by default.
    digest : str, optional
        What :func:`data_tools.io.source.hash_source` said of the file when it was looked at first.

    Returns
    -------
    Shape
        ``notes`` says what cleaning changed.

    Raises
    ------
    UnavailableError
        If the file is missing or cannot be read here and now, does not fit in memory, has changed since it was looked
        at first, or needs a package that is not installed.
    InputError
        Naming the file and the reason: empty, truncated, another content than its suffix says, values that
        are not finite, indices out of range, no points.
    """
    try:
        return shape_from_source(read_source(path), cleaning, name=name, digest=digest)
    except MemoryError as error:
        raise UnavailableError(
            f"{path.path if isinstance(path, Source) else path}: does not fit in memory"
        ) from error


def shape_from_source(
    source: Source, cleaning: CleaningOptions | None = None, *, name: str | None = None, digest: str | None = None
) -> Shape:
    """Return the shape that a file holds; see :func:`read_shape`."""
    path = source.path
    reader = READERS.get(source.suffix)
    if reader is None:
        raise InputError(f"{path}: unknown suffix {path.suffix!r}; readable are {', '.join(sorted(READERS))}")
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            vertices, faces = reader(source)
    except (CollalignError, MemoryError):
        raise
    except ImportError as error:
        raise UnavailableError(f"{path}: cannot be read without the package {error.name}; install it") from error
    except Exception as error:  # readers of damaged files fail in every way there is, and quote them
        kind = source.suffix[1:].upper()
        raise InputError(f"{path}: not a readable {kind} file, it is damaged or of another format") from error
    if digest is not None and source.digest != digest:
        raise UnavailableError(f"{path}: has changed since the run began; run again")
    shape = clean(_checked(source, vertices, faces, name or path.stem), cleaning)
    return shape if cleaning is not None and not cleaning.largest_component else without_outliers(shape, cleaning)


def read_folder(folder: Path | str) -> FolderListing:
    """List the shape files of a folder in natural order, without reading them.

    Raises
    ------
    InputError
        If it is no folder, cannot be read, or holds no shape file.
    """
    folder = Path(folder)
    try:
        if not folder.exists():
            raise InputError(f"{folder}: no such folder")
        if not folder.is_dir():
            raise InputError(
                f"{folder}: is a file, not a folder; give the folder that holds the shapes, or two files to "
                "`collalign match`"
            )
        entries = sorted(
            (p for p in folder.iterdir() if not p.name.startswith(".")), key=lambda p: natural_key(p.name)
        )
        files = tuple(p for p in entries if p.is_file() and p.suffix.lower() in READERS)
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error})") from None
    if not files:
        raise InputError(f"{folder}: holds no shape file; readable are {', '.join(sorted(READERS))}")
    return FolderListing(
        files=files, names=distinct_names(files), skipped=tuple(p for p in entries if p not in files)
    )


def write_mesh(path: Path | str, shape: Shape) -> Path:
    """Write a shape as PLY (binary), OFF, OBJ, STL or GLB, by the suffix, atomically.

    Raises
    ------
    InputError
        If the suffix is none of these, or a point cloud is to be written to a format without clouds.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise InputError(f"{path}: cannot write {suffix!r}; writable are {', '.join(WRITABLE)}")
    if not shape.is_mesh and suffix not in (".ply", ".obj"):
        raise InputError(f"{path}: a point cloud can be written as .ply or .obj")
    import trimesh

    if shape.is_mesh:
        geometry: Any = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    else:
        geometry = trimesh.PointCloud(shape.vertices)
    content: Any = geometry.export(file_type=suffix[1:])
    return write_atomic(path, content.encode() if isinstance(content, str) else content)


def distinct_names(files: Sequence[Path]) -> tuple[str, ...]:
    """Return distinct names: stems where they are unlike, whole file names where even these could be taken."""
    whole = [readable_name(path) for path in files]
    stems = [name.removesuffix(path.suffix) for name, path in zip(whole, files, strict=True)]
    counts = Counter(stem.casefold() for stem in stems)
    names = tuple(stem if counts[stem.casefold()] == 1 else name for stem, name in zip(stems, whole, strict=True))
    return names if len(set(names)) == len(names) else tuple(whole)


def _checked(source: Source, vertices: FloatArray, faces: IntArray, name: str) -> Shape:
    path = source.path
    vertices = np.asarray(vertices)
    if vertices.size == 0:
        raise InputError(f"{path}: holds no points")
    kept: IntArray | None = None
    notes: tuple[str, ...] = ()
    try:
        if (
            np.size(faces)
            and vertices.dtype.kind == "f"
            and vertices.shape[1:] == (3,)
            and not np.isfinite(vertices).all()
        ):
            vertices, faces, kept, note = drop_non_finite(name, vertices, faces)
            notes = (note,)
        shape = Shape.from_arrays(vertices, faces, name=name, file=path if source.is_file else None, notes=notes)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{name}: ')}") from error
    extent = float(np.abs(shape.vertices).max())
    if extent > 1e100 or not np.ptp(shape.vertices, axis=0).any():
        reason = "coordinates beyond 1e100" if extent > 1e100 else "all points lie in one place"
        raise InputError(f"{path}: {reason}")
    triangles_of = np.bincount(shape.faces.ravel(), minlength=1)
    if triangles_of.max() > MAX_TRIANGLES_OF_VERTEX:
        raise InputError(
            f"{path}: vertex {triangles_of.argmax()}, counted from 0, is a corner of {triangles_of.max()} triangles, "
            f"at most {MAX_TRIANGLES_OF_VERTEX} are worked on (a face of many corners is split at its first)"
        )
    return shape if kept is None else replace(shape, source_indices=read_only(kept))
