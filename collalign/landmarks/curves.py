"""Semilandmarks on curves: evenly spaced along them, and counted from the same end on every specimen."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.interpolate import CubicSpline

from data_tools.arrays import FloatArray, IntArray

#: Points per gap in which the length of a curve is measured.
_STEPS = 32


def evenly_spaced(points: FloatArray, num: int, *, closed: bool) -> FloatArray:
    """Return points at equal distances along the curve through others, shape (num, 3).

    The curve is the cubic spline through the points by chord length. An open curve keeps both its ends, a closed one
    its first point.

    Parameters
    ----------
    points : ndarray, shape (c, 3)
        At least two, three if closed; those that repeat the one before count once.
    num : int
    closed : bool
    """
    ends = points[[0]] if closed else points[:0]
    kept = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 0])
    knots = np.concatenate([points[kept], ends])
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    if len(knots) < 2 or chords[-1] == 0:
        return np.repeat(points[:1], num, axis=0)
    spline = CubicSpline(chords, knots, bc_type="periodic" if closed else "natural")
    fine = np.concatenate(
        [np.linspace(a, b, _STEPS, endpoint=False) for a, b in itertools.pairwise(chords)] + [chords[-1:]]
    )
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(spline(fine), axis=0), axis=1))])
    wanted = np.linspace(0.0, lengths[-1], num, endpoint=not closed)
    return np.asarray(spline(np.interp(wanted, lengths, fine)))


def counting_like(points: FloatArray, other: FloatArray, *, closed: bool) -> IntArray:
    """Return the order, shape (n,), in which a curve's points run as another's: from the same end, the same way.

    Parameters
    ----------
    points, other : ndarray, shape (n, 3)
        Evenly spaced along their curves, and posed alike.
    closed : bool
        Whether any point may come first.
    """
    num = len(points)
    shifts = range(num) if closed else range(1)
    orders = [np.roll(way, shift) for way in (np.arange(num), np.arange(num)[::-1]) for shift in shifts]
    gaps = [float(((points[order] - other) ** 2).sum()) for order in orders]
    return np.asarray(orders[int(np.argmin(gaps))])


def slider_rows(rows: tuple[int, ...], *, closed: bool) -> IntArray:
    """Return which landmarks each semilandmark slides between, rows (before, slides, after), shape (s, 3).

    The ends of an open curve and the first point of a closed one stay.
    """
    along = np.array([*rows, rows[0]] if closed else rows, dtype=np.int64)
    return np.column_stack([along[:-2], along[1:-1], along[2:]])
