"""What labels contradict of a result, and what they explain of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from collalign.analysis.label_checks import (
    as_numbers,
    copy_contradictions,
    side_contradictions,
    size_contradictions,
    stranger_labels,
    typing_errors,
    wrong_cells,
)
from collalign.analysis.left_out import compare_left_out
from collalign.output.collection_data import CollectionData
from collalign.output.members import Members, main_part
from data_tools.arrays import FloatArray
from data_tools.notes import Note, Value
from data_tools.surface.outliers import APART, odd_for_covariate

CollectionT = TypeVar("CollectionT", bound=CollectionData)
#: How the codes of notes on labels begin.
_BEGIN = "labels-"
#: Others of a group that tell its size.
_FEWEST_OF_GROUP = 2


def with_label_notes(
    collection: CollectionT,
    columns: Mapping[str, Sequence[str]],
    *,
    numbers: Collection[str] | None = None,
) -> CollectionT:
    """Return a result whose notes say what labels contradict, and not what they explain.

    Parameters
    ----------
    collection : CollectionData
    columns : mapping of str to sequence of str, length N
        Labels of its shapes, ``""`` where unknown.
    numbers : collection of str, optional
        Columns of numbers; by default those of which all cells are, but a few, which are named.
    """
    names, notes = collection.names, list[Note]()
    covariates, factors = _by_kind(columns, names, numbers)
    if numbers is None:
        for column in covariates:
            if cells := wrong_cells(columns[column], names):
                fields: dict[str, Value] = {"column": column, "cells": tuple(cells.values())}
                notes.append(Note("labels-not-numbers", tuple(cells), fields))
    compared = np.isin(np.arange(len(collection)), main_part(collection))
    strangers = [
        one for note in collection.notes if note.code == "resembles-none" for one in note.shapes
    ]
    notes += [
        *typing_errors(factors, names),
        *side_contradictions(factors, names, collection.reflected, compared),
        *size_contradictions(covariates, names, collection.centroid_sizes),
        *copy_contradictions(columns, names, collection.copies),
        *stranger_labels(factors, names, strangers),
    ]
    kept = (_without_explained(one, collection, factors, covariates) for one in collection.notes)
    said = [note for note in kept if note is not None]
    return replace(collection, notes=tuple(dict.fromkeys([*said, *notes])))


def compare_members(
    collection: CollectionData,
    who: Members,
    columns: Mapping[str, Sequence[str]],
    *,
    numbers: Collection[str] | None = None,
) -> tuple[list[list[object]], list[Note]]:
    """Compare the shapes that count in statistics with the others, along size and labels.

    Parameters
    ----------
    collection : CollectionData
    who : Members
    columns : mapping of str to sequence of str, length N
    numbers : collection of str, optional
        As in :func:`with_label_notes`.

    Returns
    -------
    rows : list of list
        See :func:`collalign.analysis.left_out.compare_left_out`.
    notes : list of Note
        On differences, and on what letting doubtful shapes count would change.
    """
    covariates, factors = _by_kind(columns, collection.names, numbers)
    counted = np.isin(np.arange(len(collection)), who.chosen)
    rows, notes = compare_left_out(counted, collection.centroid_sizes, covariates, factors)
    doubtful = tuple(name for name, reason in who.left_out if reason == "doubtful")
    if notes and doubtful:
        confidences = collection.confidence[[collection.index(name) for name in doubtful]]
        chances: dict[str, Value] = {
            "counted": len(who.chosen),
            "num": len(who.chosen) + len(doubtful),
            "chance": float(np.nan_to_num(confidences).mean()),
        }
        notes.append(Note("left-out-doubtful", doubtful, chances))
    return rows, notes


def _by_kind(
    columns: Mapping[str, Sequence[str]], shapes: Sequence[str], numbers: Collection[str] | None
) -> tuple[dict[str, FloatArray], dict[str, Sequence[str]]]:
    """Return the columns of numbers, and those of groups."""
    if numbers is None:
        numbers = [
            one for one, values in columns.items() if wrong_cells(values, shapes) is not None
        ]
    covariates = {column: as_numbers(columns[column]) for column in columns if column in numbers}
    factors = {column: values for column, values in columns.items() if column not in covariates}
    return covariates, factors


def without_label_notes(collection: CollectionT) -> CollectionT:
    """Return a result without the notes on the labels that it was saved with."""
    kept = (note for note in collection.notes if not note.code.startswith(_BEGIN))
    return replace(collection, notes=tuple(kept))


def _without_explained(
    note: Note,
    collection: CollectionData,
    factors: Mapping[str, Sequence[str]],
    covariates: Mapping[str, FloatArray],
) -> Note | None:
    """Return a note on sizes without the shapes whose size labels explain; None where none is left."""
    times = note.values.get("times")
    if note.code != "size-apart" or not isinstance(times, tuple):
        return note
    apart = {
        collection.index(name): one
        for name, one in zip(note.shapes, np.array(times, dtype=np.float64).tolist(), strict=True)
        if name in collection
    }
    explained = {
        *(
            at
            for numbers in covariates.values()
            for at in _by_covariate(collection, numbers, apart)
        ),
        *(at for values in factors.values() for at in _by_group(collection, values, apart)),
    }
    kept = {collection.names[at]: one for at, one in apart.items() if at not in explained}
    return Note(note.code, tuple(kept), {"times": tuple(kept.values())}) if kept else None


def _by_covariate(
    collection: CollectionData, numbers: FloatArray, apart: Mapping[int, float]
) -> list[int]:
    """Return the shapes whose size is like that of others with nearly the same number.

    Where sizes do not follow the numbers otherwise, those that are smaller than all others in both, or larger.
    """
    known = [at for at in apart if np.isfinite(numbers[at])]
    odd = odd_for_covariate(collection.centroid_sizes, numbers)
    if odd is not None:
        return [at for at in known if at not in odd]
    others = np.delete(numbers, [*apart])
    others = others[np.isfinite(others)]
    low, high = others.min(initial=np.inf), others.max(initial=-np.inf)
    return [at for at in known if (numbers[at] > high if apart[at] > 1 else numbers[at] < low)]


def _by_group(
    collection: CollectionData, values: Sequence[str], apart: Mapping[int, float]
) -> list[int]:
    """Return the shapes whose size is like that of others of their group."""
    sizes, groups, found = collection.centroid_sizes, np.array(values), []
    for at in apart:
        others = sizes[(groups == groups[at]) & (np.arange(len(sizes)) != at)]
        if values[at] and len(others) >= _FEWEST_OF_GROUP:
            ratio = sizes[at] / np.median(others)
            found += [at] if 1 / APART.least < ratio < APART.least else []
    return found
