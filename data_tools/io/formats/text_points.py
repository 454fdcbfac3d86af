"""Point clouds in text: XYZ, ASC, TXT, CSV, PTS, and molecules; which columns are x, y and z is never guessed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.io.files import beginning_of
from data_tools.io.formats.raw_shape import RawShape, no_faces, not_kept
from data_tools.io.source import Source
from data_tools.io.text_tables import (
    THOUSANDS,
    TextTable,
    axis_columns,
    axis_of,
    is_decimal,
    is_number,
    plain_words,
    read_table,
)

#: First line of PTS files of landmarks.
_VERSION = re.compile(r"version\b", re.IGNORECASE)
#: A number with a decimal comma.
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
#: What documented formats have after x, y and z, by the number of columns: intensity, colour, normal.
_LAYOUTS = {4: ["i"], 6: ["rgb", "nnn"], 7: ["irgb", "rgbi"], 9: ["rgbnnn", "nnnrgb"]}
_CALLED = {"i": "intensity", "rgb": "red, green, blue", "nnn": "nx, ny, nz"}
#: An element by its symbol, perhaps with a number, or by its atomic number.
_ELEMENT = re.compile(r"[A-Za-z]{1,3}\d*|[1-9]\d?|1[01]\d")
_PROPERTIES = re.compile(r"\bProperties=\"?((?:\w+:\w:\d+:)*pos:R:3(?::\w+:\w:\d+)*)")
#: How far the length of a normal may be from 1, as files of few decimals have it.
_NORMAL_TOL = 0.02


def read_text_points(source: Source, columns: str = "") -> RawShape:
    """Return the points of a table of numbers, or of a molecule; further columns (colours, normals) are ignored.

    Parameters
    ----------
    source : Source
    columns : str
        What the user says of the columns, as in :func:`read_points_table`.

    Raises
    ------
    InputError
        As :func:`read_points_table`.
    """
    text, name = source.text(), str(source.path)
    molecule = _molecule(text, name)
    if molecule is None:
        return read_points_table(text, name, columns)
    return read_points_table(molecule[0], name, columns or molecule[1])


def read_pts(source: Source, columns: str = "") -> RawShape:
    """Return the points of all scans of a PTS file, each of which begins with the number of its points.

    Raises
    ------
    InputError
        As :func:`read_points_table`, or if the file holds landmarks.
    """
    name, text = str(source.path), source.text()
    if _VERSION.match(text.lstrip()):
        raise InputError(
            f"{name}: holds landmarks, no point cloud; move it out of the folder of the shapes"
        )
    lines = [line for line in text.split("\n") if line.strip()]
    starts = [at for at, line in enumerate(lines) if line.strip().isdecimal()]
    bounds = [*starts, len(lines)] if starts[:1] == [0] else [0, len(lines)]
    scans = [
        read_points_table("\n".join(lines[start:stop]), name, columns, is_pts=bool(starts))
        for start, stop in pairwise(bounds)
    ]
    notes = dict.fromkeys(note for scan in scans for note in scan.notes)
    return RawShape(np.concatenate([scan.vertices for scan in scans]), no_faces(), tuple(notes))


def is_landmark_pts(path: Path) -> bool:
    """Return whether a file is a PTS file of landmarks, which begins with a version; False if unreadable."""
    return path.suffix.lower() == ".pts" and _VERSION.match(beginning_of(path).lstrip()) is not None


def is_table_of_specimens(path: Path) -> bool:
    """Return whether a text file is a table without coordinates, such as one of specimens; False if unreadable.

    It has two columns or more, none of which is called x, y or z, and its first row has words.
    """
    with suppress(InputError):
        lines = [line for line in beginning_of(path).split("\n") if line.strip()][:2]
        table = read_table("\n".join(lines), str(path))
        first = table.rows()[0] if table.lines else []
        if 1 < len(table.heading) == len(first):
            has_words = any(cell and not is_decimal(cell) for cell in first)
            return has_words and not any(map(axis_of, map(str.lower, plain_words(table.heading))))
    return False


def read_points_table(text: str, name: str, columns: str = "", *, is_pts: bool = False) -> RawShape:
    """Return the points of a table of numbers, and a note of its other columns; missing numbers are NaN.

    Which columns are x, y and z says the user, else a heading (:func:`data_tools.io.text_tables.read_table`). Without
    either they are the only three columns of numbers, or the first three of a documented format: x, y, z with an
    intensity, a colour of integers to 255 or a unit normal. What could also be a number, class or time before x, y, z
    is refused, but in PTS files with a count, whose format says that x, y, z come first.

    Numbers have decimal points, or decimal commas where these separate no columns and no number has a point.

    Parameters
    ----------
    text : str
    name : str
        The file, for messages.
    columns : str
        Names of the columns, separated by commas, among them x, y and z.
    is_pts : bool
        Whether the columns are those of a PTS file.

    Raises
    ------
    InputError
        If there are no points, a row is malformed, the table can be read in more than one way, or its heading
        contradicts ``columns``.
    """
    table = read_table(text, name)
    if not table.lines:
        raise InputError(f"{name}: holds no points")
    if table.separator != ",":
        table = table._replace(lines=_with_decimal_points(table.lines, table.separator))
    values, num_named = table.numbers(), len(table.heading)
    axes = _named_axes(table.heading, columns, name)
    if values is not None and axes is None:
        values = values[:, : _width(values)]
        _refuse_split_decimals(table, name)
        if values.shape[1] > 3:
            _refuse_unclear(values, name, is_pts=is_pts)
        axes = (0, 1, 2)
    if (
        values is not None
        and axes
        and num_named in (0, values.shape[1])
        and max(axes) < values.shape[1]
    ):
        points, width = np.ascontiguousarray(values[:, list(axes)]), values.shape[1]
    else:
        rows = table.rows()
        width = num_named or len(rows[0])
        points = _row_by_row(rows, width, axes, name)
    has_more = (sum(map(bool, table.heading)) if num_named else width) > 3
    return RawShape(points, no_faces(), (*table.notes, *not_kept(["further columns"] * has_more)))


def _named_axes(heading: Sequence[str], columns: str, name: str) -> tuple[int, int, int] | None:
    """Return the columns that the user or a heading calls x, y and z, None where nobody names any."""
    said = plain_words(columns.lower().split(","))
    by_user = (said.index("x"), said.index("y"), said.index("z")) if columns else None
    if not heading:
        return by_user
    found, _ = axis_columns(heading)
    if found is not None and len(found) == 3:
        axes = found[0], found[1], found[2]
        if by_user not in (None, axes) and {*"xyz"} <= {*map(str.lower, plain_words(heading))}:
            raise InputError(
                f"{name}: its heading has x, y and z in columns {', '.join(str(at + 1) for at in axes)}, which "
                "contradicts --columns. Leave that out, or take the heading away"
            )
        return by_user or axes
    if by_user:
        return by_user
    raise InputError(
        f"{name}: {'several columns' if found else 'not all three columns'} of its heading of {len(heading)} are "
        "called x, y or z; name the three columns x, y and z, there or with --columns"
    )


def _width(values: FloatArray) -> int:
    """Return the number of columns without the empty ones at the end, at least three."""
    return max(3, int(np.flatnonzero(~np.isnan(values).all(axis=0)).max(initial=-1)) + 1)


def _row_by_row(
    rows: list[list[str]], width: int, axes: Sequence[int] | None, name: str
) -> FloatArray:
    """Return the columns of x, y and z, shape (n, 3), or say which row is wrong."""
    expected = max(width, 3, *(at + 1 for at in axes or ()))
    for number, row in enumerate(rows, start=1):
        if len(row) != width or width < expected:
            why = "decimal commas?" if len(row) == 2 * width else "truncated?"
            raise InputError(
                f"{name}: row {number} has {len(row)} columns, expected {expected} ({why})"
            )
    axes = _only_numbers(rows, name) if axes is None else axes
    points = []
    for number, row in enumerate(rows, start=1):
        wanted = [row[at] or "nan" for at in axes]
        if not all(map(is_number, wanted)):
            commas = "; save it with decimal points" if any("," in word for word in wanted) else ""
            raise InputError(
                f"{name}: row {number} is not numbers in the columns of x, y and z{commas}"
            )
        points.append([float(word) for word in wanted])
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _only_numbers(rows: list[list[str]], name: str) -> tuple[int, ...]:
    """Return the columns of x, y and z of a table without a heading, in which other columns are text."""
    every = range(len(rows[0]))
    if len(every) == 3:
        return 0, 1, 2
    text = {at for at in every if not any(is_number(row[at]) for row in rows)}
    numbers = tuple(at for at in every if at not in text)
    if text and len(numbers) == 3 and numbers[2] - numbers[0] == 2:
        return numbers
    odd = next(at for at, row in enumerate(rows, 1) if not all(map(is_number, row)))
    reason = f"{len(numbers)} columns of numbers" if text else f"row {odd} is not numbers alone"
    raise InputError(
        f"{name}: has no heading, and {reason}; it is not clear which columns are x, y and z. Add a heading, or name "
        "them with --columns"
    )


def _refuse_unclear(values: FloatArray, name: str, *, is_pts: bool) -> None:
    """Refuse a table of more than three columns in no documented format, or whose first may be no coordinates."""
    width = values.shape[1]
    after = _extras(values[:, 3:])
    before = "" if is_pts else _before(values)
    if after and not before:
        return
    before = before or "number"
    more = ", ..." if width > 3 + len(before.split()) else ""
    raise InputError(
        f"{name}: has no heading, and its {width} columns can be read as x, y, z, {after or '...'}, or as {before}, "
        f"x, y, z{more}. Say which with --columns x,y,z or --columns {before.replace(' ', '')},x,y,z (in Python "
        "cleaning={'columns': ...}), or add a heading"
    )


def _extras(values: FloatArray) -> str:
    """Return what the columns after x, y and z are in a documented format, empty if they fit none."""
    for layout in _LAYOUTS.get(values.shape[1] + 3, ()):
        kinds = re.findall("i|rgb|nnn", layout)
        starts = np.cumsum([0, *map(len, kinds)])
        if all(
            _FITS[kind](values[:, start : start + len(kind)])
            for kind, start in zip(kinds, starts, strict=False)
        ):
            return ", ".join(_CALLED[kind] for kind in kinds)
    return ""


def _before(values: FloatArray) -> str:
    """Return what one or two columns before x, y and z may be, empty if they cannot be anything there."""
    for num in (1, 2):
        rest = values.shape[1] - num
        if rest < 3 or not (rest == 3 or rest in _LAYOUTS):
            continue
        if all(_is_whole(column) for column in values[:, :num].T):
            return "number" if num == 1 else "row, column"
        if num == 1 and bool((np.diff(values[:, 0]) >= 0).all()):
            return "time"
        if num == 1 and _is_intensity(values[:, :1]):
            return "intensity"
        if num == 1 and _is_intensity(values[:, 1:3]):  # as y and z of its kind would not be
            return "value"
    return ""


def _is_whole(values: FloatArray) -> bool:
    return bool((values == np.floor(values)).all())


def _is_intensity(values: FloatArray) -> bool:
    """Return whether values are whole numbers or shares."""
    return _is_whole(values) or bool(((values >= 0) & (values <= 1)).all())


def _is_colour(values: FloatArray) -> bool:
    return _is_whole(values) and bool(((values >= 0) & (values <= 255)).all())


def _is_normal(values: FloatArray) -> bool:
    lengths = np.linalg.norm(values, axis=1)
    near = np.abs(lengths - 1.0) < _NORMAL_TOL
    return bool((near | (lengths == 0)).all() and near.any())


_FITS = {"i": _is_intensity, "rgb": _is_colour, "nnn": _is_normal}


def _with_decimal_points(lines: list[str], separator: str | None) -> list[str]:
    """Return lines with points for decimal commas, unless a number has a point or all commas may mark thousands."""
    if not any("," in line for line in lines):
        return lines
    cells = [cell.strip("\"' ") for line in lines for cell in line.split(separator)]
    numbers = [cell for cell in cells if _COMMA_NUMBER.fullmatch(cell)]
    if all(map(THOUSANDS.fullmatch, numbers)) or any(
        "." in cell and is_number(cell) for cell in cells
    ):
        return lines
    return [re.sub(r",(?=\d)", ".", line) for line in lines]


def _refuse_split_decimals(table: TextTable, name: str) -> None:
    """Refuse whole numbers between commas in six columns or more, half of which may be the decimals of the others."""
    width = table.lines[0].count(",") + 1
    if table.separator != "," or width < 6 or width % 2:
        return
    rows = [[cell.strip() for cell in line.split(",")] for line in table.lines]
    is_whole = all(re.fullmatch(r"[+-]?\d+", one) for row in rows for one in row)
    if is_whole and not any(cell[0] in "+-" for row in rows for cell in row[1::2]):
        raise InputError(
            f"{name}: commas seem to mark both columns and decimals. Save it with semicolons between columns or with "
            "decimal points. If each number is a column of its own, name them with --columns"
        )


def _molecule(text: str, name: str) -> tuple[str, str] | None:
    """Return the rows and the columns of a molecule: their number, a comment, and an element, x, y, z in each row.

    None where a text is no such file. What an extended XYZ file says in its comment (``Properties=``) names columns.

    Raises
    ------
    InputError
        If it holds several models.
    """
    lines = text.split("\n", 3)
    if len(lines) < 3 or not (lines[0].strip().isdecimal() and len(lines[0].strip()) < 10):
        return None
    num, first = int(lines[0]), lines[2].split()
    if num < 1 or len(first) < 4:
        return None
    said = _PROPERTIES.search(lines[1])
    comment = lines[1].split()
    is_row = {*"xyz"} <= {*map(str.lower, plain_words(comment))} or (
        len(comment) == len(first)
        and _ELEMENT.fullmatch(comment[0])
        and all(map(is_decimal, comment[1:4]))
    )
    is_atom = said or (all(map(is_decimal, first[1:4])) and _ELEMENT.fullmatch(first[0]))
    if is_row or not is_atom:
        return None
    every = text.rstrip("\n").split("\n")
    rows, rest = every[2 : 2 + num], [line for line in every[2 + num :] if line.strip()]
    words = [row.split(maxsplit=1)[:1] for row in rows]
    if len(rows) < num or not (said or all(one and _ELEMENT.fullmatch(one[0]) for one in words)):
        return None
    if rest and not rest[0].strip().isdecimal():
        return None
    if rest:
        raise InputError(
            f"{name}: holds more than one model of {num} atoms, and only one can be a shape. Save each as a file"
        )
    return "\n".join(rows), _properties(said[1]) if said else "element,x,y,z"


def _properties(said: str) -> str:
    """Return the names of columns that the comment of an extended XYZ file gives (``species:S:1:pos:R:3``)."""
    parts = said.split(":")
    names = [
        f"{name}{at}" if name != "pos" else "xyz"[at % 3]
        for name, num in zip(parts[::3], parts[2::3], strict=False)
        for at in range(min(int(num[:4]), 1000))
    ]
    return ",".join(names)
