"""Landmarks of one shape: files of 3D Slicer, tables, and files of Landmark Editor."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.errors import CollalignError, InputError, UnavailableError
from data_tools.io.files import composed, existing_file, read_any_text
from data_tools.io.shapes import CoordinateSystem
from data_tools.io.xml_trees import parse_xml
from data_tools.point_tables import number, read_point_table

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
        Curves and patches in addition to the landmarks.
    system : {"LPS", "RAS"} or None
        What the file declares the coordinates of ``points`` to be.
    left_out : tuple of str
        The kinds of the file's other markups, whose points are no landmarks: Plane, ROI, Line, Angle.
    """

    labels: tuple[str, ...]
    points: FloatArray
    semilandmarks: tuple[Semilandmarks, ...] = ()
    system: CoordinateSystem | None = None
    left_out: tuple[str, ...] = ()


def read_landmarks(path: Path | str) -> Landmarks:
    """Read a landmark file by its suffix.

    ``.mrk.json``, ``.json`` and ``.fcsv`` (3D Slicer; coordinates as they stand, with the system that the file
    declares; markups of the type Curve or ClosedCurve become curves, which are called as their points are, without
    the number; those of other types than Fiducial, such as Plane and ROI, are named and left out), ``.csv``,
    ``.tsv``, ``.txt`` (see :func:`data_tools.point_tables.read_point_table`),
    ``.pts`` (Landmark Editor and others: a row for each landmark, its name and x, y, z, below a version and a number
    of rows), ``.pp`` (picked in MeshLab), ``.landmarkAscii`` (Amira and Avizo, in text). Positions that are
    undefined, empty or no numbers become NaN. Texts may be UTF-8, UTF-16 or Windows-1252.

    Raises
    ------
    InputError
        If the file is missing, of another kind, or holds no landmark, or a value is no number.

    Examples
    --------
    >>> found = read_landmarks("A.fcsv")
    >>> found.labels, found.points.shape
    (('top', 'foot'), (2, 3))
    """
    path = existing_file(Path(path))
    name = path.name.lower()
    reader = next((r for suffix, r in READERS.items() if name.endswith(suffix)), None)
    if reader is None:
        raise InputError(
            f"{path}: unknown format of a list of points; readable are {', '.join(READERS)}"
        )
    try:
        landmarks = reader(path)
    except CollalignError:
        raise
    except MemoryError as error:
        raise UnavailableError(f"{path}: does not fit in memory") from error
    except (
        ValueError,
        ArithmeticError,
        LookupError,
        TypeError,
        AttributeError,
        RecursionError,
        SyntaxError,
    ) as error:
        raise InputError(
            f"{path}: not a readable landmark file, it is damaged or of another format"
        ) from error
    every = np.concatenate([landmarks.points, *(one.points for one in landmarks.semilandmarks)])
    if not len(every) or np.isinf(every).any():
        raise InputError(
            f"{path}: {'infinite coordinates' if len(every) else 'holds no landmarks'}"
        )
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

    Examples
    --------
    >>> rim = read_semilandmarks("RIM/A.fcsv", "curve")
    >>> rim.name, rim.kind, rim.points.shape
    ('RIM', 'open curve', (3, 3))
    """
    path = Path(path)
    found = read_landmarks(path)
    sets = [
        (found.points, found.system),
        *((one.points, one.system) for one in found.semilandmarks),
    ]
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
    name = composed(Path(path).name)
    suffix = next(
        (suffix for suffix in READERS if name.lower().endswith(suffix)), Path(path).suffix
    )
    return name[: len(name) - len(suffix)]


def _read_slicer_json(path: Path) -> Landmarks:
    content: Any = json.loads(read_any_text(path))
    if not isinstance(content, dict) or "markups" not in content:
        raise InputError(
            f"{path}: holds no markups of 3D Slicer; landmarks in other JSON files are not read"
        )
    points: list[list[float]] = []
    labels: list[str] = []
    curves: list[Semilandmarks] = []
    systems: set[CoordinateSystem | None] = set()
    left_out: list[str] = []
    for at, markup in enumerate(content["markups"], start=1):
        if markup.get("type", "Fiducial") not in ("Fiducial", *_CURVES):
            left_out.append(str(markup["type"]))
            continue
        controls = markup.get("controlPoints", [])
        system = landmark_system(path, markup.get("coordinateSystem"))
        own = [
            composed(str(control.get("label") or index)) for index, control in enumerate(controls)
        ]
        places = [_slicer_place(control) for control in controls]
        if markup.get("type") in _CURVES:
            name = re.sub(r"[-_ ]*\d*$", "", own[0]) if own else ""
            along = _landmarks(path, own, places).points
            closed = markup["type"] == "ClosedCurve"
            curves.append(_curve(path, name or f"curve {at}", along, system, closed=closed))
        else:
            labels += own
            points += places
            systems.add(system)
    if len(systems) > 1:
        raise InputError(
            f"{path}: its lists of points have different coordinate systems; export them anew in one"
        )
    if left_out and not (labels or curves):
        raise InputError(
            f"{path}: holds no landmarks, only markups of other types ({', '.join(left_out)}). If their points are "
            "landmarks, copy them to a list of points in 3D Slicer"
        )
    found = replace(
        _landmarks(path, labels, points), semilandmarks=tuple(curves), left_out=tuple(left_out)
    )
    return replace(found, system=systems.pop() if systems else None)


def _slicer_place(control: Mapping[str, Any]) -> list[float]:
    """Return the coordinates of a control point, NaN where it is not placed."""
    position = control.get("position")
    if control.get("positionStatus", "defined") != "defined" or not position:
        return [math.nan] * 3
    return [math.nan if x is None else float(x) for x in position]


def landmark_system(path: Path, declared: object) -> CoordinateSystem | None:
    """Return a declared coordinate system; older files of 3D Slicer number them.

    Raises
    ------
    InputError
        If it is another one.
    """
    if declared in (None, ""):
        return None
    systems: dict[str, CoordinateSystem] = {"LPS": "LPS", "1": "LPS", "RAS": "RAS", "0": "RAS"}
    if str(declared).upper() not in systems:
        raise InputError(
            f"{path}: the coordinate system {declared!r} is none of LPS and RAS; export it anew in one"
        )
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
    return _of_table(path, read_any_text(path), _FCSV_COLUMNS)


def _read_csv(path: Path) -> Landmarks:
    return _of_table(path, read_any_text(path))


def _read_pts(path: Path) -> Landmarks:
    """Read rows of landmarks below lines that say a version and how many there are; braces around them count not."""
    lines = [line.strip() for line in read_any_text(path).split("\n") if line.strip(" \t{}")]
    lines = [line for line in lines if not line.lower().startswith("version")]
    said = re.fullmatch(r"(?i)(?:n_points\s*:\s*)?(\d+)", lines[0]) if lines else None
    lines = lines[1:] if said else lines
    columns = _PTS_COLUMNS if lines and len(lines[0].split()) == len(_PTS_COLUMNS) else ()
    found = _of_table(path, "\n".join(lines), columns)
    if said and int(said[1]) != len(found.labels):
        raise InputError(
            f"{path}: announces {said[1]} landmarks and holds {len(found.labels)}; is it truncated?"
        )
    return found


def _read_picked(path: Path) -> Landmarks:
    """Read the points that were picked in MeshLab; those that are not active are missing."""
    points = list(parse_xml(path, read_any_text(path).encode(), encoding="utf-8").iter("point"))
    labels = [composed(point.get("name") or str(at)) for at, point in enumerate(points)]
    rows = [
        [math.nan] * 3
        if point.get("active") == "0"
        else [number(point.get(axis, "")) for axis in "xyz"]
        for point in points
    ]
    return _landmarks(path, labels, rows)


def _read_amira(path: Path) -> Landmarks:
    """Read a landmark set of Amira or Avizo in text."""
    head, *blocks = re.split(r"(?m)^@(\d+)[ \t]*$", read_any_text(path))
    places = re.findall(r"Markers\s*\{\s*(?:float|double)\[3\]\s+\w+\s*\}\s*@(\d+)", head)
    if len(places) != 1:
        raise InputError(
            f"{path}: holds {len(places)} sets of landmarks in text, expected one; save each on its own"
        )
    rows = [
        list(map(number, line.split()))
        for line in blocks[blocks.index(places[0]) + 1].split("\n")
        if line.split()
    ]
    return _landmarks(path, list(map(str, range(len(rows)))), rows)


def _of_table(path: Path, text: str, columns: Sequence[str] = ()) -> Landmarks:
    found = read_point_table(text, str(path), columns=columns)
    return Landmarks(
        labels=found.labels, points=found.points, system=landmark_system(path, found.system)
    )


def _landmarks(path: Path, labels: list[str], points: list[list[float]]) -> Landmarks:
    wrong = next((i for i, point in enumerate(points) if len(point) != 3), None)
    if wrong is not None:
        raise InputError(
            f"{path}: landmark {labels[wrong]} has {len(points[wrong])} coordinates, expected 3"
        )
    return Landmarks(
        labels=tuple(labels), points=read_only(np.array(points, dtype=np.float64).reshape(-1, 3))
    )


#: Types of markups whose points are a curve.
_CURVES = ("Curve", "ClosedCurve")
#: Of a fiducial file; older ones have fewer, or say which they have.
_FCSV_COLUMNS = (
    "id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc", "associatedNodeID",
    "positionStatus",
)  # fmt: skip
_PTS_COLUMNS = ("label", "x", "y", "z")
#: Reader of each suffix.
READERS: dict[str, Callable[[Path], Landmarks]] = {
    ".mrk.json": _read_slicer_json,
    ".json": _read_slicer_json,
    ".fcsv": _read_fcsv,
    **dict.fromkeys((".csv", ".tsv", ".txt"), _read_csv),
    ".pts": _read_pts,
    ".pp": _read_picked,
    **dict.fromkeys((".landmarkascii", ".landmarksascii"), _read_amira),
}
