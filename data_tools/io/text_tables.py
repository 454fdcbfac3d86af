"""Tables in text: numbers read (which signs separate columns, which columns are x, y and z), and CSV written.

What a table does not make clear is refused with the reason; a guess would be a wrong shape without a word.
"""

from __future__ import annotations

import csv
import io
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.io.files import open_regular
from data_tools.io.formats.raw_shape import RawShape, no_faces, not_kept
from data_tools.io.source import Source

#: Rows from which the columns of a table without a heading are tried for being numbered.
_MIN_NUMBERED_ROWS = 3
#: First line of PTS files of landmarks.
_VERSION = re.compile(r"version\b", re.IGNORECASE)
_WORD = re.compile(r"[^\d\s.,eE+-]")
_COMMENT = re.compile(r"(?:(?<!1\.)#|//).*")
#: NaN and infinity as programs on Windows spell them.
_NO_NUMBER = re.compile(r"1\.#\w+|nan\(\w*\)", re.IGNORECASE)
_BETWEEN_WORDS = re.compile(r"[^\s,][ ]+[^\s,]")
_BRACKETS = re.compile(
    r"[(\[{][^()\[\]{}]*[)\]}]"
)  # none inside of others: a heading of brackets takes no time
_UNIT = re.compile(_BRACKETS.pattern + r"|(?:(?<=[xyz])[ _]?(?:mm|cm|m|um|µm|nm|in|inch|px))$")
_AXIS = re.compile(
    r"(?:(?:pos|position|points?|coords?|coordinates?|vertex|v|p)[ _.:]*)?([xyz012])"
)
_ON_A_MAP = {"easting": "x", "northing": "y", "elevation": "z", "height": "z", "altitude": "z"}
#: A number with a decimal comma, and one whose comma may mark thousands instead.
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
#: Places of missing numbers.
_EMPTY_CELL = {
    sign: re.compile(rf"(?:^|(?<={sign}))[ ]*(?={sign}|$)", re.MULTILINE)
    for sign in (",", ";", "\t")
}
_AXES = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}


def parse_table(text: str, *, num_rows: int) -> FloatArray | None:
    """Return lines that hold equally many numbers each, separated by blanks, as an array (num_rows, columns).

    None where they do not: the caller then goes through them one by one, to name the line that is wrong. Numbers that
    a program on Windows could not write (``1.#QNAN``, ``-nan(ind)``) are NaN.
    """
    if not text.strip():
        return None
    try:
        values = np.loadtxt(io.StringIO(text), comments=None, ndmin=2)
    except ValueError:
        spelled = _NO_NUMBER.sub("nan", text)
        return parse_table(spelled, num_rows=num_rows) if spelled != text else None
    return values if len(values) == num_rows else None


def read_text_points(source: Source) -> RawShape:
    """Return the points of a table of numbers; further columns (colours, normals) are ignored.

    Columns called x, y and z are taken where the first line is a heading, else the first three; see
    :func:`read_points_table` for what is understood and what is refused.
    """
    return read_points_table(source.text(), str(source.path))


def read_pts(source: Source) -> RawShape:
    """Return the points of all scans of a PTS file, each of which begins with the number of its points.

    Raises
    ------
    InputError
        As :func:`read_points_table`, or if the file holds landmarks.
    """
    path, lines = source.path, _lines(source.text())
    if lines and _VERSION.match(lines[0]):
        raise InputError(
            f"{path}: holds landmarks, no point cloud; move it out of the folder of the shapes"
        )
    starts = [at for at, line in enumerate(lines) if line.isdecimal()]
    bounds = [*starts, len(lines)] if starts[:1] == [0] else [0, len(lines)]
    scans = [
        read_points_table("\n".join(lines[start:stop]), str(path))
        for start, stop in pairwise(bounds)
    ]
    return RawShape(np.concatenate([scan.vertices for scan in scans]), no_faces(), scans[0].notes)


def is_landmark_pts(path: Path) -> bool:
    """Return whether a file is a PTS file of landmarks, which begins with a version; False if unreadable."""
    return path.suffix.lower() == ".pts" and _VERSION.match(_beginning(path).lstrip()) is not None


def is_table_of_specimens(path: Path) -> bool:
    """Return whether a text file is a table without coordinates, such as one of specimens; False if unreadable.

    It has two columns or more, none of which is called x, y or z, and its first row has words.
    """
    with suppress(InputError):
        lines = _lines(_beginning(path))[:2]
        heading, rows = _cells(lines, _delimiter(lines, str(path))) if lines else (None, [])
        if heading and rows and not any(map(_axis, heading)) and 1 < len(heading) == len(rows[0]):
            return any(_WORD.search(cell) and not is_number(cell) for cell in rows[0])
    return False


def _beginning(path: Path) -> str:
    """Return the first characters of a file, none if it is unreadable."""
    with suppress(InputError), open_regular(path, sys.maxsize) as stream:
        return stream.read(io.DEFAULT_BUFFER_SIZE).decode("utf-8-sig", "replace")
    return ""


def read_points_table(text: str, name: str) -> RawShape:
    """Return the points of a table of numbers, and a note of its other columns; missing numbers are NaN.

    Columns are separated by semicolons, tabs, commas or blanks, in this order of preference; ``#`` and ``//`` start
    comments. Numbers have decimal points, or decimal commas where semicolons or tabs separate columns and no number
    has a point. A first line with one whole number says how many points follow.

    Parameters
    ----------
    text : str
    name : str
        The file, for messages.

    Raises
    ------
    InputError
        If there are no points, a row is malformed, or the table can be read in more than one way.
    """
    lines = _counted_lines(_lines(text), name)
    if not lines:
        raise InputError(f"{name}: holds no points")
    delimiter = _delimiter(lines, name)
    if delimiter is not None and delimiter != ",":
        lines = _with_decimal_points(lines, delimiter)
    heading, first = _cells(lines[:1], delimiter)
    body = lines if heading is None else lines[1:]
    if not body:
        raise InputError(f"{name}: holds no points")
    columns = [0, 1, 2] if heading is None else _axis_columns(heading, name)
    width = len(heading or first[0])
    values = _plain_numbers(body, delimiter)
    if values is None or values.shape[1] != width or width <= max(columns):
        values, columns = _row_by_row(*_cells(lines, delimiter), width, columns, name), [0, 1, 2]
    if heading is None:
        _refuse_numbered(values[:, 0], width, name)
        _refuse_grid(values, name)
        if delimiter == "," and width >= 6 and (values == np.floor(values)).all():
            _refuse_split_decimals(_cells(body, delimiter)[1], name)
    num_named = width if heading is None else sum(map(bool, heading))
    lost = not_kept(["further columns"] * (num_named > 3))
    return RawShape(np.ascontiguousarray(values[:, columns]), no_faces(), lost)


def _lines(text: str) -> list[str]:
    """Return the lines that hold anything, without comments."""
    text = _COMMENT.sub("", SEPARATOR_LINE.sub("", text))
    return [line.strip(" \r\n") for line in text.splitlines() if not line.isspace() and line]


def _counted_lines(lines: list[str], name: str) -> list[str]:
    """Return the lines after the one that says how many they are, all of them where none does.

    Raises
    ------
    InputError
        If there are more or fewer than it says.
    """
    if not lines or not lines[0].isdecimal():
        return lines
    if lines[0].lstrip("0") != str(len(lines) - 1).lstrip("0"):
        raise InputError(
            f"{name}: its first line promises {lines[0][:20]} points, {len(lines) - 1} lines follow"
        )
    return lines[1:]


def _delimiter(lines: list[str], name: str) -> str | None:
    """Return what separates columns, None for blanks.

    Raises
    ------
    InputError
        If commas and blanks both could.
    """
    text = "\n".join(lines)
    for sign in (";", "\t"):
        if sign in text and sum(sign in line for line in lines) * 2 > len(lines):
            return sign
    if "," not in text:
        return None
    if not _BETWEEN_WORDS.search(text):
        return ","
    body = [line for line in lines if re.search(r"\d", line)]
    between_words = [line for line in body if _BETWEEN_WORDS.search(line) and not _has_words(line)]
    if not between_words:
        return ","
    raise InputError(
        f"{name}: both commas and blanks stand between numbers, first in row {body.index(between_words[0]) + 1}; "
        "it is not clear what separates columns. Save it with one separator and with decimal points"
    )


def _with_decimal_points(lines: list[str], delimiter: str) -> list[str]:
    """Return lines with points for decimal commas, unless a number has a point or all commas may mark thousands."""
    if not any("," in line for line in lines):
        return lines
    cells = [cell.strip("\"' ") for line in lines for cell in line.split(delimiter)]
    numbers = [cell for cell in cells if _COMMA_NUMBER.fullmatch(cell)]
    if all(map(_THOUSANDS.fullmatch, numbers)) or any(
        "." in cell and is_number(cell) for cell in cells
    ):
        return lines
    return [re.sub(r",(?=\d)", ".", line) for line in lines]


def _has_words(line: str) -> bool:
    """Return whether a cell of a comma-separated line is text, in which blanks mean nothing."""
    return any(_WORD.search(cell) is not None for cell in line.split(","))


def _cells(lines: list[str], delimiter: str | None) -> tuple[list[str] | None, list[list[str]]]:
    """Return the names of the columns where the first line holds any, and the rows; empty cells are empty."""
    if delimiter is not None:
        read = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
        rows = [[cell.strip() for cell in row] for row in read]
    else:
        rows = [[cell.strip("\"'") for cell in line.split()] for line in lines]
        if not _is_data(rows[0]):  # units in brackets are no columns
            rows[0] = [cell.strip("\"'") for cell in _BRACKETS.sub("", lines[0]).split()]
    if rows[0] and not _is_data(rows[0]):
        return rows[0], rows[1:]
    return None, rows


def _is_data(row: list[str]) -> bool:
    """Return whether a first row with an empty or unreadable first cell holds numbers all the same."""
    return any(is_number(cell.replace(",", ".")) for cell in row)


def _plain_numbers(lines: list[str], delimiter: str | None) -> FloatArray | None:
    """Return a table of numbers with decimal points, without a Python object for each; None where it is none."""
    text = "\n".join(lines)
    if '"' in text or (delimiter != "," and "," in text):
        return None
    if delimiter is not None:
        text = _EMPTY_CELL[delimiter].sub("nan", text).replace(delimiter, " ")
    return parse_table(text, num_rows=len(lines))


def _row_by_row(
    heading: list[str] | None, rows: list[list[str]], width: int, columns: list[int], name: str
) -> FloatArray:
    """Return the wanted columns, shape (n, 3), or say which row is wrong."""
    points = []
    for number, row in enumerate(rows, start=1):
        if len(row) != width or width <= max(columns):
            expected = max(width, max(columns) + 1)
            why = (
                "decimal commas?" if heading is not None and len(row) == 2 * width else "truncated?"
            )
            raise InputError(
                f"{name}: row {number} has {len(row)} columns, expected {expected} ({why})"
            )
        wanted = [row[c] or "nan" for c in columns]
        if not all(is_number(word) for word in wanted):
            commas = "; save it with decimal points" if any("," in word for word in wanted) else ""
            raise InputError(
                f"{name}: row {number} is not numbers in the columns of x, y and z{commas}"
            )
        points.append([float(word) for word in wanted])
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _axis_columns(heading: list[str], name: str) -> list[int]:
    """Return the places of x, y and z in a heading; units and words such as "pos" do not matter."""
    places: list[list[int]] = [[], [], []]
    for place, cell in enumerate(heading):
        axis = _axis(cell)
        if axis is not None:
            places[_AXES[axis]].append(place)
    if all(len(found) == 1 for found in places):
        return [found[0] for found in places]
    if len(heading) == 3 and not any(len(found) > 1 for found in places):
        return [0, 1, 2]
    several = any(len(found) > 1 for found in places)
    raise InputError(
        f"{name}: {'several columns' if several else 'not all three columns'} of its heading of {len(heading)} are "
        "called x, y or z; name the three columns x, y and z"
    )


def _axis(cell: str) -> str | None:
    """Return which axis a cell of a heading names, None if it names none."""
    word = _UNIT.sub("", cell.strip("\"' ").lower()).strip(" _")
    found = _AXIS.fullmatch(_ON_A_MAP.get(word, word))
    return found and found.group(1)


def _refuse_numbered(first: FloatArray, width: int, name: str) -> None:
    """Refuse a table of more than three columns, without a heading, whose first column counts its rows."""
    num = len(first)
    if width > 3 and num >= _MIN_NUMBERED_ROWS and np.array_equal(first - first[0], np.arange(num)):
        raise InputError(
            f"{name}: it is not clear which columns are x, y and z. The first column counts the rows, and there is "
            "no heading. Add a heading"
        )


def _refuse_grid(values: FloatArray, name: str) -> None:
    """Refuse a table without a heading whose first two columns are the row and column of a scanner's grid."""
    if values.shape[1] < 5 or len(values) < _MIN_NUMBERED_ROWS:
        return
    is_whole = (values == np.floor(values)).all(axis=0)
    if is_whole[:2].all() and not is_whole[2:5].any():
        raise InputError(
            f"{name}: it is not clear which columns are x, y and z. The first two are whole numbers, perhaps row and "
            "column of a scanner, and there is no heading. Add a heading"
        )


def _refuse_split_decimals(rows: list[list[str]], name: str) -> None:
    """Refuse whole numbers in an even number of columns, half of which look like the decimals of the others."""
    width = len(rows[0])
    if (
        width < 6
        or width % 2
        or not all(re.fullmatch(r"[+-]?\d+", cell) for row in rows for cell in row)
    ):
        return
    decimals = [cell for row in rows for cell in row[1::2]]
    if any(re.fullmatch(r"0\d+", cell) for cell in decimals) and not any(
        cell[0] in "+-" for cell in decimals
    ):
        raise InputError(
            f"{name}: commas seem to mark both columns and decimals; save it with "
            "semicolons between columns or with decimal points"
        )


#: Text that spreadsheets take for a formula, or that a reader would take for an escaped one.
_FORMULA = re.compile(r"'*[=+\-@\t\r]")

#: A first line by which Excel tells which sign separates columns.
SEPARATOR_LINE = re.compile(r"\A\ufeff?\"?sep=[;,\t|]\"?[ \t]*\r?\n", re.IGNORECASE)


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as CSV with Unix line ends; numbers are written in full, NaN as an empty cell.

    Parameters
    ----------
    rows : iterable of iterables
        Text that begins with ``=``, ``+``, ``-`` or ``@`` and is no number gets an apostrophe before it, which
        :func:`plain_cell` takes away again.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        writer.writerow([_cell(value) for value in row])
    return text.getvalue()


def plain_cell(cell: str) -> str:
    """Return a cell as it was before :func:`csv_text` wrote it."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def _cell(value: object) -> object:
    if isinstance(value, float) and value != value:
        return ""
    if isinstance(value, str) and _FORMULA.match(value) and not is_number(value):
        return f"'{value}"
    return value


def is_number(text: str) -> bool:
    """Return whether a cell is a number as tables have it; Python's underscores between digits are not."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
