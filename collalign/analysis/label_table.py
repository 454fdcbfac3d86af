"""Tables of labels: one row per shape, one column per kind of label (taxon, side, sex, ...)."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from data_tools.errors import InputError
from data_tools.io.files import read_any_text
from data_tools.io.text_tables import THOUSANDS, plain_cell
from data_tools.names import known_names, match_names, nearest_names, nearly
from data_tools.notes import Note, Value, listed

#: Values that mean "not known", compared without regard to case.
UNKNOWN = frozenset({"", "na", "n/a", "nan", "none", "unknown", "?"})
#: Columns that may hold the shapes' names, the first found counts; otherwise it is the first column.
NAME_COLUMNS = ("name", "shape", "specimen", "id", "file")
#: A number with a decimal comma or without decimals.
_WITH_COMMA = re.compile(r"[+-]?\d*,?\d+(?:[eE][+-]?\d+)?")


@dataclass(frozen=True, kw_only=True, eq=False)
class Labels:
    """A table of labels by shape.

    Attributes
    ----------
    source : str
        The file it came from, for messages.
    columns : mapping of str to tuple of str
        Column name to a value for each row; ``""`` where unknown.
    rows : tuple of tuple of str
        The names that lead to each row, see :func:`data_tools.names.match_names`.
    """

    source: str
    columns: Mapping[str, tuple[str, ...]]
    rows: tuple[tuple[str, ...], ...]

    def check_fit(self, names: Sequence[str]) -> None:
        """Refuse a table of which no row belongs to any of the named shapes.

        Raises
        ------
        InputError
            Naming what it has; also if two rows of one shape have different labels.
        """
        if not self._found(names)[0]:
            first = [row[0] for row in self.rows]
            advice = nearest_names(first[0], names) if first else ""
            raise InputError(
                f"{self.source}: none of its rows belongs to a shape. It names {listed(first) or 'none'}, the shapes "
                f"are {listed(names)}{advice}. Names are in the first column, or in one that is called "
                f"{', '.join(NAME_COLUMNS)}"
            )

    def column(self, by: str, names: Sequence[str]) -> tuple[str, ...]:
        """Return values of one column for the named shapes, ``""`` where the table has no row for a shape.

        Raises
        ------
        InputError
            If there is no such column, or not a single one of the shapes has a value in it.
        """
        by = known_names(self.source, [by], self.columns, kind="column")[by]
        self.check_fit(names)
        values = self._values(by, names)
        if not any(values):
            raise InputError(
                f"{self.source}: column {by!r} has no value for any of the {len(names)} shapes"
            )
        return values

    def columns_for(self, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Return all columns that say something about the named shapes."""
        found = {by: self._values(by, names) for by in self.columns}
        return {by: values for by, values in found.items() if any(values)}

    def mismatches(self, names: Sequence[str]) -> list[Note]:
        """Return notes on names that only nearly agree, on rows of no shape, and on shapes without a row."""
        found, near = self._found(names)
        used = {*found.values()}
        strange = [row[0] for at, row in enumerate(self.rows) if at not in used]
        bare = sorted({*names} - {*found})
        notes = []
        if near:
            values: dict[str, Value] = {"source": self.source, "rows": tuple(near)}
            notes.append(Note("labels-taken-as", tuple(near.values()), values))
        if strange:
            hints = tuple(nearest_names(row, names).removeprefix("; ") for row in strange)
            values = {"source": self.source, "rows": tuple(strange), "hints": hints}
            notes.append(Note("labels-unknown", values=values))
        if bare:
            notes.append(Note("labels-missing", tuple(bare), {"source": self.source}))
        return notes

    def _values(self, by: str, names: Sequence[str]) -> tuple[str, ...]:
        rows, values = self._found(names)[0], self.columns[by]
        return tuple(values[rows[name]] if name in rows else "" for name in names)

    def _found(self, names: Sequence[str]) -> tuple[dict[str, int], dict[str, str]]:
        """Return the row of each shape that has one, and the shapes of names that only nearly agree."""
        every = match_names((name for row in self.rows for name in row), names)
        uncertain, found, near = nearly(every), dict[str, int](), dict[str, str]()
        for at, row in enumerate(self.rows):
            for shape in {every[name] for name in row if name in every and name not in uncertain}:
                self._check_alike(shape, found.setdefault(shape, at), at)
        for which in range(2):  # the name, then the file
            used = {*found.values()}
            rest = {
                row[which]: at
                for at, row in enumerate(self.rows)
                if at not in used and which < len(row)
            }
            taken = match_names(rest, [name for name in names if name not in found])
            found |= {shape: rest[name] for name, shape in taken.items()}
            near |= taken
        return found, near

    def _check_alike(self, shape: str, one: int, other: int) -> None:
        if any(values[one] != values[other] for values in self.columns.values()):
            raise InputError(
                f"{self.source}: {shape!r} is listed twice, as {self.rows[one][0]!r} and {self.rows[other][0]!r}, "
                "with different labels; keep one row per shape"
            )


def read_labels(path: Path | str) -> Labels:
    """Read a CSV file with one row per shape and a heading.

    Columns are separated by commas, semicolons or tabs; numbers may have decimal commas where these separate nothing.
    Names are compared by :func:`data_tools.names.match_names`; where there is also a column ``file``, both lead to
    the row. Values such as ``NA`` count as unknown.

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
    named: dict[tuple[str, ...], list[str]] = {}
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(heading):
            raise InputError(
                f"{source}, line {number}: {len(row)} cells under {len(heading)} headings"
            )
        names = tuple(dict.fromkeys(row[at].strip() for at in (at_name, *at_file)))
        labels = [known_label(cell) for cell in row]
        if named.setdefault(names, labels) != labels:
            raise InputError(
                f"{source}, line {number}: {names[0]!r} is listed twice with different labels; keep one row per shape"
            )
    of_excel = dialect.delimiter == ";"
    columns = {
        column: _with_decimal_points([row[at] for row in named.values()], are_decimals=of_excel)
        for at, column in enumerate(heading)
        if column and at not in (at_name, *at_file)
    }
    return Labels(source=str(source), columns=columns, rows=tuple(named))


def _with_decimal_points(values: Sequence[str], *, are_decimals: bool) -> tuple[str, ...]:
    """Return the values of a column with points for decimal commas, where all are numbers and none are thousands."""
    known = [value for value in values if value]
    with_comma = [value for value in known if "," in value]
    may_be_thousands = not are_decimals and all(map(THOUSANDS.fullmatch, with_comma))
    if not with_comma or may_be_thousands or not all(map(_WITH_COMMA.fullmatch, known)):
        return tuple(values)
    return tuple(value.replace(",", ".") for value in values)


def _dialect(text: str) -> type[csv.Dialect]:
    try:
        return csv.Sniffer().sniff(text[:4096], delimiters=",;\t")
    except csv.Error:
        return csv.excel


def known_label(cell: str) -> str:
    """Label without surrounding blanks, ``""`` if it says that nothing is known."""
    value = cell.strip()
    return "" if value.lower() in UNKNOWN else value
