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
from collalign.output.collection_data import CollectionData
from collalign.output.members import main_part
from data_tools.notes import Note
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
    wrong = {column: wrong_cells(values, names) for column, values in columns.items()}
    if numbers is None:
        numbers = [column for column, cells in wrong.items() if cells is not None]
        for column in numbers:
            if cells := wrong[column]:
                fields = {"column": column, "cells": tuple(cells.values())}
                notes.append(Note("labels-not-numbers", tuple(cells), fields))
    covariates = {column: as_numbers(columns[column]) for column in numbers}
    factors = {column: values for column, values in columns.items() if column not in covariates}
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
    explained = _explained(collection, factors, covariates)
    said = [one for note in collection.notes if (one := _without(note, explained)) is not None]
    return replace(collection, notes=tuple(dict.fromkeys([*said, *notes])))


def without_label_notes(collection: CollectionT) -> CollectionT:
    """Return a result without the notes on the labels that it was saved with."""
    kept = (note for note in collection.notes if not note.code.startswith(_BEGIN))
    return replace(collection, notes=tuple(kept))


def _explained(
    collection: CollectionData,
    factors: Mapping[str, Sequence[str]],
    covariates: Mapping[str, np.ndarray],
) -> set[str]:
    """Return the shapes whose size is that of others with their labels."""
    sizes, names, found = collection.centroid_sizes, collection.names, set[str]()
    for numbers in covariates.values():
        odd = odd_for_covariate(sizes, numbers)
        if odd is not None:
            found |= {names[at] for at in np.flatnonzero(np.isfinite(numbers)) if at not in odd}
    for values in factors.values():
        groups = np.array(values)
        for at in np.flatnonzero(groups != ""):
            others = sizes[(groups == groups[at]) & (np.arange(len(names)) != at)]
            times = sizes[at] / np.median(others) if len(others) >= _FEWEST_OF_GROUP else 0.0
            if 1 / APART.least < times < APART.least:
                found.add(names[at])
    return found


def _without(note: Note, explained: set[str]) -> Note | None:
    """Return a note on sizes without the shapes whose size is explained; None where none is left."""
    times = note.values.get("times")
    if note.code != "size-apart" or not isinstance(times, tuple):
        return note
    kept = [pair for pair in zip(note.shapes, times, strict=True) if pair[0] not in explained]
    if not kept:
        return None
    return Note(
        note.code, tuple(name for name, _ in kept), {"times": tuple(one for _, one in kept)}
    )
