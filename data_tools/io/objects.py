"""Shapes that a caller holds: arrays and the objects of other libraries become sources, as if they had been read."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from glob import has_magic
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.files import composed, natural_key
from data_tools.io.listing import (
    FolderListing,
    base_of,
    path_below,
    read_folder,
    shapes_at,
    specimen_at,
    told_apart,
)
from data_tools.io.source import Origin, Source

#: One shape: a file, an array (n, 3) of points, a pair (V, F), or an object of trimesh, Open3D or of this project.
ShapeLike: TypeAlias = Any
#: A folder, shapes in a list, shapes by name, or what :func:`list_shapes` made of them.
ShapesLike: TypeAlias = str | Path | Iterable[ShapeLike] | Mapping[str, ShapeLike] | FolderListing

_KNOWN = "a file, an array (n, 3), a pair (vertices, faces), or a mesh or point cloud of trimesh or Open3D"


def list_shapes(
    shapes: ShapesLike,
    *,
    recursive: bool = False,
    parts: bool = False,
    include: Sequence[str] = (),
) -> FolderListing:
    """List the shapes of a collection, whatever form they come in; files are not read yet.

    Parameters
    ----------
    shapes : str, Path, iterable or mapping
        A folder, a pattern or ``@FILE`` (:func:`data_tools.io.listing.shapes_at`); or several of these, files, arrays
        (n, 3), pairs (V, F), trimesh and Open3D objects, in any mixture. A mapping gives their names. Files of a
        folder are called by their path below it without the suffix, behind the folder's name if there are several
        places; a file named by itself by its stem; others ``shape1``, ``shape2``, ... by position.
    recursive : bool
        Whether the folders in a folder count.
    parts : bool
        Whether the files of a folder in a folder, and ``A.part.ply``, are parts of one specimen that move as one.
    include : sequence of str
        Patterns of names of tables that are shapes, although they lie beside meshes in a folder.

    Raises
    ------
    InputError
        If there is no such folder, no several shapes, two shapes carry the same name, or an object is none that is
        known.
    """
    if isinstance(shapes, FolderListing):
        return shapes
    if isinstance(shapes, str | Path):
        if not parts and (
            Path(shapes).is_dir() or not (str(shapes).startswith("@") or has_magic(str(shapes)))
        ):
            return read_folder(shapes, recursive=recursive, include=include)
        shapes = [shapes]
    named, skipped = _named(shapes, recursive=recursive, parts=parts, include=include)
    if not named:
        raise InputError("shapes: there are none")
    names = sorted(named, key=natural_key)
    files = tuple(as_origin(named[name], name) for name in names)
    return FolderListing(files=files, names=tuple(names), skipped=skipped)


def as_origin(shape: ShapeLike, name: str) -> Origin:
    """Return the file of a shape, or a source that holds the arrays of one in memory.

    Parameters
    ----------
    shape : str, Path, Source, array_like (n, 3), pair of array_like (V, F), or object
        Of trimesh, Open3D, or :class:`data_tools.surface.shape.Shape`.
    name : str
        What an object in memory is called.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if isinstance(shape, str | Path):
        return Path(shape)
    if isinstance(shape, Source):
        return shape
    vertices, faces = _arrays(shape, name)
    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices, faces=faces)
    return Source(Path(name), buffer.getvalue(), suffix=".npz")


def _named(
    shapes: Any, *, recursive: bool, parts: bool, include: Sequence[str]
) -> tuple[dict[str, ShapeLike], tuple[Path, ...]]:
    """Return the shapes by name, and what places hold in addition to shapes."""
    if isinstance(shapes, Mapping):
        if not all(isinstance(name, str) and name for name in shapes):
            raise InputError("shapes: their names must be text that is not empty")
        by_name = {composed(name): shape for name, shape in shapes.items()}
        if len(by_name) < len(shapes):
            raise InputError(
                "shapes: two of their names differ only in how accents are encoded; rename one"
            )
        return by_name, ()
    if isinstance(shapes, np.ndarray) and shapes.ndim != 3:
        raise InputError(
            f"shapes: one array of shape {shapes.shape}; a collection is several shapes in a list"
        )
    try:
        given = list(shapes)
    except TypeError:
        raise InputError(
            f"shapes: expected a folder, a list or a dict of shapes, got {_kind(shapes)}"
        ) from None
    places = [shape for shape in given if isinstance(shape, str | Path)]
    named, skipped = _named_files(places, recursive=recursive, parts=parts, include=include)
    for number, shape in enumerate(given, start=1):
        if isinstance(shape, str | Path):
            continue
        name = composed(getattr(shape, "name", None) or f"shape{number}")
        if name in named:
            raise InputError(
                "shapes: two of them have the same name; give a dict of distinct names"
            )
        named[name] = shape
    return named, skipped


def _named_files(
    places: Sequence[str | Path], *, recursive: bool, parts: bool, include: Sequence[str]
) -> tuple[dict[str, ShapeLike], tuple[Path, ...]]:
    """Return the files of several places by name, and what else is there. A file that several hold is there once.

    Several folders are told apart by their own names, files that are named one by one by their folders if they must.
    """
    listings = [shapes_at(place, recursive=recursive or parts, include=include) for place in places]
    bases = [base_of(Path(place)) for place in places]
    folders = [*dict.fromkeys(base for base in bases if base.is_dir())]
    called = dict(zip(folders, told_apart(folders), strict=True)) if folders[1:] else {}
    named, single, skipped = dict[Path, str](), dict[Path, None](), dict[Path, None]()
    for place, base, listing in zip(places, bases, listings, strict=True):
        skipped |= dict.fromkeys(listing.skipped)
        for file, name in zip(listing.files, listing.names, strict=True):
            assert isinstance(file, Path)
            at = specimen_at(file, Path(place)) if parts else file
            if not base.is_dir():
                single[at] = None
            elif at not in named:
                own = path_below(base, at) if at != file else name
                named[at] = f"{called[base]}/{own}" if base in called else own
    single = {file: None for file in single if file not in named}
    named |= zip(single, told_apart([*single]), strict=True)
    found: dict[str, ShapeLike] = {name: file for file, name in named.items()}
    if len(found) < len(named):
        twice = next(name for name, count in Counter(named.values()).items() if count > 1)
        raise InputError(
            f"shapes: two files would be called {twice!r}; give a dict of distinct names, or the folder of both"
        )
    return found, tuple(path for path in skipped if path not in named)


def _arrays(shape: Any, name: str) -> tuple[FloatArray, IntArray]:
    """Return vertices (n, 3) and triangles (m, 3), of which a point cloud has none."""
    vertices, faces = _parts(shape, name)
    try:
        points = np.asarray(vertices, dtype=np.float64)
        triangles = np.asarray([] if faces is None else faces)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not arrays of numbers ({error})") from None
    if points.ndim != 2 or points.shape[1] != 3:
        advice = (
            "; points are rows: give its transpose"
            if points.ndim == 2 and points.shape[0] == 3
            else ""
        )
        raise InputError(f"{name}: expected points of shape (n, 3), got {points.shape}{advice}")
    if triangles.size == 0:
        return points, np.empty((0, 3), dtype=np.int64)
    if triangles.dtype.kind not in "iu" or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise InputError(
            f"{name}: expected faces as integers of shape (m, 3), got {triangles.dtype} of shape {triangles.shape}"
        )
    return points, triangles.astype(np.int64)


def _parts(shape: Any, name: str) -> tuple[Any, Any]:
    """Take an object of any of the known kinds apart."""
    if isinstance(shape, tuple | list) and len(shape) == 2 and np.ndim(shape[0]) == 2:
        return shape[0], shape[1]
    if isinstance(shape, np.ndarray | list | tuple):
        return shape, None
    if hasattr(shape, "to_geometry"):  # trimesh's scenes, which GLB files are loaded as
        shape = shape.to_geometry()
    if hasattr(shape, "vertices"):  # trimesh, Open3D's meshes, and our own
        return shape.vertices, getattr(shape, "faces", getattr(shape, "triangles", None))
    if hasattr(shape, "vertex"):  # Open3D's tensor meshes
        return _tensor(shape.vertex, "positions"), _tensor(shape.triangle, "indices")
    if hasattr(shape, "point"):  # Open3D's tensor clouds
        return _tensor(shape.point, "positions"), None
    if hasattr(shape, "points"):  # Open3D's clouds
        return shape.points, None
    raise InputError(f"{name}: expected {_KNOWN}, got {_kind(shape)}")


def _tensor(fields: Any, name: str) -> Any:
    """Return one of the tensors of an Open3D object, wherever it lies, as an array (n, 3); (0, 3) if it has none."""
    return fields[name].cpu().numpy() if name in fields else np.empty((0, 3), dtype=np.int64)


def _kind(value: object) -> str:
    return f"{type(value).__module__}.{type(value).__qualname__}"
