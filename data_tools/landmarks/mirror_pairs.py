"""Which landmarks are mirror images of each other, and the vertex lists of shape benchmarks."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from data_tools.arrays import IntArray
from data_tools.errors import InputError
from data_tools.io.files import existing_file


def read_vertex_indices(path: Path | str, *, num_vertices: int) -> IntArray:
    """Read the first column of a table as vertex indices, shape (l,) (``.pid`` files).

    Raises
    ------
    InputError
        If an index is missing or out of range.
    """
    words = [line.split() for line in _lines(path) if line.strip()]
    if not words or not all(row[0].isdecimal() and int(row[0]) < num_vertices for row in words):
        raise InputError(f"{path}: expected a vertex index below {num_vertices} first in each line")
    return np.array([int(row[0]) for row in words], dtype=np.int64)


def read_symmetry(path: Path | str, *, num_landmarks: int) -> IntArray:
    """Read the mirror pairs of landmarks (``.sym.info``) as a permutation, shape (l,).

    Each line holds the two indices of a pair, or one index of a landmark on the mirror plane; others map to
    themselves.

    Raises
    ------
    InputError
        If a line holds anything else, or a landmark is in two pairs.
    """
    partner = np.arange(num_landmarks)
    seen: set[int] = set()
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        if not words:
            continue
        if len(words) > 2 or not all(w.isdecimal() and int(w) < num_landmarks for w in words):
            raise InputError(f"{path}: line {number}: expected one or two landmarks below {num_landmarks}")
        pair = [int(w) for w in words]
        if seen & set(pair):
            raise InputError(f"{path}: line {number}: landmark {pair} is in two orbits")
        seen |= set(pair)
        partner[pair] = pair[::-1]
    return partner


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
    return existing_file(Path(path)).read_text(encoding="utf-8-sig", errors="replace").splitlines()
