"""Which landmarks are mirror images of each other."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from data_tools.arrays import IntArray
from data_tools.errors import InputError
from data_tools.io.files import existing_file, read_any_text


def read_landmark_pairs(path: Path | str, labels: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Read pairs of landmarks, left and right, one pair a row of a CSV file; a header is allowed.

    Raises
    ------
    InputError
        If a row does not hold two labels.
    """
    rows = [[word.strip() for word in row] for row in csv.reader(_lines(path)) if any(map(str.strip, row))]
    if rows and not set(rows[0]) & set(labels):
        rows = rows[1:]
    for row in rows:
        if len(row) != 2 or not all(row):
            raise InputError(f"{path}: expected two landmarks in each row, got {','.join(row)!r}")
        unknown = [word for word in row if word not in labels]
        if unknown:
            raise InputError(f"{path}: there is no landmark {unknown[0]!r}")
    if not rows:
        raise InputError(f"{path}: holds no pairs of landmarks")
    return tuple((row[0], row[1]) for row in rows)


def landmark_partners(labels: Sequence[str], pairs: Iterable[tuple[str, str]]) -> IntArray:
    """Return the partner of every landmark, shape (l,); one that is in no pair is on the midline, and its own.

    Raises
    ------
    InputError
        If a pair names an unknown landmark or one that has a partner already.
    """
    partner = np.arange(len(labels))
    for pair in pairs:
        for label in pair:
            if label not in labels:
                raise InputError(f"pairs: there is no landmark {label!r}")
        left, right = (list(labels).index(label) for label in pair)
        if left == right or partner[left] != left or partner[right] != right:
            raise InputError(f"pairs: {pair[0]!r} and {pair[1]!r}: a landmark is in two pairs or its own partner")
        partner[[left, right]] = right, left
    return partner


def _lines(path: Path | str) -> list[str]:
    return read_any_text(existing_file(Path(path))).splitlines()
