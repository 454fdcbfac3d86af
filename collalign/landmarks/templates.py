"""Landmark files of several templates, and the files of curves and patches beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from data_tools.errors import InputError
from data_tools.landmarks.landmark_files import Landmarks, read_landmarks, read_semilandmarks, specimen_of


def read_templates(paths: Sequence[str | Path]) -> dict[str, Landmarks]:
    """Read landmark files; the shape that each belongs to is the file's name without its suffix.

    Raises
    ------
    InputError
        If a file cannot be read or two belong to one shape.
    """
    read: dict[str, Landmarks] = {}
    for path in map(Path, paths):
        name = specimen_of(path)
        if name in read:
            raise InputError(f"{path}: a second landmark file of the specimen {name!r}")
        read[name] = read_landmarks(path)
    return read


def with_semilandmarks(
    given: Mapping[str, Landmarks], curves: Sequence[str | Path], patches: Sequence[str | Path]
) -> dict[str, Landmarks]:
    """Return landmarks with the curves and patches of files of their own, of specimens without landmarks as well."""
    found = dict(given)
    kinds: list[tuple[Literal["curve", "patch"], Sequence[str | Path]]] = [("curve", curves), ("patch", patches)]
    for kind, paths in kinds:
        for path in paths:
            name = specimen_of(path)
            marks = found.get(name, Landmarks(labels=(), points=np.empty((0, 3))))
            more = (*marks.semilandmarks, read_semilandmarks(path, kind))
            found[name] = replace(marks, semilandmarks=more)
    return found
