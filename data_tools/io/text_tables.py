"""Tables in text, of points and of landmarks: their rows, and what their headings say of columns; and CSV written.

A column is what its heading or the user says, never what its values look like. What a table does not make clear is
refused with the reason; a guess would be a wrong shape without a word.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.notes import Note

#: What tables write where there is no number.
MISSING = re.compile(
    r"(?i)[+-]?(nan(\(\w*\))?|1\.#\w+|#?n/?a|#(num|value)!|null|none|missing|undefined|[-.?])?"
)
#: Whole lines, and what follows a number and a blank.
_COMMENT = re.compile(
    r"^[ \t]*(?:#|//)(.*)|(?<=\d)[ ]+(?:#(?!n/?a\b|num!|value!)|//).*", re.MULTILINE | re.IGNORECASE
)
#: NaN and infinity as programs on Windows spell them.
_NO_NUMBER = re.compile(r"1\.#\w+|nan\(\w*\)", re.IGNORECASE)
#: A number with a decimal point or comma.
_NUMBER = re.compile(r"[+-]?(?:(?:\d+(?:\.\d*|,\d+)?|[.,]\d+)(?:[eE][+-]?\d+)?|(?i:inf(?:inity)?))")
#: A number whose comma may mark thousands instead of decimals.
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_BETWEEN_NUMBERS = re.compile(r"\d[ ]+[-+.\d]")
#: None inside of others: a heading of brackets takes no time.
_BRACKETS = re.compile(r"[(\[{][^()\[\]{}]*[)\]}]")
#: Places of missing numbers.
_EMPTY_CELL = {
    sign: re.compile(rf"(?:^|(?<={sign}))[ ]*(?={sign}|$)", re.MULTILINE)
    for sign in (",", ";", "\t")
}
#: Rows by which blanks and commas are told apart as what separates columns.
_NUM_TRIED = 1000
#: Words that a heading may have beside the letter of an axis.
_POINT = r"pos|position|points?|coords?|coordinates?|koordinate|vertex|landmark|axis"
_BESIDE = re.compile(rf"(?:{_POINT}|mm|cm|m|um|µm|nm|in|inch|px)?")
_AXIS = re.compile(rf"(?:{_POINT})?([xyz])(?:mm|cm|um|µm|nm)?")
_ON_A_MAP = {"easting": "x", "northing": "y", "elevation": "z", "height": "z", "altitude": "z"}
#: Headings of the column that names a landmark; the first of them counts.
LABELS = ("label", "landmark", "name", "point", "id", "no", "nr", "number", "index", "")
#: The names of axes, and the coordinate system that they declare.
_SYSTEMS = (("xyz", None), ("ras", "RAS"), ("lps", "LPS"))


class TextTable(NamedTuple):
    """A table as its text has it.

    Attributes
    ----------
    heading : tuple of str
        The names of the columns, empty where nothing names them.
    lines : list of str
        One of each row.
    separator : str or None
        What stands between columns, None for blanks.
    comments : str
        Lines that are no rows.
    notes : tuple of Note
        What is odd about it.
    """

    heading: tuple[str, ...]
    lines: list[str]
    separator: str | None
    comments: str
    notes: tuple[Note, ...] = ()

    def rows(self) -> list[list[str]]:
        """Return the cells of every row."""
        return _cells(self.lines, self.separator)

    def numbers(self) -> FloatArray | None:
        """Return a table of numbers with decimal points, without a Python object for each; None where it is none."""
        text = "\n".join(self.lines)
        if '"' in text or (self.separator != "," and "," in text):
            return None
        if self.separator is not None:
            text = _EMPTY_CELL[self.separator].sub("nan", text).replace(self.separator, " ")
        return parse_table(text, num_rows=len(self.lines))


def read_table(text: str, name: str) -> TextTable:
    """Read which rows a text has, and what names their columns: a first row, or a comment before it.

    Columns are separated by semicolons, tabs, blanks or commas. Lines that begin with ``#`` or ``//`` are comments. A
    first line with one whole number says how many rows follow.

    Parameters
    ----------
    text : str
        With Unix line ends; other characters that end lines are blanks.
    name : str
        The file, for messages.

    Raises
    ------
    InputError
        If fewer rows follow than announced, or more than one more; or if commas and blanks could separate columns.
    """
    text = SEPARATOR_LINE.sub("", text)
    comments = list[str]()
    if "#" in text or "//" in text:
        comments = [found[1] for found in _COMMENT.finditer(text) if found[1] is not None]
        text = _COMMENT.sub("", text)
    lines = [line.strip(" \r") for line in text.split("\n")]
    lines, notes = _counted([line for line in lines if line.strip(" \t,;\v\f")], name)
    if not lines:
        return TextTable((), [], None, "\n".join(comments), notes)
    separator = _separator(lines, name)
    names = _cells([_without_brackets(lines[0])], separator)[0]
    if is_heading(names):
        return TextTable(tuple(names), lines[1:], separator, "\n".join(comments), notes)
    width = len(_cells(lines[:1], separator)[0])
    heading = next(filter(None, (_commented(line, width) for line in reversed(comments))), ())
    return TextTable(heading, lines, separator, "\n".join(comments), notes)


def is_heading(row: Sequence[str]) -> bool:
    """Return whether a first row names columns: at least three words, or two of two, and no number."""
    if row[1:] in (["0", "1", "2"], ["1", "2", "3"]) and row[0].lower() in LABELS:
        return True
    words = sum(not MISSING.fullmatch(cell) for cell in row)
    return words >= min(3, max(len(row), 2)) and not any(map(is_decimal, row))


def is_decimal(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point or comma."""
    return _NUMBER.fullmatch(cell) is not None


def plain_words(heading: Iterable[str]) -> list[str]:
    """Return the names of columns without units."""
    return [_without_brackets(cell).strip(" _#.:\"'") for cell in heading]


def axis_columns(heading: Sequence[str]) -> tuple[tuple[int, ...] | None, str | None]:
    """Return the columns that a heading calls x, y and z, and the coordinate system that their names declare.

    Units and words such as "pos" do not matter. More than three where several have one name, None where an axis has
    none; of three columns without such names, all in their order.
    """
    words = [word.lower() for word in plain_words(heading)]
    for letters in (words, [axis_of(word) for word in words]):
        for axes, system in _SYSTEMS:
            if {*axes} <= {*letters}:
                return tuple(
                    at for axis in axes for at, letter in enumerate(letters) if letter == axis
                ), system
    several = len(set(filter(None, letters))) < len(list(filter(None, letters)))
    return ((0, 1, 2) if len(words) == 3 and not several else None), None


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


def _counted(lines: list[str], name: str) -> tuple[list[str], tuple[Note, ...]]:
    """Return the lines after the one that says how many they are, all of them where none does.

    Scanners are known that announce one less than they write, so that is read, with a note.
    """
    if not lines or not (lines[0].isascii() and lines[0].isdecimal()):
        return lines, ()
    found = len(lines) - 1 - is_heading(re.split(r"[\s,;]+", lines[1]) if lines[1:] else ())
    if lines[0].lstrip("0") == str(found).lstrip("0"):
        return lines[1:], ()
    if found > 1 and lines[0].lstrip("0") == str(found - 1):
        return lines[1:], (Note("count-off", values={"said": found - 1, "found": found}),)
    is_short = len(lines[0]) > len(str(found)) or int(lines[0]) > found
    raise InputError(
        f"{name}: its first line promises {lines[0][:20]} points, {found} lines follow. "
        + ("It is truncated; get it anew" if is_short else "To read all, delete that line")
    )


def _separator(lines: list[str], name: str) -> str | None:
    """Return what separates columns, None for blanks."""
    for sign in (";", "\t"):
        if sum(sign in line for line in lines) * 2 > len(lines):
            return sign
    if sum("," in line for line in lines) * 2 <= len(lines):
        return None
    tried = [line for line in lines[: 2 * _NUM_TRIED] if "," in line]
    by_blanks, by_commas = (
        sum(sum(map(is_decimal, row)) >= 3 for row in _cells(tried, sign)) * 2 > len(tried)
        for sign in (None, ",")
    )
    odd = next((at for at, line in enumerate(tried) if _BETWEEN_NUMBERS.search(line)), None)
    if by_blanks == by_commas and odd is not None:
        raise InputError(
            f"{name}: both commas and blanks stand between numbers, first in row {odd + 1}; it is not clear what "
            "separates columns. Save it with one separator and with decimal points"
        )
    return None if by_blanks and not by_commas else ","


def _cells(lines: list[str], separator: str | None) -> list[list[str]]:
    """Return the cells of lines, without quotes around them."""
    if separator is None:
        return [[plain_cell(cell.strip('"')) for cell in line.split()] for line in lines]
    try:
        read = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
        return [[plain_cell(cell.strip()) for cell in row] for row in read]
    except csv.Error:  # a quote that does not end would swallow rows
        return [[cell.strip() for cell in line.split(separator)] for line in lines]


def _commented(line: str, width: int) -> tuple[str, ...]:
    """Return the names that a comment gives to so many columns, none if it does not."""
    said, _, named = line.partition("=")
    is_said = said.strip().lower() == "columns"
    words = re.split(r"[\s,;]+", _without_brackets(named if is_said else line).strip(" \t,;"))
    is_named = (
        len(words) == width and ":" not in line and {*"xyz"} <= {word.lower() for word in words}
    )
    return tuple(words) if is_said or is_named else ()


def _without_brackets(text: str) -> str:
    return _BRACKETS.sub("", text)


def axis_of(word: str) -> str:
    """Return which axis the name of a column is, in lower case; empty if none."""
    parts = re.split(r"[ _.:-]+", _ON_A_MAP.get(word, word))
    found = [_AXIS.fullmatch(part) for part in parts]
    letters = [one[1] for one in found if one]
    if not letters and len(parts) == 2 and re.fullmatch(_POINT, parts[0]) and parts[1] in {*"012"}:
        return "xyz"[int(parts[1])]
    others = [part for part, one in zip(parts, found, strict=True) if not one]
    return letters[0] if len(letters) == 1 and all(map(_BESIDE.fullmatch, others)) else ""


#: Text that spreadsheets take for a formula, in ASCII or full width, or that a reader would take for an escaped one.
_FORMULA = re.compile(r"'*[=+\-@\t\r\uff1d\uff0b\uff0d\uff20]")
#: What ends a line for some readers, besides the characters that the csv module knows.
_LINE_END = re.compile("[\v\f\x1c-\x1e\x85\u2028\u2029]")

#: A first line by which Excel tells which sign separates columns.
SEPARATOR_LINE = re.compile(r"\A\ufeff?\"?sep=[;,\t|]\"?[ \t]*\r?\n", re.IGNORECASE)


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as CSV with Unix line ends; numbers are written in full, NaN as an empty cell.

    Parameters
    ----------
    rows : iterable of iterables
        Text that begins with ``=``, ``+``, ``-`` or ``@``, in ASCII or full width, and is no number gets an
        apostrophe before it, which :func:`plain_cell` takes away again. Text with any sign that ends a line is in
        quotes.
    """
    text = io.StringIO()
    plain, quoting = (
        csv.writer(text, lineterminator="\n", quoting=how)
        for how in (csv.QUOTE_MINIMAL, csv.QUOTE_NONNUMERIC)
    )
    for row in rows:
        cells = [_cell(value) for value in row]
        odd = any(isinstance(cell, str) and _LINE_END.search(cell) for cell in cells)
        (quoting if odd else plain).writerow(cells)
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
