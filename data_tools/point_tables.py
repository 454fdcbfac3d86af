"""Tables of landmarks in text: a row for each, in the columns that a heading, or else the cells, tell."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.errors import InputError
from data_tools.io.text_tables import (
    LABELS,
    MISSING,
    axis_columns,
    is_number,
    plain_words,
    read_table,
)

#: Headings of the column that names the specimen of a landmark.
_SPECIMEN = ("specimen", "shape", "file", "filename")
#: A column of one coordinate of one landmark: nose_x, 1.X (geomorph), X1 (MorphoJ).
_COORDINATE = re.compile(
    r"(?i)(?P<label>.*[^ _.:-])(?:(?<=\d)|[ _.:-]{1,3})(?P<axis>[xyz])|(?P<first>[xyz])[ _.:-]?(?P<number>\d+)"
)
#: Of 3D Slicer: what a column of a table or a file says of a control point that is placed.
_DEFINED = {"defined": ("", "1", "true"), "positionstatus": ("", "2", "defined")}
_SYSTEM = re.compile(r"(?im)^[ \t]*CoordinateSystem[ \t]*=[ \t]*([^,;\s]*)")


class PointTable(NamedTuple):
    """Landmarks as a table has them.

    Attributes
    ----------
    labels : tuple of str, length l
        Numbers from 0 where the table names none.
    points : ndarray, shape (l, 3)
        Rows of NaN where a landmark is missing. Read-only.
    system : str or None
        The coordinate system that a comment or the heading declares.
    specimens : tuple of str, length l or 0
        Whose landmark each is, where a column says so.
    """

    labels: tuple[str, ...]
    points: FloatArray
    system: str | None
    specimens: tuple[str, ...]


class _Columns(NamedTuple):
    """Where in a row something is; None where it is nowhere."""

    axes: tuple[int, int, int]
    label: int | None
    specimen: int | None = None
    state: int | None = None
    defined: tuple[str, ...] = ()
    system: str | None = None


def read_point_table(text: str, name: str, *, columns: Sequence[str] = ()) -> PointTable:
    """Read a table of landmarks.

    Columns are those of :func:`data_tools.io.text_tables.read_table`, found by the names in a heading: ``x, y, z``,
    or ``r, a, s`` and ``l, p, s`` of 3D Slicer; ``label``, ``landmark`` or ``name``. Without a heading they are the
    only three columns of numbers, side by side, with a label before or after them: a text, or a number that counts
    the rows from 0 or 1. A row may also hold all landmarks of a specimen, in columns such as ``nose_x, nose_y,
    nose_z`` or ``X1, Y1, Z1``. Decimals are marked by points, or by commas where these separate no columns.

    Parameters
    ----------
    text : str
    name : str
        The file, for messages.
    columns : sequence of str, optional
        Of a format whose tables have no heading.

    Raises
    ------
    InputError
        If it is not clear which columns hold what, or a row does not hold three numbers there.
    """
    table = read_table(text, name)
    for note in table.notes:
        raise InputError(
            f"{name}: announces {note.values['said']} landmarks and holds {note.values['found']}; is it truncated?"
        )
    rows, heading = table.rows(), [*table.heading]
    if not rows:
        raise InputError(f"{name}: holds no landmarks{', only a heading' if heading else ''}")
    heading += columns[len(heading) :]
    if heading and not columns:
        rows, heading = _as_wide_as_heading(heading, rows, name)
    if landmarks := _in_columns(heading):
        return _of_wide(heading, rows, landmarks, name)
    found = _by_heading(heading, rows, name) if heading else _by_content(rows, name)
    specimens = [_cell(row, found.specimen) for row in rows]
    labels = [
        _cell(row, found.label) or str(at)
        for row, at in zip(rows, _numbers(specimens), strict=True)
    ]
    points = np.array(
        [_place(row, found, label, name) for row, label in zip(rows, labels, strict=True)]
    )
    points[np.isnan(points).any(axis=1)] = np.nan
    declared = _SYSTEM.search(table.comments)
    return PointTable(
        labels=tuple(labels),
        points=read_only(points.reshape(-1, 3)),
        system=declared[1] if declared else found.system,
        specimens=() if found.specimen is None else tuple(specimens),
    )


def number(cell: str) -> float:
    """Return the number of a cell, with a decimal point or comma; NaN for what is written where there is none.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if MISSING.fullmatch(cell):
        return float("nan")
    word = cell if "." in cell else cell.replace(",", ".")
    if not is_number(word):
        raise ValueError(cell)
    return float(word)


def _as_wide_as_heading(
    heading: list[str], rows: list[list[str]], name: str
) -> tuple[list[list[str]], list[str]]:
    """Return rows without empty cells beyond the heading, which gets a first cell where R wrote none."""
    if all(len(row) == len(heading) + 1 and row[-1] for row in rows):
        heading = ["", *heading]
    for at, row in enumerate(rows):
        if any(row[len(heading) :]):
            raise InputError(
                f"{name}: row {at + 1} has {len(row)} cells under {len(heading)} headings ({', '.join(heading)}). If "
                "commas mark the decimals, save the table with semicolons between columns, or with decimal points"
            )
    return [row[: len(heading)] for row in rows], heading


def _in_columns(heading: list[str]) -> dict[str, tuple[int, int, int]]:
    """Return the columns of x, y and z of each landmark by its label, of rows that hold several: ``x1, y1, z1, x2``.

    Empty where a row holds one point.
    """
    words = plain_words(heading)
    if len(words) > 3 and axis_columns(words)[0] is not None:
        return {}
    places: dict[str, dict[str, int]] = {}
    for at, word in enumerate(words):
        if found := _COORDINATE.fullmatch(word):
            label, axis = found["label"] or found["number"], found["axis"] or found["first"]
            places.setdefault(label, {})[axis.lower()] = at
    every = {
        label: tuple(own[axis] for axis in "xyz" if axis in own) for label, own in places.items()
    }
    return {label: (own[0], own[1], own[2]) for label, own in every.items() if len(own) == 3}


def _of_wide(
    heading: list[str], rows: list[list[str]], landmarks: dict[str, tuple[int, int, int]], name: str
) -> PointTable:
    """Return the table of rows that hold all landmarks of a specimen each."""
    taken = {at for axes in landmarks.values() for at in axes}
    others = {
        word.lower(): at
        for at, word in reversed([*enumerate(plain_words(heading))])
        if at not in taken
    }
    specimen = next((others[word] for word in (*_SPECIMEN, *LABELS) if word in others), None)
    if specimen is None and len(rows) > 1:
        raise InputError(f"{name}: no column says which specimen each row is; call one 'specimen'")
    places = [
        _place(row, _Columns(axes, None), label, name)
        for row in rows
        for label, axes in landmarks.items()
    ]
    points = np.array(places)
    points[np.isnan(points).any(axis=1)] = np.nan
    return PointTable(
        labels=tuple(landmarks) * len(rows),
        points=read_only(points),
        system=None,
        specimens=()
        if specimen is None
        else tuple(_cell(row, specimen) for row in rows for _ in landmarks),
    )


def _by_heading(heading: list[str], rows: list[list[str]], name: str) -> _Columns:
    words = [word.lower() for word in plain_words(heading)]
    if {"radius", "status"} <= {*words}:
        raise InputError(
            f"{name}: these landmarks were carried over, not placed by a person. Give the original files, or "
            "templates.csv, which landmarks.html saves"
        )
    axes, system = axis_columns(words)
    if axes is None and len(words) == 4:
        has_labels = words[0] in LABELS or not all(_is_number_or_missing(row[0]) for row in rows)
        axes = (1, 2, 3) if has_labels else None
    if axes is None or len(axes) != 3:
        raise InputError(
            f"{name}: its heading does not say which columns are the coordinates ({', '.join(heading)}). "
            "Call one each x, y and z"
        )
    others = {word: at for at, word in reversed([*enumerate(words)]) if at not in axes}
    before = (at for at in range(min(axes)) if words[at] not in _SPECIMEN)
    label = next((others[word] for word in LABELS if word in others), next(before, None))
    specimen = next(
        (others[word] for word in _SPECIMEN if word in others and others[word] != label), None
    )
    if specimen is None and "landmark" in others and label == others["landmark"]:
        specimen = others.get("name")
    state = next((word for word in _DEFINED if word in others), "")
    return _Columns(
        (axes[0], axes[1], axes[2]),
        label,
        specimen,
        others.get(state),
        _DEFINED.get(state, ()),
        system,
    )


def _by_content(rows: list[list[str]], name: str) -> _Columns:
    """Find three columns of numbers, and one of labels, where no heading names them."""
    width = Counter(map(len, rows)).most_common(1)[0][0]
    odd = next((at for at, row in enumerate(rows) if len(row) != width), None)
    if odd is not None:
        raise InputError(f"{name}: row {odd + 1} has {len(rows[odd])} cells, most have {width}")
    if width < 3:
        raise InputError(f"{name}: landmark {rows[0][0]} has {width} coordinates, expected 3")
    columns = [[row[at] for row in rows] for at in range(width)]
    texts = [
        at
        for at, cells in enumerate(columns)
        if any(cells) and not all(map(_is_number_or_missing, cells))
    ]
    places = [at for at, cells in enumerate(columns) if any(cells) and at not in texts]
    if len(places) == width == 4:
        is_first, is_last = _counts(columns[0]), _counts(columns[3])
        if is_first == is_last:
            raise InputError(
                f"{name}: has no heading, and 4 columns of numbers, which can be read as label, x, y, z, or as x, y, "
                "z, label. Add a heading"
            )
        texts, places = ([0], [1, 2, 3]) if is_first else ([3], [0, 1, 2])
    elif width == 3 or (width == 4 and texts[:1] == [0]):  # what is no number is named below
        texts, places = [0] * (width == 4), [*range(width - 3, width)]
    if len(places) != 3 or places[2] - places[0] != 2:
        raise InputError(
            f"{name}: has no heading, and {len(places)} columns of numbers; it is not clear which are x, y and z. "
            "Add a heading"
        )
    return _Columns((places[0], places[1], places[2]), texts[0] if texts else None)


def _place(row: list[str], columns: _Columns, label: str, name: str) -> list[float]:
    """Return the coordinates of a row, NaN where the landmark is missing."""
    if columns.defined and _cell(row, columns.state).lower() not in columns.defined:
        return [float("nan")] * 3
    cells = [_cell(row, at) for at in columns.axes]
    if len(row) <= max(columns.axes):
        there = sum(at < len(row) for at in columns.axes)
        raise InputError(f"{name}: landmark {label} has {there} coordinates, expected 3")
    try:
        return [number(cell) for cell in cells]
    except ValueError as error:
        raise InputError(f"{name}: {str(error)!r} of landmark {label} is no number") from None


def _numbers(specimens: list[str]) -> list[int]:
    """Return the number of each landmark among those of its specimen, from 0."""
    seen = Counter[str]()
    numbers = []
    for specimen in specimens:
        numbers.append(seen[specimen])
        seen[specimen] += 1
    return numbers


def _cell(row: list[str], at: int | None) -> str:
    return row[at] if at is not None and at < len(row) else ""


def _is_number_or_missing(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def _counts(cells: list[str]) -> bool:
    """Return whether a column counts the rows from 0 or 1."""
    return [number(cell) for cell in cells] in (
        [*range(len(cells))],
        [*range(1, len(cells) + 1)],
    )
