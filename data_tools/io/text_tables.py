"""Lines of numbers to arrays, without a Python object for each number."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from data_tools.arrays import FloatArray


def parse_table(lines: Sequence[str]) -> FloatArray | None:
    """Return lines that hold equally many numbers each, separated by blanks, as an array (lines, columns).

    None where they do not: the caller then goes through them one by one, to name the line that is wrong.
    """
    num_columns = len(lines[0].split()) if lines else 0
    if num_columns == 0 or any(len(line.split()) != num_columns for line in lines):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how older NumPy says that a word is no number
        try:
            values = np.fromstring("\n".join(lines), sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    return values.reshape(len(lines), num_columns) if values.size == len(lines) * num_columns else None
