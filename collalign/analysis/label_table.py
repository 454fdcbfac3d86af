"""Tables of labels: one row per shape, one column per kind of label (taxon, side, sex, ...)."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from data_tools.errors import InputError
from data_tools.io.files import composed, read_any_text
from data_tools.io.listing import READERS
from data_tools.io.text_tables import plain_cell
from data_tools.notes import Note

#: Values that mean "not known", compared without regard to case.
UNKNOWN = frozenset({"", "na", "n/a", "nan", "none", "unknown", "?"})
#: Columns that may hold the shapes' names, the first found counts; otherwise it is the first column.
NAME_COLUMNS = ("name", "shape", "specimen", "id", "file")
#: A number with a decimal comma or without decimals, and one whose comma may mark thousands instead.
_WITH_COMMA = re.compile(r"[+-]?\d*,?\d+(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Labels:
    """A table of labels by shape.

    Attributes
    ----------
    source : str
        The file it came from, for messages.
    columns : mapping of str to mapping of str to str
        Column name, then shape name, to the value; ``""`` where unknown.
    rows : tuple of tuple of str
        The names that lead to each row.
    """

    source: str
    columns: Mapping[str, Mapping[str, str]]
    rows: tuple[tuple[str, ...], ...]

    def column(self, by: str, names: Sequence[str]) -> tuple[str, ...]:
        """Return values of one column for the named shapes, ``""`` where the table has no row for a shape.

        Raises
        ------
        InputError
            If there is no such column, or not a single one of the shapes has a value in it.
        """
        by = composed(by)
        if by not in self.columns:
            raise InputError(
                f"{self.source}: no column {by!r}; it has {', '.join(map(repr, self.columns)) or 'none'}"
            )
        values = tuple(self.columns[by].get(name, "") for name in names)
        if not any(values):
            raise InputError(
                f"{self.source}: column {by!r} has no value for any of the {len(names)} shapes; "
                f"its names must be those of the shapes ({', '.join(names[:3])}, ...)"
            )
        return values

    def columns_for(self, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Return all columns that say something about the named shapes."""
        found = {
            by: tuple(values.get(name, "") for name in names) for by, values in self.columns.items()
        }
        return {by: values for by, values in found.items() if any(values)}

    def mismatches(self, names: Sequence[str]) -> list[Note]:
        """Return notes on rows that belong to none of the named shapes, and on shapes without a row."""
        strange = [row[0] for row in self.rows if not {*row} & {*names}]
        bare = sorted({*names} - {name for row in self.rows for name in row})
        found = []
        if strange:
            found.append(
                Note("labels-unknown", values={"source": str(self.source), "rows": tuple(strange)})
            )
        if bare:
            found.append(Note("labels-missing", tuple(bare), {"source": str(self.source)}))
        return found


def read_labels(path: Path | str) -> Labels:
    """Read a CSV file with one row per shape and a heading.

    Columns are separated by commas, semicolons or tabs; numbers may have decimal commas where these separate nothing.
    Names are compared without folder and without a mesh file's ending; where there is also a column ``file``, both
    lead to the row. Values such as ``NA`` count as unknown.

    Raises
    ------
    InputError
        If the file cannot be read as such a table, or names a shape twice with different values.
    """
    source = Path(path)
    try:
        text = read_any_text(source)
    except InputError as error:
        raise InputError(
            f"{source}: cannot be read as text ({error}); save the table as CSV in UTF-8"
        ) from error
    try:
        dialect = _dialect(text)
        lines = text.rstrip("\n").split("\n")
        rows = [[plain_cell(cell) for cell in row] for row in csv.reader(lines, dialect)]
    except csv.Error as error:
        raise InputError(f"{source}: cannot be read as a table ({error})") from None
    if len(rows) < 2 or len(rows[0]) < 2:
        raise InputError(
            f"{source}: expected a heading and rows with a name and at least one label, separated by commas"
        )
    heading = [cell.strip() for cell in rows[0]]
    lower = [cell.lower() for cell in heading]
    at_name = next((lower.index(name) for name in NAME_COLUMNS if name in lower), 0)
    at_file = [at for at, name in enumerate(lower) if name == "file"]
    columns: dict[str, dict[str, str]] = {
        column: {} for at, column in enumerate(heading) if column and at not in (at_name, *at_file)
    }
    named: list[tuple[str, ...]] = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(heading):
            raise InputError(
                f"{source}, line {number}: {len(row)} cells under {len(heading)} headings"
            )
        named.append(tuple(dict.fromkeys(shape_name(row[at]) for at in (at_name, *at_file))))
        for name in named[-1]:
            for column, cell in zip(heading, row, strict=True):
                if column in columns:
                    problem = f"{source}, line {number}: {name!r} is listed twice"
                    _enter(columns[column], name, known_label(cell), problem)
    of_excel = dialect.delimiter == ";"
    columns = {
        column: _with_decimal_points(values, are_decimals=of_excel)
        for column, values in columns.items()
    }
    return Labels(source=str(source), columns=columns, rows=tuple(named))


def _with_decimal_points(values: dict[str, str], *, are_decimals: bool) -> dict[str, str]:
    """Return the values of a column with points for decimal commas, where all are numbers and none are thousands."""
    known = [value for value in values.values() if value]
    with_comma = [value for value in known if "," in value]
    may_be_thousands = not are_decimals and all(map(_THOUSANDS.fullmatch, with_comma))
    if not with_comma or may_be_thousands or not all(map(_WITH_COMMA.fullmatch, known)):
        return values
    return {name: value.replace(",", ".") for name, value in values.items()}


def shape_name(text: str) -> str:
    """Return the name of a shape as a table may write it: without folder and ending of a file of shapes."""
    name = text.strip().replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, ending = name.rpartition(".")
    return stem if dot and f".{ending.lower()}" in READERS else name


def _dialect(text: str) -> type[csv.Dialect]:
    try:
        return csv.Sniffer().sniff(text[:4096], delimiters=",;\t")
    except csv.Error:
        return csv.excel


def known_label(cell: str) -> str:
    """Label without surrounding blanks, ``""`` if it says that nothing is known."""
    value = cell.strip()
    return "" if value.lower() in UNKNOWN else value


def _enter(column: dict[str, str], name: str, value: str, problem: str) -> None:
    if column.get(name, value) != value:
        raise InputError(f"{problem} with different labels; keep one row per shape")
    column[name] = value
