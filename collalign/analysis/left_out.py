"""Whether the shapes that do not count in statistics differ from those that do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray
from data_tools.notes import Note

#: What the table is headed by: of numbers the least, median and greatest, of groups the number of shapes.
HEADING = (
    *(
        "column",
        "group",
        "counted",
        "left_out",
        "least_counted",
        "median_counted",
        "greatest_counted",
    ),
    *("least_left_out", "median_left_out", "greatest_left_out", "P"),
)
#: Said where a test has this P or less, or the shapes that count span less than this share of the range of all.
SAID_P, SAID_SHARE = 0.05, 0.8


def compare_left_out(
    counted: BoolArray,
    sizes: FloatArray,
    covariates: Mapping[str, FloatArray],
    factors: Mapping[str, Sequence[str]],
) -> tuple[list[list[object]], list[Note]]:
    """Compare shapes that count with those that are left out, along size, covariates and groups.

    Numbers are compared by the test of Mann and Whitney (1947), the share of each group by the exact test of Fisher
    (1922), times the number of groups.

    Parameters
    ----------
    counted : ndarray of bool, shape (N,)
    sizes : ndarray, shape (N,)
    covariates : mapping of str to ndarray, shape (N,)
        NaN where unknown.
    factors : mapping of str to sequence of str, length N
        ``""`` where unknown.

    Returns
    -------
    rows : list of list
        Under :data:`HEADING`; empty where none or all are left out, or nothing is known of either.
    notes : list of Note
        Where the two differ.
    """
    rows, notes = list[list[object]](), list[Note]()
    for column, numbers in {"centroid size": sizes, **covariates}.items():
        known = np.isfinite(numbers)
        kept, lost = numbers[known & counted], numbers[known & ~counted]
        if not len(kept) or not len(lost):
            continue
        p = float(scipy.stats.mannwhitneyu(kept, lost).pvalue)
        three = [f(one) for one in (kept, lost) for f in (np.min, np.median, np.max)]
        rows.append([column, "", len(kept), len(lost), *map(float, three), p])
        every = numbers[known]
        scale = np.log if every.min() > 0 else np.asarray
        if p <= SAID_P or np.ptp(scale(kept)) < SAID_SHARE * np.ptp(scale(every)):
            notes.append(
                Note(
                    "left-out-differ",
                    values={
                        "column": column,
                        "num": len(kept),
                        "total": len(every),
                        "range": (float(every.min()), float(every.max())),
                        "range_counted": (float(kept.min()), float(kept.max())),
                        "p": p,
                    },
                )
            )
    for column, values in factors.items():
        notes += _of_groups(column, np.array(values, dtype=str), counted, rows)
    return rows, notes


def _of_groups(
    column: str, groups: np.ndarray, counted: BoolArray, rows: list[list[object]]
) -> list[Note]:
    """Add a row for each group, and return the note on those of which more are left out than of the others."""
    known = groups != ""
    kinds = np.unique(groups[known])
    if len(kinds) < 2 or 2 * len(kinds) > known.sum() or not (known & ~counted).any():
        return []

    said: dict[str, tuple[int, int]] = {}
    for kind in kinds.tolist():
        own = groups == kind
        table = [
            [int((part & which).sum()) for which in (counted, ~counted)]
            for part in (own, known & ~own)
        ]
        p = min(1.0, len(kinds) * float(scipy.stats.fisher_exact(table).pvalue))
        kept, lost = table[0]
        rows.append([column, kind, kept, lost, *[""] * 6, p])
        if lost and (
            (p <= SAID_P and lost * sum(table[1]) > table[1][1] * (kept + lost)) or not kept
        ):
            said[kind] = kept, kept + lost
    if not said:
        return []
    numbers = {
        "counted": tuple(k for k, _ in said.values()),
        "totals": tuple(n for _, n in said.values()),
    }
    return [Note("groups-left-out", values={"column": column, "groups": tuple(said), **numbers})]
