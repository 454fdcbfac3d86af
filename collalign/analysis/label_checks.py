"""What is wrong with labels: cells that are no numbers, typing errors, contradictions to what was found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from data_tools.arrays import BoolArray, FloatArray
from data_tools.embedding.copies import Copies
from data_tools.names import name_key
from data_tools.notes import Note, Value
from data_tools.surface.outliers import odd_for_covariate

Columns = Mapping[str, Sequence[str]]

#: A column of at least so many known cells is numbers where at most this share of them, or one, is none.
FEWEST_CELLS, FEW_WRONG = 4, 0.2
#: A group is taken for another one, misspelt, if that has at least so many times as many members.
TIMES_RARER = 2
#: Shorter words are not compared: F and M, cat and rat differ by one letter as well.
SHORTEST_WORD = 4
#: What labels call the sides.
LEFT = frozenset({"l", "left", "sin", "sinister", "sinistral"})
RIGHT = frozenset({"r", "right", "dex", "dexter", "dextral"})
#: A column names sides if at least this share of its known cells does.
MOST_ARE_SIDES = 0.8


def as_numbers(values: Sequence[str]) -> FloatArray:
    """Return labels as numbers, shape (N,), NaN where they are none."""
    return np.array([_number(value) for value in values])


def wrong_cells(
    values: Sequence[str], shapes: Sequence[str], *, declared: bool = False
) -> dict[str, str] | None:
    """Return the cells of a column of numbers that are none, by shape; None of a column of groups.

    Parameters
    ----------
    values : sequence of str, length N
        ``""`` where unknown.
    shapes : sequence of str, length N
    declared : bool
        The column is numbers, however many cells are none. Else it is where all known cells are, but a few.
    """
    known = {shape: value for shape, value in zip(shapes, values, strict=True) if value}
    wrong = {shape: cell for shape, cell in known.items() if math.isnan(_number(cell))}
    few = max(1, FEW_WRONG * len(known)) if len(known) >= FEWEST_CELLS else 0
    return wrong if declared or (known and len(wrong) <= few) else None


def typing_errors(columns: Columns, shapes: Sequence[str]) -> list[Note]:
    """Return notes on groups that are probably other ones, misspelt.

    They differ from a group in case, blanks or hyphens alone; or they are rarer and one letter is missing, added,
    another or swapped with the next. Columns that name nearly every shape alone are not looked at.

    Parameters
    ----------
    columns : mapping of str to sequence of str, length N
        Of groups.
    shapes : sequence of str, length N
    """
    notes = []
    for column, values in columns.items():
        counts = Counter(value for value in values if value)
        found = _misspelt(counts) if 2 * len(counts) <= counts.total() else {}
        of = [(shape, value) for shape, value in zip(shapes, values, strict=True) if value in found]
        if of:
            fields: dict[str, Value] = {
                "column": column,
                "groups": tuple(value for _, value in of),
                "similar": tuple(found[value] for _, value in of),
            }
            notes.append(Note("labels-misspelt", tuple(shape for shape, _ in of), fields))
    return notes


def side_contradictions(
    columns: Columns, shapes: Sequence[str], reflected: BoolArray, compared: BoolArray
) -> list[Note]:
    """Return notes on labels of sides that contradict the sides that were found.

    Parameters
    ----------
    columns : mapping of str to sequence of str, length N
    shapes : sequence of str, length N
    reflected : ndarray of bool, shape (N,)
        Which shapes were reflected to match the rest: those of one side.
    compared : ndarray of bool, shape (N,)
        Shapes of one part. Between parts sides are not comparable.
    """
    notes = []
    for column, values in columns.items():
        words = np.array([value.strip(" .").casefold() for value in values])
        is_left, known = np.isin(words, [*LEFT]), np.isin(words, [*LEFT, *RIGHT]) & compared
        if not known.any() or known.sum() < MOST_ARE_SIDES * ((words != "") & compared).sum():
            continue
        agree = known & (is_left == reflected)
        if 2 * agree.sum() < known.sum():
            agree = known & ~agree
        if agree.sum() == known.sum():
            continue
        both_labelled = 0 < (is_left & known).sum() < known.sum()
        if both_labelled and not reflected[known].any():
            num_left, total = int((is_left & known).sum()), int(known.sum())
            unseen: dict[str, Value] = {"column": column, "num_left": num_left, "total": total}
            notes.append(Note("labels-of-sides-unseen", values=unseen))
            continue
        at = np.flatnonzero(known & ~agree).tolist()
        fields: dict[str, Value] = {
            "column": column,
            "labels": tuple(values[i] for i in at),
            "num_agree": int(agree.sum()),
            "total": int(known.sum()),
        }
        notes.append(Note("labels-of-sides", tuple(shapes[i] for i in at), fields))
    return notes


def copy_contradictions(
    columns: Columns, shapes: Sequence[str], copies: Iterable[Copies]
) -> list[Note]:
    """Return notes on copies of one surface with different labels; mirror images may differ in side."""
    notes = []
    for one in copies:
        for column, values in columns.items():
            if len({*values}) == len(values):
                continue  # a number of the catalogue
            of = dict(zip(shapes, values, strict=True))
            labels = {name: of[name] for name in one.names if of.get(name)}
            sides = {label.strip(" .").casefold() for label in labels.values()}
            if len({*labels.values()}) > 1 and not (
                one.kind == "mirrored" and sides <= LEFT | RIGHT
            ):
                fields: dict[str, Value] = {"column": column, "labels": tuple(labels.values())}
                notes.append(Note("labels-of-copies", tuple(labels), fields))
    return notes


def stranger_labels(
    columns: Columns, shapes: Sequence[str], strangers: Iterable[str]
) -> list[Note]:
    """Return notes on shapes that resemble no other one, though they share labels with some."""
    notes = []
    for name in strangers:
        of = {
            column: dict(zip(shapes, values, strict=True)).get(name, "")
            for column, values in columns.items()
        }
        shared = [
            f"{column} {value}"
            for column, value in of.items()
            if value and [*columns[column]].count(value) > 1
        ]
        if shared:
            notes.append(Note("labels-of-strangers", (name,), {"labels": tuple(shared)}))
    return notes


def size_contradictions(
    columns: Mapping[str, FloatArray], shapes: Sequence[str], sizes: FloatArray
) -> list[Note]:
    """Return notes on shapes whose size contradicts a covariate that size follows, such as age or mass.

    Parameters
    ----------
    columns : mapping of str to ndarray, shape (N,)
        NaN where unknown.
    shapes : sequence of str, length N
    sizes : ndarray, shape (N,)
    """
    notes = []
    for column, numbers in columns.items():
        odd = odd_for_covariate(sizes, numbers)
        if odd:
            fields: dict[str, Value] = {"column": column, "times": tuple(odd.values())}
            notes.append(Note("labels-of-size", tuple(shapes[at] for at in odd), fields))
    return notes


def _number(value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) and "_" not in value else math.nan


def _misspelt(counts: Counter[str]) -> dict[str, str]:
    """Return the commoner group that each misspelt one probably is."""
    found = {}
    common_first = sorted(counts, key=lambda value: (-counts[value], value))
    for at, rare in enumerate(common_first):
        for common in common_first[:at]:
            is_rarer, key = counts[common] >= TIMES_RARER * counts[rare], name_key(rare)
            is_same = key and key == name_key(common)
            if is_same or (is_rarer and _one_letter_apart(rare, common)):
                found[rare] = common
                break
    return found


def _one_letter_apart(one: str, other: str) -> bool:
    """Return whether one letter, no digit, is missing, another, or swapped with the next."""
    short, long = sorted((one.casefold(), other.casefold()), key=len)
    if len(long) - len(short) > 1 or len(long) < SHORTEST_WORD:
        return False
    at = next((i for i, (a, b) in enumerate(zip(short, long, strict=False)) if a != b), len(short))
    if len(short) < len(long):
        return long[at].isalpha() and short[at:] == long[at + 1 :]
    swapped = short[at : at + 2] == long[at : at + 2][::-1] and short[at + 2 :] == long[at + 2 :]
    replaced = short[at + 1 :] == long[at + 1 :]
    return (swapped or replaced) and (short[at] + long[at]).isalpha()
