"""Which files are shapes: what folders, patterns and lists hold, their names, and the parts of one specimen."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from glob import glob, has_magic
from pathlib import Path
from typing import Protocol

from data_tools.errors import InputError
from data_tools.io.files import (
    beginning_of,
    natural_key,
    read_text,
    readable_name,
    readable_stem,
)
from data_tools.io.formats.gltf import read_gltf
from data_tools.io.formats.npz import read_npz
from data_tools.io.formats.obj_off_stl import read_obj, read_off, read_stl
from data_tools.io.formats.pcd import read_pcd
from data_tools.io.formats.ply import read_ply
from data_tools.io.formats.raw_shape import RawShape
from data_tools.io.formats.text_points import (
    is_landmark_pts,
    is_table_of_specimens,
    read_pts,
    read_text_points,
)
from data_tools.io.formats.vtk_legacy import read_vtk
from data_tools.io.formats.vtp import read_vtp
from data_tools.io.source import DIGEST_LENGTH, Origin, Source, hash_source
from data_tools.names import known_names


class TableReader(Protocol):
    """Reads points of a text, perhaps with what the user says of its columns."""

    def __call__(self, source: Source, columns: str = "") -> RawShape:
        """Return the points."""


#: Readers of tables, which may hold anything, by suffix.
TABLES: dict[str, TableReader] = {
    ".pts": read_pts,
    **dict.fromkeys((".xyz", ".asc", ".txt", ".csv"), read_text_points),
}
#: Reader of each suffix: the one list of what is read, which messages and documents repeat.
READERS: dict[str, Callable[[Source], RawShape]] = {
    ".ply": read_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".off": read_off,
    **dict.fromkeys((".glb", ".gltf"), read_gltf),
    ".vtk": read_vtk,
    ".vtp": read_vtp,
    ".pcd": read_pcd,
    **TABLES,
    ".npz": read_npz,
}


@dataclass(frozen=True, kw_only=True)
class FolderListing:
    """The shapes of a collection, mostly files of a folder that nothing has read yet.

    Attributes
    ----------
    files : tuple of Path or Source
        In natural order, with distinct ``names``.
    names : tuple of str
        Each file's path below the place that was asked for, without its suffix, as readable text: ``stem`` or
        ``folder/stem``. It does not depend on what else is there, but that files which only their type tells apart
        keep their suffix.
    skipped : tuple of Path
        Other files and folders, in natural order.
    left_out : tuple of str
        Names of shapes that somebody asked to leave out.
    """

    files: tuple[Origin, ...]
    names: tuple[str, ...]
    skipped: tuple[Path, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def skipped_names(self) -> tuple[str, ...]:
        """The names of the others, with as many folders as tell them apart."""
        return tuple(_told_apart(self.skipped, whole=True))

    def some(self, chosen: Iterable[int]) -> FolderListing:
        """Return the listing of some of the shapes alone, by their positions."""
        at = list(chosen)
        return FolderListing(
            files=tuple(self.files[i] for i in at), names=tuple(self.names[i] for i in at)
        )

    def without(self, names: Sequence[str]) -> FolderListing:
        """Return the listing without some shapes, see :func:`data_tools.names.known_names`."""
        left_out = {*known_names("exclude", names, self.names).values()}
        kept = self.some(at for at, name in enumerate(self.names) if name not in left_out)
        asked = tuple(name for name in self.names if name in left_out)
        return replace(kept, skipped=self.skipped, left_out=asked)


def read_folder(
    folder: Path | str, *, recursive: bool = False, include: Sequence[str] = ()
) -> FolderListing:
    """List the shape files of a folder in natural order, without reading them.

    Tables beside meshes are no shapes: landmarks, measurements or labels of these. A folder of tables alone is one of
    point clouds.

    Parameters
    ----------
    folder : path
    recursive : bool
        Its folders as well, at any depth; hidden ones and links to folders stay out.
    include : sequence of str
        Patterns of names of tables that are shapes all the same (``*.csv``); their names keep the suffix.

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
        files = _shapes_among(entries, include)
        if not files:
            raise InputError(f"{folder}: holds no shape file; {_elsewhere(folder)}")
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error})") from None
    return FolderListing(
        files=files,
        names=_names_below(folder, files, include),
        skipped=tuple(path for path in entries if path not in files),
    )


def shapes_at(
    place: Path | str, *, recursive: bool = False, include: Sequence[str] = ()
) -> FolderListing:
    """List the shape files of a place, and what else is there.

    Parameters
    ----------
    place : path
        A file; a folder; a pattern such as ``left/*.ply`` or ``**/*.stl``; or ``@FILE`` of such places, one a line,
        relative to that file (empty lines and those that begin with ``#`` count for nothing).
    recursive, include
        Of folders, as in :func:`read_folder`.

    Returns
    -------
    FolderListing
        Names are paths below the folder, below the folders of a pattern that are no pattern themselves, or below
        that of ``@FILE``; a file that is named by itself has its stem.

    Raises
    ------
    InputError
        If nothing is there, or a folder holds no shape file.
    """
    place, text = Path(place), str(place)
    if text.startswith("@"):
        return _shapes_of_list(Path(text[1:]), recursive=recursive, include=include)
    try:
        if place.is_dir():
            return read_folder(place, recursive=recursive, include=include)
        if not place.exists() and has_magic(text):
            found = [Path(match) for match in glob(text, recursive=True)]
            found = sorted(
                (path for path in found if path.is_file()), key=lambda path: natural_key(str(path))
            )
            files = _shapes_among(found, include)
            if not files:
                raise InputError(f"{place}: no shape file matches")
            return FolderListing(
                files=files,
                names=_names_below(base_of(place), files, include),
                skipped=tuple(path for path in found if path not in files),
            )
        if not place.exists() and place.suffix.lower() not in READERS:
            raise InputError(f"{place}: no such file or folder")
    except (OSError, ValueError) as error:
        raise InputError(
            f"{text[:200]}: cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from None
    return FolderListing(files=(place,), names=(readable_stem(place),))


def base_of(place: Path) -> Path:
    """Return the folder below which the files of a place have their names: of a pattern, the part that is none."""
    text = str(place)
    if text.startswith("@"):
        return Path(text[1:]).absolute().parent
    if place.is_dir() or not has_magic(text):
        return place
    return next(above for above in place.parents if not has_magic(str(above)))


def _shapes_of_list(path: Path, *, recursive: bool, include: Sequence[str]) -> FolderListing:
    """List what the places of a list hold."""
    try:
        lines = read_text(path, "utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a list of files, it is no text") from None
    folder = path.absolute().parent
    files, others = dict[Path, None](), dict[Path, None]()
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            found = shapes_at(folder / line.strip(), recursive=recursive, include=include)
        except InputError as error:
            raise InputError(f"{path}, line {number}: {error}") from None
        files |= dict.fromkeys(file for file in found.files if isinstance(file, Path))
        others |= dict.fromkeys(found.skipped)
    return FolderListing(
        files=tuple(files),
        names=_names_below(folder, [*files], include),
        skipped=tuple(others),
    )


def _entries(folder: Path, *, recursive: bool) -> list[Path]:
    """Return what can be seen in a folder, in natural order; in place of its folders what they hold."""
    entries = sorted(
        (p for p in folder.iterdir() if not p.name.startswith(".")),
        key=lambda p: natural_key(p.name),
    )
    if not recursive:
        return entries
    inside = [
        _entries(path, recursive=True) if path.is_dir() and not path.is_symlink() else [path]
        for path in entries
    ]
    return [path for paths in inside for path in paths]


def _elsewhere(folder: Path) -> str:
    """Say which folders of a folder without shape files have some."""
    below = [
        path.relative_to(folder)
        for path in _entries(folder, recursive=True)
        if path.suffix.lower() in READERS
    ]
    counts = list(
        Counter(readable_name(Path(path.parts[0])) for path in below if len(path.parts) > 1).items()
    )
    if not counts:
        return f"readable are {', '.join(sorted(READERS))}"
    some = ", ".join([f"{name} ({count})" for name, count in counts[:10]]) + (
        ", ..." if counts[10:] else ""
    )
    return (
        f"its folders do: {some}; take them with --recursive, or each as the parts of one specimen with --parts (in "
        "Python recursive=True, parts=True), or name one of them"
    )


def path_below(folder: Path, file: Path, *, whole: bool = False) -> str:
    """Return a file's path below a folder, its name alone where it is not below: what a shape is called.

    Parameters
    ----------
    folder, file : Path
    whole : bool
        Whether with the suffix.

    Returns
    -------
    str
        Readable text, folders separated by ``/``.
    """
    try:
        above = file.absolute().parent.relative_to(folder.absolute()).parts
    except ValueError:
        above = ()
    own = readable_name(file) if whole else readable_stem(file)
    return "/".join([*(readable_name(Path(part)) for part in above), own])


def _names_below(folder: Path, files: Sequence[Path], include: Sequence[str]) -> tuple[str, ...]:
    """Return the names of files below a folder; tables that were asked for keep their suffix: they lie beside meshes.

    So do files that only their type tells apart: the one case in which what lies beside a file matters to its name.
    Names that differ only in how accents are encoded get a number.
    """
    asked = [file.suffix.lower() in TABLES and _is_asked(file, include) for file in files]
    names = [path_below(folder, file, whole=of) for file, of in zip(files, asked, strict=True)]
    several = {name for name, count in Counter(names).items() if count > 1}
    names = [
        path_below(folder, file, whole=True) if name in several else name
        for file, name in zip(files, names, strict=True)
    ]
    counts, order = Counter(names), sorted(map(str, files))
    numbers = {str(file): order.index(str(file)) + 1 for file in files}
    return tuple(
        f"{name} ({numbers[str(file)]})" if counts[name] > 1 else name
        for file, name in zip(files, names, strict=True)
    )


def told_apart(paths: Sequence[Path]) -> list[str]:
    """Return names of files and folders that a caller named one by one: with as few folders as tell them apart.

    Parameters
    ----------
    paths : sequence of Path
        Of which none is there twice.
    """
    alike: dict[str, list[Path]] = {}
    for path in paths:
        alike.setdefault(_tail(path, 0, whole=False).casefold(), []).append(path)
    named = {
        path: name
        for group in alike.values()
        for path, name in zip(group, _told_apart(group), strict=True)
    }
    names = [named[path] for path in paths]
    return names if len(set(names)) == len(names) else _told_apart(paths, whole=True)


def _told_apart(paths: Sequence[Path], *, whole: bool = False) -> list[str]:
    """Return names of files with as few folders before them as tells them apart; with suffixes if asked or needed."""
    deepest = max((len(path.absolute().parts) for path in paths), default=1)
    kinds = (True,) if whole else (False, True)
    for same in (str.casefold, str):
        for depth, with_suffix in itertools.product(range(deepest), kinds):
            names = [_tail(path, depth, whole=with_suffix) for path in paths]
            if len({same(name) for name in names}) == len(names):
                return names
    order = sorted(map(str, paths))  # names that differ only in how their accents are encoded
    return [f"{_tail(path, deepest, whole=True)} ({order.index(str(path)) + 1})" for path in paths]


def _tail(path: Path, depth: int, *, whole: bool) -> str:
    """Return the name of a file, with its suffix or without, behind so many of its folders."""
    above = (
        [readable_name(Path(part)) for part in path.absolute().parent.parts[-depth:]]
        if depth
        else []
    )
    return "/".join([*above, readable_name(path) if whole else readable_stem(path)])


def relative_path(name: str, file: str) -> str:
    """Return the path of a shape's file below the place that it was listed from, with its suffix.

    Parameters
    ----------
    name : str
        Of the shape.
    file : str
        Where it lies; empty for a shape from memory, and so is the path then.

    Returns
    -------
    str
        The file's name alone where somebody named the shape otherwise.
    """
    if not file:
        return ""
    own = readable_name(Path(file))
    folder, sign, last = name.rpartition("/")
    return f"{folder}{sign}{own}" if last in (own, readable_stem(Path(file))) else own


def specimen_at(file: Path, place: Path) -> Path:
    """Return ``A.*`` for ``A.part.ply`` and for the files of a folder ``A`` in ``place``: a specimen of parts."""
    if place.is_dir() and file.parent != place:
        return file.parent.with_name(f"{file.parent.name}.*")
    stem = Path(file.stem)
    return file.with_name(f"{stem.stem}.*") if stem.suffix else file


def parts_of(origin: Origin | str) -> dict[str, Path]:
    """Return the files of a specimen's parts by the parts' names, where it is ``A.*``; nothing for all others.

    Raises
    ------
    InputError
        If two parts have the same name, or there is none.
    """
    if isinstance(origin, Source) or not str(origin).endswith(".*"):
        return {}
    path = Path(origin)
    folder = path.with_suffix("")
    inside = _entries(folder, recursive=False) if folder.is_dir() else []
    next_to_it = [
        file
        for file in _entries(path.parent, recursive=False)
        if specimen_at(file, path.parent) == path
    ]
    named = [(file.stem, file) for file in inside] + [
        (Path(file.stem).suffix[1:], file) for file in next_to_it
    ]
    shapes = _shapes_among([file for _, file in named], ())
    named = [(name, file) for name, file in named if file in shapes]
    if not named or len(dict(named)) < len(named):
        raise InputError(
            f"{path}: {'two parts have the same name' if named else 'there are no files of its parts'}"
        )
    return dict(named)


def hash_shape(origin: Origin) -> str:
    """Return the digest of a shape's file, or of the files and names of its parts.

    Raises
    ------
    InputError
        As :func:`data_tools.io.source.hash_source`.
    """
    parts = parts_of(origin)
    return (
        joint_digest([(name, hash_source(file)) for name, file in parts.items()])
        if parts
        else hash_source(origin)
    )


def joint_digest(parts: Sequence[tuple[str, str]]) -> str:
    """Return the digest of parts, given their names and digests."""
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:DIGEST_LENGTH]


def _is_shape(path: Path) -> bool:
    reader = READERS.get(path.suffix.lower())
    if reader is None or not path.is_file():
        return False
    is_table = reader is read_text_points and is_table_of_specimens(path)
    return not (is_table or is_landmark_pts(path))


def _shapes_among(entries: Sequence[Path], include: Sequence[str]) -> tuple[Path, ...]:
    """Return the shape files of entries, without the tables that lie beside meshes."""
    files = [path for path in entries if _is_shape(path)]
    has_tables = any(path.suffix.lower() in TABLES for path in files)
    meshes = {path.stem.casefold() for path in files if has_tables and _is_mesh(path)}
    return tuple(path for path in files if _is_asked(path, include) or not _is_beside(path, meshes))


def _is_asked(path: Path, include: Sequence[str]) -> bool:
    """Return whether a pattern of names asks for a file."""
    return any(fnmatch(path.name, pattern) for pattern in include)


def _is_mesh(path: Path) -> bool:
    """Return whether a file of a shape may have triangles: its format has them, and a PLY file's header says so."""
    suffix = path.suffix.lower()
    if suffix != ".ply":
        return suffix not in TABLES and suffix != ".pcd"
    header, end, _ = beginning_of(path).partition("end_header")
    return not end or re.search(r"element\s+(face|tristrips)\s+0*[1-9]", header) is not None


def _is_beside(path: Path, meshes: Collection[str]) -> bool:
    """Return whether a file is a table that belongs to the meshes beside it, given their names.

    Comma-separated values and plain text may hold anything, so they do. Formats of point clouds do where they are
    called like a mesh, perhaps with more words behind.
    """
    suffix, stem = path.suffix.lower(), path.stem.casefold()
    if suffix in (".csv", ".txt"):
        return bool(meshes)
    ends = [*(at for at, sign in enumerate(stem) if not sign.isalnum()), len(stem)]
    return suffix in TABLES and any(stem[:end] in meshes for end in ends)
