"""Whether the landmarks of one specimen lie on the sides that their labels name: left and right are told apart."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from collalign.template_landmarks.consensus import reordered
from data_tools.arrays import FloatArray, IntArray
from data_tools.notes import Note

#: Words for left and for right; single letters only where they stand alone or begin or end a word in capitals.
_SIDES = (("left", "right"), ("sinister", "dexter"), ("sin", "dex"), ("l", "r"))
#: Fewest pairs of landmarks of which one can be outvoted.
_MIN_PAIRS = 3
#: A pair whose direction differs from that of most by less than this cosine does not vote; it may be on the midline.
_LEAST_COSINE = 0.5


def side_pairs(labels: Sequence[str]) -> list[tuple[int, int]]:
    """Return which landmarks are left and right of each other by their labels, rows (left, right).

    ``L_eye`` and ``R_eye``, ``eye left`` and ``eye right``, ``zygoL`` and ``zygoR``, ``L1`` and ``R1`` are pairs.
    """
    numbers = {label: at for at, label in enumerate(labels)}
    pairs = dict[int, int]()
    for left, right in _SIDES:
        alone = rf"(?<![A-Za-z]){left}(?![A-Za-z])"
        at_end = rf"(?<=[a-z0-9]){left[0].upper()}{left[1:]}(?![a-z])"
        at_start = rf"(?<![A-Za-z]){left[0].upper()}{left[1:]}(?=[A-Z0-9])"
        word = re.compile(rf"(?i:{alone})|{at_end}|{at_start}")
        for label, at in numbers.items():
            for found in word.finditer(label):
                other = f"{label[: found.start()]}{_cased(right, found[0])}{label[found.end() :]}"
                if other in numbers:
                    pairs.setdefault(at, numbers[other])
    return sorted(pairs.items())


def _cased(word: str, like: str) -> str:
    return word.upper() if like.isupper() else word.capitalize() if like[0].isupper() else word


def side_notes(name: str, labels: Sequence[str], points: FloatArray) -> list[Note]:
    """Return notes of landmarks that contradict the sides that their labels name.

    From each left landmark to its right one it goes the same way, across the middle. A pair that goes the other way
    is exchanged. Mirrored in the middle, left landmarks lie where the right ones are. If another order of them fits
    much better, some landmarks of one side are exchanged. Neither tells which way left is.

    Parameters
    ----------
    name : str
        Of the specimen.
    labels : sequence of str, length l
    points : ndarray, shape (l, 3)
        NaN where missing.

    References
    ----------
    Klingenberg, Barluenga and Meyer, Shape analysis of symmetric structures (2002): mirroring with relabelling.
    """
    known = np.asarray(np.isfinite(points).all(axis=1))
    pairs = np.array([one for one in side_pairs(labels) if known[[*one]].all()], dtype=np.int64)
    if len(pairs) < _MIN_PAIRS:
        return []
    left, right = points[pairs[:, 0]], points[pairs[:, 1]]
    ways = right - left
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), np.finfo(float).tiny)
    cosines = ways @ ways.T
    across = ways[int(np.abs(cosines).sum(axis=1).argmax())]
    along = ways @ across
    voting = np.abs(along) > _LEAST_COSINE
    across = np.median(ways[voting] * np.sign(along[voting])[:, None], axis=0)
    across /= np.linalg.norm(across) * (np.sign(np.sign(along[voting]).sum()) or 1.0)
    flipped = ways @ across < -_LEAST_COSINE
    notes = []
    if flipped.any():
        notes.append(Note("sides-exchanged", (name,), {"labels": _labels(labels, pairs[flipped])}))
        left, right = np.where(flipped[:, None], (right, left), (left, right))
    middle = np.median((left + right) @ across) / 2
    mirrored = left - 2.0 * (left @ across - middle)[:, None] * across
    moved = reordered(mirrored, right)
    others = np.flatnonzero(moved != np.arange(len(moved)))
    if len(others):
        values = {"labels": _labels(labels, pairs[others])}
        notes.append(Note("sides-reordered", (name,), values))
    return notes


def _labels(labels: Sequence[str], pairs: IntArray) -> tuple[str, ...]:
    return tuple(f"{labels[left]} and {labels[right]}" for left, right in pairs.tolist())
