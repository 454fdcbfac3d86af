"""The same landmarks under other labels: programs call points after their list, and count on after deleted ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from data_tools.landmarks.landmark_files import Landmarks

#: What parts a prefix from the rest of a label.
_SEPARATOR = re.compile(r"[-_ .:]")
_NUMBERED = re.compile(r"(.*?)(\d+)")


def called_like(marks: Landmarks, other: Landmarks) -> tuple[Landmarks, str]:
    """Return landmarks under the labels of another template's, where they differ by a prefix or in numbers alone.

    Parameters
    ----------
    marks, other : Landmarks

    Returns
    -------
    landmarks : Landmarks
        As they are where they share labels, or nothing tells which belong to which.
    how : str
        How they were matched; empty where nothing was renamed.
    """
    labels, how = _matched(marks.labels, other.labels)
    curves, there = marks.semilandmarks, other.semilandmarks
    names = tuple(one.name for one in there)
    alike = [one.kind for one in curves] == [one.kind for one in there]
    if curves and alike and not {*names} & {one.name for one in curves}:
        curves = tuple(replace(one, name=name) for one, name in zip(curves, names, strict=True))
        how = how or "curves were matched by their order"
    return replace(marks, labels=labels, semilandmarks=curves), how


def _matched(own: tuple[str, ...], other: tuple[str, ...]) -> tuple[tuple[str, ...], str]:
    """Return labels in the words of others, and how they were matched."""
    counted, counted_there = _counted(own), _counted(other)
    if own != other and counted and len(own) == len(other) and counted == counted_there:
        return other, "they were matched by their order"
    if {*own} & {*other}:
        return own, ""
    rest, rest_there = _without_prefix(own), _without_prefix(other)
    if len({*rest}) < len(rest) or not {*rest} & {*rest_there}:
        return own, ""
    of = dict(zip(rest_there, other, strict=True))
    return tuple(of.get(word, label) for word, label in zip(rest, own, strict=True)), (
        "they were matched by what follows their prefix"
    )


def _counted(labels: Sequence[str]) -> list[int]:
    """Return by how much each number is above the first one; nothing where labels are not one prefix and a number."""
    found = [_NUMBERED.fullmatch(label) for label in labels]
    if not all(found) or len({one[1] for one in found if one}) != 1:
        return []
    numbers = [int(one[2]) for one in found if one]
    return [one - numbers[0] for one in numbers]


def _without_prefix(labels: Sequence[str]) -> list[str]:
    """Return labels without what comes before the last separator in which all of them agree, and their numbers."""
    numbered = [_NUMBERED.fullmatch(label) for label in labels]
    if numbered and all(numbered) and len({one[1] for one in numbered if one}) == 1:
        return [str(int(one[2])) for one in numbered if one]
    prefixes = [labels[0][: sign.end()] for sign in _SEPARATOR.finditer(labels[0])] if labels else []
    shared = max((one for one in prefixes if all(label.startswith(one) for label in labels)), key=len, default="")
    return [label.removeprefix(shared) for label in labels]
