"""Tables of measurements: the same rows as CSV and as Markdown."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from data_tools.errors import InputError

#: What a cell of a table holds; None is "not measured" and NaN "impossible".
Value: TypeAlias = str | int | float | None
Row: TypeAlias = Mapping[str, Value]

#: Where two runs may differ in the last digits although they do the same: sums in another order, other libraries.
REL_TOL = 1e-6


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column.

    Attributes
    ----------
    key : str
        Its name in the rows and in the CSV file.
    title : str
        Its name for people, with the unit.
    format : str
        Format specification of its numbers in Markdown.
    clock : bool
        Whether it holds times or memory, which differ from run to run.
    """

    key: str
    title: str
    format: str = ""
    clock: bool = False


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of measurements.

    Attributes
    ----------
    name : str
        Suffix of its file name; empty for an experiment's only or main table.
    caption : str
        What it shows.
    columns : tuple of Column
    rows : tuple of mapping
        By the columns' keys; a missing key is a cell that was not measured.
    """

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    name: str = ""
    caption: str = ""

    def __post_init__(self) -> None:
        keys = {column.key for column in self.columns}
        for row in self.rows:
            if not set(row) <= keys:
                raise ValueError(f"rows: no column for {sorted(set(row) - keys)}")

    def to_csv(self) -> str:
        """Return the rows at full precision, with a line of keys before them."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([column.key for column in self.columns])
        for row in self.rows:
            writer.writerow(["" if row.get(c.key) is None else row[c.key] for c in self.columns])
        return stream.getvalue()

    def to_markdown(self) -> str:
        """Return the table for people, numbers rounded."""
        head = "| " + " | ".join(column.title for column in self.columns) + " |"
        rule = (
            "| "
            + " | ".join("---" if self._is_text(column) else "--:" for column in self.columns)
            + " |"
        )
        body = [
            "| " + " | ".join(_shown(row.get(c.key), c.format) for c in self.columns) + " |"
            for row in self.rows
        ]
        return "\n".join([*([self.caption, ""] if self.caption else []), head, rule, *body]) + "\n"

    def _is_text(self, column: Column) -> bool:
        return any(isinstance(row.get(column.key), str) for row in self.rows)


def _shown(value: Value, form: str) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value.replace("|", "\\|")
    return "–" if math.isnan(value) else format(value, form)


def differences(table: Table, csv_text: str) -> list[str]:
    """Compare rows with those of a CSV file that :meth:`Table.to_csv` wrote, columns of times left out.

    Parameters
    ----------
    table : Table
        All or some of the rows; each must be in the file.
    csv_text : str

    Returns
    -------
    list of str
        A sentence per row that the file does not have; empty if all are there.

    Raises
    ------
    InputError
        If the file has other columns.
    """
    lines = list(csv.DictReader(io.StringIO(csv_text)))
    keys = [column.key for column in table.columns if not column.clock]
    if lines and not set(keys) <= set(lines[0]):
        raise InputError(
            f"table {table.name!r}: the file lacks the columns {sorted(set(keys) - set(lines[0]))}"
        )
    return [
        f"no row like {dict(row)}"
        for row in table.rows
        if not any(
            _same([row.get(key) for key in keys], [line[key] for key in keys]) for line in lines
        )
    ]


def _same(values: Sequence[Value], texts: Sequence[str]) -> bool:
    return all(_same_value(value, text) for value, text in zip(values, texts, strict=True))


def _same_value(value: Any, text: str) -> bool:
    if value is None or isinstance(value, str):
        return (value or "") == text
    try:
        number = float(text)
    except ValueError:
        return False
    if math.isnan(value) or math.isnan(number):
        return math.isnan(value) and math.isnan(number)
    return math.isclose(float(value), number, rel_tol=REL_TOL, abs_tol=REL_TOL)
