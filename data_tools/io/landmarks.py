"""Landmarks and symmetry tables: 3D Slicer files, CSV, and the vertex lists of shape benchmarks."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import CollalignError, InputError
from data_tools.io.files import existing_file

#: What semilandmarks lie on: a curve with two ends, one without, or a patch of the surface.
SemilandmarkKind = Literal["open curve", "closed curve", "patch"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Semilandmarks:
    """Points of a curve in their order, or of a patch.

    Attributes
    ----------
    name : str
    kind : {"open curve", "closed curve", "patch"}
    points : ndarray, shape (c, 3)
        In the coordinates of the file; a closed curve does not repeat its first point. Read-only.
    """

    name: str
    kind: SemilandmarkKind
    points: FloatArray


class SemilandmarkRows(NamedTuple):
    """Which rows of an array of landmarks are the semilandmarks of one curve, in order, or of one patch."""

    name: str
    kind: SemilandmarkKind
    rows: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Landmarks:
    """Named points of one shape.

    Attributes
    ----------
    labels : tuple of str
        One per landmark; "0", "1", ... where the file has none.
    points : ndarray, shape (l, 3)
        In the coordinates of the file; rows of NaN are missing landmarks. Read-only.
    vertices : ndarray of int, shape (l,), or None
        The mesh's vertex of each landmark, where the file names it. Read-only.
    semilandmarks : tuple of Semilandmarks
        Curves and patches beside the landmarks.
    """

    labels: tuple[str, ...]
    points: FloatArray
    vertices: IntArray | None = None
    semilandmarks: tuple[Semilandmarks, ...] = ()


def read_landmarks(path: Path | str) -> Landmarks:
    """Read a landmark file by its suffix.

    ``.mrk.json`` and ``.fcsv`` (3D Slicer; coordinates as they stand, whichever of LPS and RAS the file declares;
    markups of the type Curve or ClosedCurve become curves, which are called as their points are, without the number),
    ``.csv`` (label, x, y, z or x, y, z; a header is allowed), ``.vts`` (vertex index, x, y, z: the SHREC07 points of
    Kim, Lipman and Funkhouser 2011).

    Raises
    ------
    InputError
        If the file is missing, of another kind, or a value is no number; undefined positions become NaN.
    """
    path = existing_file(Path(path))
    name = path.name.lower()
    reader = next((r for suffix, r in _READERS.items() if name.endswith(suffix)), None)
    if reader is None:
        raise InputError(f"{path}: unknown landmark format; readable are {', '.join(_READERS)}")
    try:
        landmarks = reader(path)
    except CollalignError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: not a readable landmark file ({type(error).__name__}: {error})") from error
    every = np.concatenate([landmarks.points, *(one.points for one in landmarks.semilandmarks)])
    if not len(every) or np.isinf(every).any():
        raise InputError(f"{path}: {'infinite coordinates' if len(every) else 'holds no landmarks'}")
    return landmarks


def read_semilandmarks(path: Path | str, kind: Literal["curve", "patch"]) -> Semilandmarks:
    """Read a file of points as one curve or patch, which is called like the folder that the file is in.

    Parameters
    ----------
    path : path
        Any file that :func:`read_landmarks` reads.
    kind : {"curve", "patch"}
        A curve is closed where a markup says so or the last point is the first.

    Raises
    ------
    InputError
        As :func:`read_landmarks`; if the file holds several curves, or a curve fewer than two points.
    """
    path = Path(path)
    found = read_landmarks(path)
    sets = [one for one in (found.points, *(curve.points for curve in found.semilandmarks)) if len(one)]
    if len(sets) > 1:
        raise InputError(f"{path}: holds {len(sets)} lists of points, expected one {kind}")
    name = path.absolute().parent.name
    if kind == "patch":
        return Semilandmarks(name=name, kind="patch", points=sets[0])
    said = any(curve.kind == "closed curve" for curve in found.semilandmarks)
    return _curve(path, name, sets[0], closed=said)


def specimen_of(path: Path | str) -> str:
    """Return the name of the specimen that a landmark file belongs to: the file's name without its suffix."""
    name = Path(path).name
    suffix = next((suffix for suffix in _READERS if name.lower().endswith(suffix)), Path(path).suffix)
    return name[: len(name) - len(suffix)]


def read_vertex_indices(path: Path | str, *, num_vertices: int) -> IntArray:
    """Read the first column of a table as vertex indices, shape (l,) (``.pid`` files).

    Raises
    ------
    InputError
        If an index is missing or out of range.
    """
    path = existing_file(Path(path))
    words = [line.split() for line in _text(path).splitlines() if line.strip()]
    if not words or not all(row[0].isdecimal() and int(row[0]) < num_vertices for row in words):
        raise InputError(f"{path}: expected a vertex index below {num_vertices} first in each line")
    return np.array([int(row[0]) for row in words], dtype=np.int64)


def read_symmetry(path: Path | str, *, num_landmarks: int) -> IntArray:
    """Read the mirror pairs of landmarks (``.sym.info``) as a permutation, shape (l,).

    Each line holds the two indices of a pair, or one index of a landmark on the mirror plane; others map to
    themselves.

    Raises
    ------
    InputError
        If a line holds anything else, or a landmark is in two pairs.
    """
    path = existing_file(Path(path))
    partner = np.arange(num_landmarks)
    seen: set[int] = set()
    for number, line in enumerate(_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if len(words) > 2 or not all(w.isdecimal() and int(w) < num_landmarks for w in words):
            raise InputError(f"{path}: line {number}: expected one or two landmarks below {num_landmarks}")
        pair = [int(w) for w in words]
        if seen & set(pair):
            raise InputError(f"{path}: line {number}: landmark {pair} is in two orbits")
        seen |= set(pair)
        partner[pair] = pair[::-1]
    return partner


def read_landmark_pairs(path: Path | str, labels: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Read pairs of landmarks, left and right, one pair a row of a CSV file; a header is allowed.

    Raises
    ------
    InputError
        If a row does not hold two labels.
    """
    path = existing_file(Path(path))
    rows = [
        [word.strip() for word in row] for row in csv.reader(_text(path).splitlines()) if any(map(str.strip, row))
    ]
    if rows and not set(rows[0]) & set(labels):
        rows = rows[1:]
    for row in rows:
        if len(row) != 2 or not all(row):
            raise InputError(f"{path}: expected two landmarks in each row, got {','.join(row)!r}")
        unknown = [word for word in row if word not in labels]
        if unknown:
            raise InputError(f"{path}: there is no landmark {unknown[0]!r}")
    if not rows:
        raise InputError(f"{path}: holds no pairs of landmarks")
    return tuple((row[0], row[1]) for row in rows)


def landmark_partners(labels: Sequence[str], pairs: Iterable[tuple[str, str]]) -> IntArray:
    """Return the partner of every landmark, shape (l,); one that is in no pair is on the midline, and its own.

    Raises
    ------
    InputError
        If a pair names an unknown landmark or one that has a partner already.
    """
    partner = np.arange(len(labels))
    for pair in pairs:
        for label in pair:
            if label not in labels:
                raise InputError(f"pairs: there is no landmark {label!r}")
        left, right = (list(labels).index(label) for label in pair)
        if left == right or partner[left] != left or partner[right] != right:
            raise InputError(f"pairs: {pair[0]!r} and {pair[1]!r}: a landmark is in two pairs or its own partner")
        partner[[left, right]] = right, left
    return partner


def _read_slicer_json(path: Path) -> Landmarks:
    content: Any = json.loads(_text(path))
    points: list[list[float]] = []
    labels: list[str] = []
    curves: list[Semilandmarks] = []
    for number, markup in enumerate(content["markups"], start=1):
        controls = markup.get("controlPoints", [])
        own = [str(control.get("label", index)) for index, control in enumerate(controls)]
        defined = [control.get("positionStatus", "defined") == "defined" for control in controls]
        places = [
            [float(x) for x in control["position"]] if there else [math.nan] * 3
            for control, there in zip(controls, defined, strict=True)
        ]
        if markup.get("type") in _CURVES:
            name = re.sub(r"[-_ ]*\d*$", "", own[0]) if own else ""
            along = _landmarks(path, own, places).points
            closed = markup["type"] == "ClosedCurve"
            curves.append(_curve(path, name or f"curve {number}", along, closed=closed))
        else:
            labels += own
            points += places
    return replace(_landmarks(path, labels, points), semilandmarks=tuple(curves))


def _curve(path: Path, name: str, points: FloatArray, *, closed: bool) -> Semilandmarks:
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) > 2 and (known[0] == known[-1]).all():
        known, closed = known[:-1], True
    if len(known) < (3 if closed else 2):
        raise InputError(f"{path}: the curve {name!r} has {len(known)} points, which are too few")
    return Semilandmarks(name=name, kind="closed curve" if closed else "open curve", points=read_only(known))


def _read_fcsv(path: Path) -> Landmarks:
    rows = [row for row in csv.reader(_text(path).splitlines()) if row and not row[0].startswith("#")]
    labels = [row[11] if len(row) > 11 else str(index) for index, row in enumerate(rows)]
    return _landmarks(path, labels, [[float(word) for word in row[1:4]] for row in rows])


def _read_csv(path: Path) -> Landmarks:
    rows = [row for row in csv.reader(_text(path).splitlines()) if row and not row[0].startswith("#")]
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    labels = [row[0] if len(row) > 3 else str(index) for index, row in enumerate(rows)]
    points = [[float(word) if word.strip() else math.nan for word in row[-3:]] for row in rows]
    return _landmarks(path, labels, points)


def _read_vts(path: Path) -> Landmarks:
    rows = [line.split() for line in _text(path).splitlines() if line.strip()]
    landmarks = _landmarks(path, [str(i) for i in range(len(rows))], [[float(w) for w in row[1:]] for row in rows])
    vertices = np.array([int(row[0]) for row in rows], dtype=np.int64)
    if (vertices < 0).any():
        raise InputError(f"{path}: negative vertex index {vertices.min()}")
    return Landmarks(labels=landmarks.labels, points=landmarks.points, vertices=read_only(vertices))


def _landmarks(path: Path, labels: list[str], points: list[list[float]]) -> Landmarks:
    wrong = next((i for i, point in enumerate(points) if len(point) != 3), None)
    if wrong is not None:
        raise InputError(f"{path}: landmark {labels[wrong]} has {len(points[wrong])} coordinates, expected 3")
    return Landmarks(labels=tuple(labels), points=read_only(np.array(points, dtype=np.float64).reshape(-1, 3)))


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8-sig", errors="replace")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return not word.strip()
    return True


#: Types of markups whose points are a curve.
_CURVES = ("Curve", "ClosedCurve")
_READERS: dict[str, Callable[[Path], Landmarks]] = {
    ".mrk.json": _read_slicer_json,
    ".fcsv": _read_fcsv,
    ".csv": _read_csv,
    ".vts": _read_vts,
}
