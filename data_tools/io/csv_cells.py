"""CSV text that a spreadsheet shows and never runs: cells that would be formulas begin with an apostrophe."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable

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
