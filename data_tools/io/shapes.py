"""Reading and writing shapes: one door for every format, one kind of error, arrays checked before anything else."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from glob import glob, has_magic
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import CollalignError, InputError, UnavailableError
from data_tools.io.files import natural_key, read_text, readable_name, write_atomic
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
        The stem of each file, as readable text; where two stems are equal, the whole file name, or ``folder/stem``.
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

    Meshes: PLY, OFF, OBJ, STL, GLB. Points: PLY, OBJ, XYZ, TXT, CSV. Either: NPZ with ``vertices`` (or
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


def read_folder(folder: Path | str, *, recursive: bool = False) -> FolderListing:
    """List the shape files of a folder in natural order, without reading them.

    Parameters
    ----------
    folder : path
    recursive : bool
        Its folders as well, at any depth; hidden ones and links to folders stay out.

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
        entries = _entries(folder, recursive=recursive)
        files = tuple(path for path in entries if path.is_file() and path.suffix.lower() in READERS)
        if not files:
            raise InputError(f"{folder}: holds no shape file; {_elsewhere(folder)}")
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error})") from None
    return FolderListing(
        files=files, names=distinct_names(files), skipped=tuple(path for path in entries if path not in files)
    )


def files_at(place: Path | str, *, recursive: bool = False) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return the shape files of a place, and what else is there.

    Parameters
    ----------
    place : path
        A file; a folder; a pattern such as ``left/*.ply`` or ``**/*.stl``; or ``@FILE`` of such places, one a line,
        relative to that file (empty lines and those that begin with ``#`` count for nothing).
    recursive : bool
        Of folders, as in :func:`read_folder`.

    Raises
    ------
    InputError
        If nothing is there, or a folder holds no shape file.
    """
    place, text = Path(place), str(place)
    if text.startswith("@"):
        return _files_of_list(Path(text[1:]), recursive=recursive)
    try:
        if place.is_dir():
            listing = read_folder(place, recursive=recursive)
            return tuple(path for path in listing.files if isinstance(path, Path)), listing.skipped
        if not place.exists() and has_magic(text):
            found = [Path(match) for match in glob(text, recursive=True)]
            found = sorted((path for path in found if path.is_file()), key=lambda path: natural_key(str(path)))
            files = tuple(path for path in found if path.suffix.lower() in READERS)
            if not files:
                raise InputError(f"{place}: no shape file matches")
            return files, tuple(path for path in found if path not in files)
        if not place.exists() and place.suffix.lower() not in READERS:
            raise InputError(f"{place}: no such file or folder")
    except (OSError, ValueError) as error:
        raise InputError(f"{text[:200]}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    return (place,), ()


def _files_of_list(path: Path, *, recursive: bool) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return what the places of a list hold."""
    try:
        lines = read_text(path, "utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a list of files, it is no text") from None
    files, others = list[Path](), list[Path]()
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            found, rest = files_at(path.absolute().parent / line.strip(), recursive=recursive)
        except InputError as error:
            raise InputError(f"{path}, line {number}: {error}") from None
        files += found
        others += rest
    return tuple(files), tuple(others)


def _entries(folder: Path, *, recursive: bool) -> list[Path]:
    """Return what can be seen in a folder, in natural order; in place of its folders what they hold."""
    entries = sorted((p for p in folder.iterdir() if not p.name.startswith(".")), key=lambda p: natural_key(p.name))
    if not recursive:
        return entries
    inside = [
        _entries(path, recursive=True) if path.is_dir() and not path.is_symlink() else [path] for path in entries
    ]
    return [path for paths in inside for path in paths]


def _elsewhere(folder: Path) -> str:
    """Say which folders of a folder without shape files have some."""
    below = [path.relative_to(folder) for path in _entries(folder, recursive=True) if path.suffix.lower() in READERS]
    counts = list(Counter(readable_name(Path(path.parts[0])) for path in below if len(path.parts) > 1).items())
    if not counts:
        return f"readable are {', '.join(sorted(READERS))}"
    some = ", ".join([f"{name} ({count})" for name, count in counts[:10]]) + (", ..." if counts[10:] else "")
    return f"its folders do: {some}; take them with --recursive (in Python recursive=True), or name one of them"


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
    """Return distinct names, whatever the order: stems where they are unlike, else whole names, else with folders.

    Parameters
    ----------
    files : sequence of Path
        Of which none is there twice.
    """
    alike: dict[str, list[Path]] = {}
    for path in files:
        alike.setdefault(_tail(path, 0, whole=False).casefold(), []).append(path)
    named = {path: name for group in alike.values() for path, name in zip(group, _told_apart(group), strict=True)}
    names = tuple(named[path] for path in files)
    return names if len(set(names)) == len(names) else tuple(_told_apart(files, kinds=(True,)))


def _told_apart(files: Sequence[Path], *, kinds: tuple[bool, ...] = (False, True)) -> list[str]:
    """Return names of files with as few folders before them as tells them apart; with suffixes only where needed."""
    deepest = max((len(path.parts) for path in files), default=1)
    for depth in range(deepest):
        for whole in kinds:
            names = [_tail(path, depth, whole=whole) for path in files]
            if len({name.casefold() for name in names}) == len(names):
                return names
    return [_tail(path, deepest, whole=True) for path in files]


def _tail(path: Path, depth: int, *, whole: bool) -> str:
    """Return the name of a file, with its suffix or without, behind so many of its folders."""
    above = [readable_name(Path(part)) for part in path.absolute().parent.parts[-depth:]] if depth else []
    name = readable_name(path)
    return "/".join([*above, name if whole else name.removesuffix(path.suffix)])


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
