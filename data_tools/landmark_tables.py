"""Landmark files of several specimens: TPS (Rohlf), NTS (NTSYSpc, Landmark Editor's DTA), morphologika, tables."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.errors import CollalignError, InputError
from data_tools.io.files import existing_file, read_any_text
from data_tools.io.formats.text_points import is_table_of_specimens
from data_tools.io.listing import TABLES, FolderListing
from data_tools.landmark_files import READERS as OF_ONE_SHAPE
from data_tools.landmark_files import (
    Landmarks,
    Semilandmarks,
    landmark_system,
    read_landmarks,
    specimen_of,
)
from data_tools.names import match_names, nearly
from data_tools.notes import Note, listed
from data_tools.point_tables import number, read_point_table

#: Landmarks of a shape, and bytes of a file, above which a table beside meshes is taken for something else.
MOST_LANDMARKS, MOST_BYTES = 1000, 2**20
#: The command line shows what is said below "collalign".
_LOG = logging.getLogger("collalign.landmark_tables")


def read_specimens(path: Path | str, names: Sequence[str] = ()) -> dict[str, Landmarks]:
    """Read the landmarks of every specimen of a file, by name.

    ``.tps``: a specimen is called by its ``ID``; or by the file that ``IMAGE`` names, where that names more of the
    shapes or ``ID`` is missing or not unique, because tpsDig numbers the specimens. ``SCALE`` is multiplied by,
    ``POINTS`` are open curves. ``.nts``, ``.dta``: by the row labels. ``.morphologika``, ``.txt``: by ``[names]``.
    ``.csv``, ``.tsv``, ``.txt``: with columns of specimens, landmarks, x, y and z, a row for each landmark, as the
    page of a transfer writes it; or a row for each specimen (``nose_x``, ``nose_y``, ``nose_z``). Missing
    landmarks (NaN, NA, empty, the code of an NTS header) are NaN. A file of one unnamed specimen, and what else
    :func:`data_tools.landmark_files.read_landmarks` reads, is that of the specimen called like the file.

    Parameters
    ----------
    path : path
    names : sequence of str, optional
        Of the shapes that landmarks are wanted of.

    Raises
    ------
    InputError
        If the file is missing, of another kind, two-dimensional, or names a specimen twice; if ``ID`` and ``IMAGE``
        name different shapes.
    """
    path = existing_file(Path(path))
    reader = _READERS.get(path.suffix.lower())
    if reader is None and not path.name.lower().endswith(tuple(OF_ONE_SHAPE)):
        raise InputError(f"{path}: unknown format of landmarks; readable are {READABLE}")
    if reader is None:
        return {specimen_of(path): read_landmarks(path)}
    try:
        text = read_any_text(path)
        found = _read_tps(path, text, names) if reader is _read_tps else reader(path, text)
    except CollalignError:
        raise
    except (ValueError, ArithmeticError, LookupError, AttributeError) as error:
        raise InputError(
            f"{path}: not a readable {path.suffix[1:].upper()} file of three-dimensional landmarks"
        ) from error
    names = [name or specimen_of(path) for name, _ in found]
    twice = next((name for at, name in enumerate(names) if name in names[:at]), None)
    if twice is not None or not names:
        raise InputError(
            f"{path}: {'holds no landmarks' if twice is None else f'two specimens are called {twice!r}'}"
            + ("; give each a name of its own (ID= in TPS)" if twice is not None else "")
        )
    return dict(zip(names, [marks for _, marks in found], strict=True))


def notes_beside(listing: FolderListing) -> tuple[Note, ...]:
    """Return notes on the landmarks and other tables that lie beside the shapes of a collection, and are none.

    Parameters
    ----------
    listing : FolderListing
    """
    landmarks, tables = list[str](), list[str]()
    for path, name in zip(listing.skipped, listing.skipped_names, strict=True):
        if _holds_landmarks(path):
            landmarks.append(name)
        elif path.suffix.lower() in TABLES and not is_table_of_specimens(path):
            tables.append(name)
    notes = (
        Note("landmarks-beside", values={"num": len(landmarks), "files": tuple(landmarks)}),
        Note("tables-beside", values={"num": len(tables), "files": tuple(tables)}),
    )
    return tuple(note for note in notes if note.values["num"])


def _holds_landmarks(path: Path) -> bool:
    """Return whether a file can be read as landmarks, and is none of many more points."""
    with suppress(InputError, OSError):
        if path.is_file() and path.stat().st_size <= MOST_BYTES:
            found = read_specimens(path)
            return all(len(one.labels) <= MOST_LANDMARKS for one in found.values())
    return False


def _read_table(path: Path, text: str) -> list[tuple[str, Landmarks]]:
    """Read a table of one specimen, or of several where a column says whose landmark each is."""
    every = read_point_table(text, str(path))
    if not every.specimens:
        return [("", read_landmarks(path))]
    system = landmark_system(path, every.system)
    names = list(dict.fromkeys(every.specimens))
    rows = {name: [at for at, of in enumerate(every.specimens) if of == name] for name in names}
    labels = {name: tuple(every.labels[at] for at in own) for name, own in rows.items()}
    return [
        (name, Landmarks(labels=labels[name], points=read_only(every.points[own]), system=system))
        for name, own in rows.items()
    ]


def _read_tps(path: Path, text: str, shapes: Sequence[str] = ()) -> list[tuple[str, Landmarks]]:
    blocks = re.split(r"(?im)^(?=\s*LM3?\s*=)", text)
    found = [_tps_specimen(block) for block in blocks if "=" in block]
    ids, images = [one[0] or one[1] for one in found], [one[1] or one[0] for one in found]
    names = ids
    if ids != images and len({*images}) == len(images):
        by_id, by_image = match_names(ids, shapes), match_names(images, shapes)
        told_by_id, told_by_image = (
            (len(one) - len(nearly(one)), len(one)) for one in (by_id, by_image)
        )
        if told_by_image > told_by_id or len({*ids}) < len(ids):
            names = images
            _LOG.warning("%s: specimens are called by IMAGE, not by ID", path)
        elif told_by_image == told_by_id and [*by_id.values()] != [*by_image.values()]:
            raise InputError(
                f"{path}: ID and IMAGE name different shapes ({listed([*by_id.values()])}; "
                f"{listed([*by_image.values()])}); delete the lines of one of them"
            )
    return [(name, marks) for name, (_, _, marks) in zip(names, found, strict=True)]


def _tps_specimen(block: str) -> tuple[str, str, Landmarks]:
    """Read one specimen: ``LM3=`` and its points, then curves, scale and names; return ID, IMAGE and landmarks."""
    lines = [line.strip() for line in block.split("\n") if line.strip()]
    sets, said = list[FloatArray](), dict[str, str]()
    for at, line in enumerate(lines):
        key, sign, value = (word.strip() for word in line.partition("="))
        if sign and key.upper() in ("LM", "LM3", "POINTS", "POINTS3"):
            end = at + 1 + int(value)
            if end < len(lines) and "=" not in lines[end]:
                raise ValueError(f"more than {value} points")
            sets.append(_points(" ".join(lines[at + 1 : end]).split(), int(value)))
        elif sign:
            said[key.upper()] = value
    scale = number(said.get("SCALE", ""))
    if np.isinf(scale):
        raise ValueError(said["SCALE"])
    points, *curves = (one if np.isnan(scale) else scale * one for one in sets)
    image = Path(said.get("IMAGE", "").replace("\\", "/")).name
    marks = _landmarks(points)
    along = [
        Semilandmarks(name=f"curve {number}", kind="open curve", points=read_only(curve))
        for number, curve in enumerate(curves, start=1)
    ]
    stem = image.rpartition(".")[0] or image
    return said.get("ID", ""), stem, replace(marks, semilandmarks=tuple(along))


def _read_nts(path: Path, text: str) -> list[tuple[str, Landmarks]]:
    """Read ``1 nL p 1 CODE DIM=3``, names of the rows and of the columns where an L says so, and the matrix."""
    header, *lines = [
        line
        for line in text.split("\n")
        if line.strip() and not line.lstrip().startswith(('"', "'"))
    ]
    kind, rows, columns, has_code, *rest = header.split()
    if kind != "1" or re.search(r"(?i)dim\s*=\s*3", header) is None:
        raise ValueError(header)
    words = " ".join(lines).split()
    num, width = (int(re.sub(r"[lL]$", "", word)) for word in (rows, columns))
    names = words[:num] if rows[-1] in "lL" else []
    words = words[len(names) + (width if columns[-1] in "lL" else 0) :]
    labels = tuple(names)
    if width == 3:  # one specimen, a row for each landmark
        names, num, width = [], 1, 3 * num
    every = _specimens(words, num, width // 3)
    every[every == (float(rest[0]) if has_code == "1" else np.inf)] = np.nan
    if width == 3 * len(labels) and not names:
        return [("", replace(_landmarks(every[0]), labels=labels))]
    return [
        (name, _landmarks(points)) for name, points in zip(names or [""] * num, every, strict=True)
    ]


def _read_text(path: Path, text: str) -> list[tuple[str, Landmarks]]:
    is_morphologika = re.search(r"(?im)^\s*\[individuals\]\s*$", text)
    return _read_morphologika(path, text) if is_morphologika else _read_table(path, text)


def _read_morphologika(path: Path, text: str) -> list[tuple[str, Landmarks]]:
    found = re.findall(r"^\s*\[(\w+)\]\s*$([^\[]*)", text, flags=re.MULTILINE)
    sections = {title.lower(): content for title, content in found}
    num, size, dim = (int(sections[key]) for key in ("individuals", "landmarks", "dimensions"))
    if dim != 3:
        raise ValueError(dim)
    names = [line.strip() for line in sections.get("names", "").split("\n") if line.strip()]
    rows = [line for line in sections["rawpoints"].split("\n") if not line.lstrip().startswith("'")]
    every = _specimens(" ".join(rows).split(), num, size)
    return [
        (name, _landmarks(points)) for name, points in zip(names or [""] * num, every, strict=True)
    ]


def _specimens(words: list[str], num: int, size: int) -> FloatArray:
    """Return the points of so many specimens, shape (num, size, 3), if the file has a number for each coordinate."""
    if min(num, size) < 1 or len(words) != num * size * 3:
        raise ValueError(f"{num} specimens of {size} landmarks in {len(words)} numbers")
    return _points(words, num * size).reshape(num, size, 3)


def _points(words: list[str], num: int) -> FloatArray:
    """Return so many points, shape (num, 3), of exactly as many words."""
    return np.array([number(word) for word in words]).reshape(num, 3)


def _landmarks(points: FloatArray) -> Landmarks:
    """Return landmarks called by their numbers; a landmark that lacks one coordinate is missing."""
    whole = np.where(np.isfinite(points).all(axis=1, keepdims=True), points, np.nan)
    return Landmarks(labels=tuple(map(str, range(len(points)))), points=read_only(whole))


_READERS: dict[str, Callable[[Path, str], list[tuple[str, Landmarks]]]] = {
    ".tps": _read_tps,
    ".nts": _read_nts,
    ".dta": _read_nts,
    ".morphologika": _read_morphologika,
    ".txt": _read_text,
    **dict.fromkeys((".csv", ".tsv"), _read_table),
}
#: All suffixes of landmark files, as messages name them.
READABLE = ", ".join(dict.fromkeys((*OF_ONE_SHAPE, *_READERS)))
