"""What collections say of their truth: poses by landmarks, their vertices, and which are mirror images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_points
from data_tools.checks import check_choice
from data_tools.errors import InputError
from data_tools.io.files import existing_file
from data_tools.rotations import nearest_orthogonal


def landmark_rotation(target: ArrayLike, source: ArrayLike, *, group: str = "SO") -> FloatArray:
    """Return the R_target_source that brings corresponding landmarks together best, shape (3, 3).

    Orthogonal Procrustes of the centred landmarks (Kabsch 1976); scale does not matter.

    Parameters
    ----------
    target, source : array_like, shape (l, 3)
        Row i of one corresponds to row i of the other; rows with NaN (missing landmarks) are left out.
    group : {"SO", "O"}

    Raises
    ------
    InputError
        If the shapes differ, or fewer than three landmarks are common.
    """
    check_choice("group", group, ("SO", "O"))
    q, p = np.asarray(target, dtype=np.float64), np.asarray(source, dtype=np.float64)
    if q.shape != p.shape or q.ndim != 2:
        raise InputError(
            f"landmarks: expected two arrays of one shape (l, 3), got {q.shape} and {p.shape}"
        )
    common = ~(np.isnan(q).any(axis=1) | np.isnan(p).any(axis=1))
    q = as_points(q[common], "common landmarks of the target", min_points=3)
    p = as_points(p[common], "common landmarks of the source", min_points=3)
    moment = (q - q.mean(axis=0)).T @ (p - p.mean(axis=0))
    return nearest_orthogonal(moment, determinant=1.0 if group == "SO" else None)


def read_vertex_indices(path: Path | str, *, num_vertices: int) -> IntArray:
    """Read the first column of a table as vertex indices, shape (l,) (``.pid`` files).

    Raises
    ------
    InputError
        If an index is missing or out of range.
    """
    path = existing_file(Path(path))
    words = [
        line.split()
        for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        if line.strip()
    ]
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
    path = existing_file(Path(path))
    partner = np.arange(num_landmarks)
    seen: set[int] = set()
    for number, line in enumerate(
        path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), start=1
    ):
        words = line.split()
        if not words:
            continue
        if len(words) > 2 or not all(w.isdecimal() and int(w) < num_landmarks for w in words):
            raise InputError(
                f"{path}: line {number}: expected one or two landmarks below {num_landmarks}"
            )
        pair = [int(w) for w in words]
        if seen & set(pair):
            raise InputError(f"{path}: line {number}: landmark {pair} is in two orbits")
        seen |= set(pair)
        partner[pair] = pair[::-1]
    return partner
