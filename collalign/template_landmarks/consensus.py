"""Whether templates agree: how far each is trusted at each landmark, and whether its order is another one.

All points are on the mean surface, in the common frame, where landmarks of all templates can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.notes import Note

#: Fewest templates of which one can be outvoted.
MIN_VOTES = 3
#: A template farther from the median than so many times the usual distance does not count at a landmark. Chosen on
#: skulls, molars and long bones of 14 specimens each.
_CUTOFF = 6.0
#: Weiszfeld's iterations, and below which part of the largest distance points coincide.
_NUM_STEPS, _LEAST_PART = 60, 1e-6
#: Another order explains distances if they are at most this share of what they are in the present order, and these
#: are at least so many times the usual distance. Checked on 14 mouse skulls.
_EXPLAINED, _FAR_OFF = 0.5, 3.0
#: Fewest landmarks that make a shift, and a reversed order; the share of landmarks that must fit either.
_FEWEST_SHIFTED, _FEWEST_REVERSED, _MOST_LANDMARKS = 3, 4, 0.8
#: Errors of templates, each predicted from the others, are named beyond so many times the median one, if they are at
#: least this part of the radius: a hand errs as much.
_NAMED, _LEAST_NAMED = 10.0, 0.05
#: What is wrong with the order of a template.
Kind: TypeAlias = Literal["swapped", "reversed", "shifted", "exchanged", "renamed"]


def geometric_median(points: FloatArray) -> FloatArray:
    """Return the place of least summed distance from the points of each landmark, shape (l, 3).

    Parameters
    ----------
    points : ndarray, shape (t, l, 3)
        NaN where missing; so is the median where all are.

    References
    ----------
    Weiszfeld, Sur le point pour lequel la somme des distances de n points donnés est minimum (1937).
    """
    median = np.full(points.shape[1:], np.nan)
    known = np.asarray(np.isfinite(points).all(axis=2))
    some = known.any(axis=0)
    if not some.any():
        return median
    weights, filled = known[:, some], np.where(known[..., None], points, 0.0)[:, some]
    places = np.nanmedian(points[:, some], axis=0)
    least = _LEAST_PART * float(np.nanmax(np.linalg.norm(points[:, some] - places, axis=2)))
    for _ in range(_NUM_STEPS):
        pulls = weights / np.maximum(np.linalg.norm(filled - places, axis=2), least or 1.0)
        places = (pulls[..., None] * filled).sum(axis=0) / pulls.sum(axis=0)[:, None]
    median[some] = places
    return median


def template_trust(points: FloatArray) -> FloatArray:
    """Return how far each template is trusted at each landmark, between 0 and 1, shape (t, l); 0 where it has none.

    It is Tukey's biweight of the distance from the geometric median of all templates. The usual distance is the
    median of the templates at the landmark, at least the median of all landmarks. Where fewer than three templates
    have a landmark, none of them is outvoted.

    Parameters
    ----------
    points : ndarray, shape (t, l, 3)
        NaN where missing.
    """
    known = np.isfinite(points).all(axis=2)
    trust = known.astype(float)
    voted = known.sum(axis=0) >= MIN_VOTES
    if voted.any():
        chosen = points[:, voted]
        distances = np.linalg.norm(chosen - geometric_median(chosen), axis=2)
        usual = np.maximum(np.nanmedian(distances, axis=0), np.nanmedian(distances))
        least = _LEAST_PART * float(np.nanmax(chosen) - np.nanmin(chosen)) or 1.0
        ratios = distances / (_CUTOFF * np.maximum(usual, least))
        trust[:, voted] = np.nan_to_num(np.clip(1.0 - ratios**2, 0.0, 1.0) ** 2)
    return trust


@dataclass(frozen=True, kw_only=True)
class OrderMistake:
    """Landmarks that a template has where another one has other landmarks.

    Attributes
    ----------
    kind : {"swapped", "reversed", "shifted", "exchanged", "renamed"}
        ``renamed`` is a landmark that either has under a name that the other lacks.
    template, other : int
        Two templates; the mistake is the first one's if ``decided``, and otherwise in either.
    rows, places : tuple of int
        Landmarks of the template, and those that the other one has there.
    decided : bool
        Whether most templates agree with the other one.
    """

    kind: Kind
    template: int
    other: int
    rows: tuple[int, ...]
    places: tuple[int, ...]
    decided: bool


def order_mistakes(points: FloatArray) -> tuple[tuple[OrderMistake, ...], BoolArray]:
    """Find templates whose landmarks are in another order than those of most others.

    The landmarks of every two templates are assigned to each other by their places. A template is wrong at a landmark
    if its order differs from that of more than half of the templates that have it. Two templates outvote each other.

    Parameters
    ----------
    points : ndarray, shape (t, l, 3)
        NaN where missing.

    Returns
    -------
    mistakes : tuple of OrderMistake
    wrong : ndarray of bool, shape (t, l)
        Landmarks at which a template contradicts most others. A landmark under another name contradicts none.

    References
    ----------
    Crouse, On implementing 2D rectangular assignment algorithms (2016), as in SciPy.
    """
    num, num_rows = points.shape[:2]
    known, every = np.asarray(np.isfinite(points).all(axis=2)), np.arange(num_rows)
    moved = np.array([[reordered(own, other) for other in points] for own in points])
    moved = moved.reshape(num, num, num_rows)
    differs = moved != every
    others = known[None] | differs
    others[np.arange(num), np.arange(num)] = False
    outvoted = known & (2 * differs.sum(axis=1) > others.sum(axis=1))
    mistakes = list[OrderMistake]()
    for at in range(num):
        rows = np.flatnonzero(outvoted[at])
        while len(rows):
            other, decided = _opponent(at, rows, differs, outvoted, moved)
            here = rows[differs[at, other, rows]]
            if decided or not any((one.template, one.other) == (other, at) for one in mistakes):
                both = known[at] & known[other]
                mistakes += _named(at, other, here, moved[at, other], both, decided=decided)
            rows = np.setdiff1d(rows, here)
    return tuple(mistakes), outvoted & (known.sum(axis=0) > 1)


def _opponent(
    at: int, rows: IntArray, differs: BoolArray, outvoted: BoolArray, moved: IntArray
) -> tuple[int, bool]:
    """Return a template that contradicts another at the first of some rows, and whether it is right there."""
    against = np.flatnonzero(differs[at, :, rows[0]])
    for other in against.tolist():
        here = rows[differs[at, other, rows]]
        if not outvoted[other, here].any() and not outvoted[other, moved[at, other, here]].any():
            return other, True
    return int(against[0]), False


def reordered(own: FloatArray, other: FloatArray) -> IntArray:
    """Return which landmark of another template is where each one of a template is, shape (l,).

    It is the landmark itself unless another order of several landmarks explains their distances much better.

    Parameters
    ----------
    own, other : ndarray, shape (l, 3)
        NaN where missing.
    """
    moved = np.arange(len(own))
    here, there = (np.flatnonzero(np.isfinite(one).all(axis=1)) for one in (own, other))
    if not len(here) or not len(there):
        return moved
    gaps = np.full((len(own), len(own)), np.nan)
    gaps[np.ix_(here, there)] = scipy.spatial.distance.cdist(own[here], other[there])
    rows, columns = scipy.optimize.linear_sum_assignment(gaps[np.ix_(here, there)] ** 2)
    to = dict(zip(here[rows].tolist(), there[columns].tolist(), strict=True))
    usual = float(np.median([gaps[row, place] for row, place in to.items()]))
    for chain in _chains(to):
        after = float(np.mean([gaps[row, to[row]] for row in chain]))
        apart = gaps[chain, chain]
        if np.isfinite(apart).any():
            before = float(np.nanmean(apart))
            wrong = after <= _EXPLAINED * before and before >= _FAR_OFF * usual
        else:
            wrong = after <= _FAR_OFF * usual
        if wrong:
            moved[chain] = [to[row] for row in chain]
    return moved


def _chains(to: dict[int, int]) -> list[list[int]]:
    """Return the cycles and paths of a one-to-one map, but for what stays."""
    chains, seen = list[list[int]](), set[int]()
    for start in [*sorted(to.keys() - {*to.values()}), *sorted(to)]:
        chain, row = list[int](), start
        while row in to and row not in seen and to[row] != row:
            seen.add(row)
            chain.append(row)
            row = to[row]
        chains += [chain] if chain else []
    return chains


def _named(
    at: int, other: int, rows: IntArray, moved: IntArray, both: BoolArray, *, decided: bool
) -> list[OrderMistake]:
    """Name what became of the landmarks of a template that are in another order."""

    def mistake(kind: Kind, chosen: Sequence[int]) -> OrderMistake:
        return OrderMistake(
            kind=kind,
            template=at,
            other=other,
            rows=tuple(chosen),
            places=tuple(moved[[*chosen]].tolist()),
            decided=decided,
        )

    every, shared = rows.tolist(), np.flatnonzero(both)
    backwards = dict(zip(shared.tolist(), shared[::-1].tolist(), strict=True))
    fits = np.mean([backwards.get(row) == moved[row] for row in every])
    if len(every) >= max(_FEWEST_REVERSED, len(shared) / 2) and fits >= _MOST_LANDMARKS:
        return [mistake("reversed", every)]
    steps = np.unique((moved[rows] - rows) % len(moved), return_counts=True)[1]
    if len(every) >= _FEWEST_SHIFTED and steps.max() >= _MOST_LANDMARKS * len(every):
        return [mistake("shifted", every)]
    found = []
    for chain in _chains({row: int(moved[row]) for row in every}):
        closed = moved[chain[-1]] == chain[0]
        if len(chain) == 1:
            found.append(mistake("exchanged" if both[chain[0]] else "renamed", chain))
        else:
            found.append(mistake("swapped" if closed and len(chain) == 2 else "exchanged", chain))
    return found


def agreement_notes(
    mistakes: Sequence[OrderMistake],
    names: Sequence[str],
    labels: Sequence[str],
    errors: FloatArray,
    sizes: FloatArray,
    trust: FloatArray,
) -> tuple[Note, ...]:
    """Return notes of what templates disagree on.

    Parameters
    ----------
    mistakes : sequence of OrderMistake
        These landmarks are named as such, and not once more by their errors.
    names, labels : sequence of str, lengths t and l
    errors : ndarray, shape (t, l)
        Of each template, predicted from the others; NaN where unknown.
    sizes : ndarray, shape (t,)
        Root mean square radius of each, in the unit of its errors.
    trust : ndarray, shape (t, l)
    """
    notes, explained = list[Note](), np.zeros(errors.shape, dtype=bool)
    for one in mistakes:
        explained[[one.template, one.other], :] |= np.isin(
            np.arange(len(labels)), [*one.rows, *one.places]
        )
        shapes = (names[one.template], *(() if one.decided else (names[one.other],)))
        values = {
            "kind": one.kind,
            "labels": tuple(labels[row] for row in one.rows),
            "places": tuple(labels[place] for place in one.places),
        }
        notes.append(Note("templates-reordered", shapes, values))
    if not np.isfinite(errors).any():
        return tuple(notes)
    parts = errors / sizes[:, None]
    far = (parts > max(_NAMED * np.nanmedian(parts), _LEAST_NAMED)) & ~explained
    several = len(names) >= MIN_VOTES
    for at, name in enumerate(names if several else names[:1]):
        rows = np.flatnonzero(far[at] & (trust[at] == 0 if several else True))
        if len(rows):
            values = {
                "labels": tuple(labels[row] for row in rows.tolist()),
                "distances": tuple(errors[at, rows].tolist()),
            }
            shapes = (name,) if several else tuple(names)
            notes.append(Note("templates-disagree", shapes, values))
    return tuple(notes)
