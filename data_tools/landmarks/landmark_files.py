"""Landmarks: 3D Slicer files and CSV."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.errors import CollalignError, InputError
from data_tools.io.coordinate_systems import CoordinateSystem
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
    system : {"LPS", "RAS"} or None
        What the file declares its coordinates to be.
    """

    name: str
    kind: SemilandmarkKind
    points: FloatArray
    system: CoordinateSystem | None = None


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
    semilandmarks : tuple of Semilandmarks
        Curves and patches beside the landmarks.
    system : {"LPS", "RAS"} or None
        What the file declares the coordinates of ``points`` to be.
    """

    labels: tuple[str, ...]
    points: FloatArray
    semilandmarks: tuple[Semilandmarks, ...] = ()
    system: CoordinateSystem | None = None


def read_landmarks(path: Path | str) -> Landmarks:
    """Read a landmark file by its suffix.

    ``.mrk.json`` and ``.fcsv`` (3D Slicer; coordinates as they stand, with the system that the file declares; markups
    of the type Curve or ClosedCurve become curves, which are called as their points are, without the number),
    ``.csv`` (label, x, y, z or x, y, z; a header is allowed).

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
        raise InputError(f"{path}: not a readable landmark file, it is damaged or of another format") from error
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
    sets = [(found.points, found.system), *((one.points, one.system) for one in found.semilandmarks)]
    sets = [one for one in sets if len(one[0])]
    if len(sets) > 1:
        raise InputError(f"{path}: holds {len(sets)} lists of points, expected one {kind}")
    name, (points, system) = path.absolute().parent.name, sets[0]
    if kind == "patch":
        return Semilandmarks(name=name, kind="patch", points=points, system=system)
    said = any(curve.kind == "closed curve" for curve in found.semilandmarks)
    return _curve(path, name, points, system, closed=said)


def specimen_of(path: Path | str) -> str:
    """Return the name of the specimen that a landmark file belongs to: the file's name without its suffix."""
    name = Path(path).name
    suffix = next((suffix for suffix in _READERS if name.lower().endswith(suffix)), Path(path).suffix)
    return name[: len(name) - len(suffix)]


def _read_slicer_json(path: Path) -> Landmarks:
    content: Any = json.loads(_text(path))
    points: list[list[float]] = []
    labels: list[str] = []
    curves: list[Semilandmarks] = []
    systems: set[CoordinateSystem | None] = set()
    for number, markup in enumerate(content["markups"], start=1):
        controls = markup.get("controlPoints", [])
        system = _system(path, markup.get("coordinateSystem"))
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
            curves.append(_curve(path, name or f"curve {number}", along, system, closed=closed))
        else:
            labels += own
            points += places
            systems.add(system)
    if len(systems) > 1:
        raise InputError(f"{path}: its lists of points have different coordinate systems; export them anew in one")
    found = replace(_landmarks(path, labels, points), semilandmarks=tuple(curves))
    return replace(found, system=systems.pop() if systems else None)


def _system(path: Path, declared: object) -> CoordinateSystem | None:
    """Return a declared coordinate system; older files of 3D Slicer number them."""
    if declared in (None, ""):
        return None
    systems: dict[str, CoordinateSystem] = {"LPS": "LPS", "1": "LPS", "RAS": "RAS", "0": "RAS"}
    if str(declared).upper() not in systems:
        raise InputError(f"{path}: the coordinate system {declared!r} is none of LPS and RAS; export it anew in one")
    return systems[str(declared).upper()]


def _curve(
    path: Path, name: str, points: FloatArray, system: CoordinateSystem | None, *, closed: bool
) -> Semilandmarks:
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) > 2 and (known[0] == known[-1]).all():
        known, closed = known[:-1], True
    if len(known) < (3 if closed else 2):
        raise InputError(f"{path}: the curve {name!r} has {len(known)} points, which are too few")
    kind: SemilandmarkKind = "closed curve" if closed else "open curve"
    return Semilandmarks(name=name, kind=kind, points=read_only(known), system=system)


def _read_fcsv(path: Path) -> Landmarks:
    text = _text(path)
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].startswith("#")]
    declared = re.search(r"^#[ \t]*CoordinateSystem[ \t]*=[ \t]*([^,\s]*)", text, flags=re.MULTILINE)
    labels = [row[11] if len(row) > 11 else str(index) for index, row in enumerate(rows)]
    found = _landmarks(path, labels, [[float(word) for word in row[1:4]] for row in rows])
    return replace(found, system=_system(path, declared[1] if declared else None))


def _read_csv(path: Path) -> Landmarks:
    rows = [row for row in csv.reader(_text(path).splitlines()) if row and not row[0].startswith("#")]
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    labels = [row[0] if len(row) > 3 else str(index) for index, row in enumerate(rows)]
    points = [[float(word) if word.strip() else math.nan for word in row[-3:]] for row in rows]
    return _landmarks(path, labels, points)


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
}
