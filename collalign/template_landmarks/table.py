"""The landmarks, curves and patches of all templates as one table of labels; curves get even semilandmarks."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.landmark_files import (
    Landmarks,
    SemilandmarkKind,
    SemilandmarkRows,
    Semilandmarks,
)
from data_tools.notes import Note, listed
from data_tools.poses import moved_by

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
    kept = np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 0)
    knots = np.concatenate([points[kept], ends])
    chords = _lengths_along(knots)
    if len(knots) < 2 or chords[-1] == 0:
        return np.repeat(points[:1], num, axis=0)
    spline = scipy.interpolate.CubicSpline(
        chords, knots, bc_type="periodic" if closed else "natural"
    )
    steps = [np.linspace(a, b, _STEPS, endpoint=False) for a, b in itertools.pairwise(chords)]
    fine = np.concatenate([*steps, chords[-1:]])
    lengths = _lengths_along(spline(fine))
    wanted = np.linspace(0.0, lengths[-1], num, endpoint=not closed)
    return np.asarray(spline(np.interp(wanted, lengths, fine)))


def _lengths_along(points: FloatArray) -> FloatArray:
    """Return the length of a polyline (n, 3) up to each of its points, shape (n,)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


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
    ways = np.arange(num), np.arange(num)[::-1]
    orders = [np.roll(way, shift) for way in ways for shift in shifts]
    gaps = [float(((points[order] - other) ** 2).sum()) for order in orders]
    return np.asarray(orders[int(np.argmin(gaps))])


def slider_rows(rows: tuple[int, ...], *, closed: bool) -> IntArray:
    """Return which landmarks each semilandmark slides between, rows (before, slides, after), shape (s, 3).

    The ends of an open curve and the first point of a closed one stay.
    """
    along = np.array([*rows, rows[0]] if closed else rows, dtype=np.int64)
    return np.column_stack([along[:-2], along[1:-1], along[2:]])


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
        how = how or "curves-by-order"
    return replace(marks, labels=labels, semilandmarks=curves), how


def _matched(own: tuple[str, ...], other: tuple[str, ...]) -> tuple[tuple[str, ...], str]:
    """Return labels in the words of others, and how they were matched."""
    counted, counted_there = _counted(own), _counted(other)
    if own != other and counted and len(own) == len(other) and counted == counted_there:
        return other, "by-order"
    if {*own} & {*other}:
        return own, ""
    rest, rest_there = _without_prefix(own), _without_prefix(other)
    if len({*rest}) < len(rest) or not {*rest} & {*rest_there}:
        return own, ""
    of = dict(zip(rest_there, other, strict=True))
    return tuple(
        of.get(word, label) for word, label in zip(rest, own, strict=True)
    ), "without-prefix"


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
    prefixes = (
        [labels[0][: sign.end()] for sign in _SEPARATOR.finditer(labels[0])] if labels else []
    )
    common = [one for one in prefixes if all(label.startswith(one) for label in labels)]
    shared = max(common, key=len, default="")
    return [label.removeprefix(shared) for label in labels]


#: What does not tell two labels apart: separators, but between digits, and zeros in front of a number.
_SPELLING = re.compile(r"(?<!\d)[-_ .:]+|[-_ .:]+(?!\d)|(?<!\d)0+(?=\d)")


def with_one_spelling(
    given: Mapping[str, Landmarks],
) -> tuple[dict[str, Landmarks], tuple[Note, ...]]:
    """Return templates in which labels that differ only in case, separators or leading zeros are spelt alike.

    The spelling of most templates is taken. Labels that a template has in two spellings stay as they are.

    Returns
    -------
    templates : dict of str to Landmarks
    notes : tuple of Note
        Which labels of which template were spelt otherwise.
    """
    spelt: dict[str, Counter[str]] = {}
    kept = set[str]()
    for marks in given.values():
        own = Counter(map(_plain, marks.labels))
        kept |= {plain for plain, count in own.items() if count > 1}
        for label in marks.labels:
            spelt.setdefault(_plain(label), Counter())[label] += 1
    usual = {plain: found.most_common(1)[0][0] for plain, found in spelt.items()}
    templates, notes = {}, list[Note]()
    for name, marks in given.items():
        labels = tuple(
            label if _plain(label) in kept else usual[_plain(label)] for label in marks.labels
        )
        pairs = [pair for pair in zip(marks.labels, labels, strict=True) if pair[0] != pair[1]]
        if pairs:
            before, after = zip(*pairs, strict=True)
            notes.append(Note("landmarks-respelt", (name,), {"labels": before, "taken_as": after}))
        templates[name] = replace(marks, labels=labels)
    return templates, tuple(notes)


def _plain(label: str) -> str:
    return _SPELLING.sub("", label).casefold() or label


def may_be_one(label: str, other: str) -> bool:
    """Return whether two labels are a prefix and a number that a program counts on, such as F-3 and F-10."""
    found, there = _NUMBERED.fullmatch(label), _NUMBERED.fullmatch(other)
    return bool(found and there and found[1] == there[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class LandmarkTable:
    """Landmarks of several templates.

    Attributes
    ----------
    labels : tuple of str, length l
        Of all templates together; semilandmarks are called after their curve or patch, with a number.
    points : mapping of str to ndarray, shape (l, 3)
        By template, in the coordinates of its file; NaN where it has none.
    semilandmarks : tuple of SemilandmarkRows
        Which of them are on curves and patches.
    notes : tuple of Note
        Whose landmarks are called otherwise than the first template's, and how they were matched.
    """

    labels: tuple[str, ...]
    points: Mapping[str, FloatArray]
    semilandmarks: tuple[SemilandmarkRows, ...]
    notes: tuple[Note, ...] = ()

    @property
    def landmark_rows(self) -> list[int]:
        """Rows that are on no curve and no patch."""
        others = {row for one in self.semilandmarks for row in one.rows}
        return [row for row in range(len(self.labels)) if row not in others]

    def renamed(self, names: Mapping[str, Mapping[str, str]]) -> LandmarkTable:
        """Return the table with other labels for some landmarks of some templates, which lack these labels."""
        numbers = {label: at for at, label in enumerate(self.labels)}
        points = {name: np.array(own) for name, own in self.points.items()}
        for name, pairs in names.items():
            for label, taken in pairs.items():
                points[name][numbers[taken]] = points[name][numbers[label]]
                points[name][numbers[label]] = np.nan
        gone = {label for pairs in names.values() for label in pairs}
        lacks = np.asarray(np.isnan(np.stack([*points.values()])).any(axis=2).all(axis=0))
        kept = [at for at, label in enumerate(self.labels) if not (lacks[at] and label in gone)]
        rows = {at: number for number, at in enumerate(kept)}
        return replace(
            self,
            labels=tuple(self.labels[at] for at in kept),
            points={name: own[kept] for name, own in points.items()},
            semilandmarks=tuple(
                one._replace(rows=tuple(rows[at] for at in one.rows)) for one in self.semilandmarks
            ),
        )


def landmark_table(
    given: Mapping[str, Landmarks],
    transforms: Mapping[str, FloatArray],
    *,
    curve_points: int | None = None,
) -> LandmarkTable:
    """Bring the landmarks of all templates into one order.

    Labels that differ only in case, separators or leading zeros are the same one. Landmarks and curves that are
    called as the first template's but for a prefix or a shift of their numbers are the same ones. Curves are spaced
    evenly and counted as the first template's that has them, whichever way they were drawn.

    Parameters
    ----------
    given : mapping of str to Landmarks
    transforms : mapping of str to ndarray, shape (4, 4)
        File coordinates of each template to the common frame.
    curve_points : int, optional
        Semilandmarks on every curve, its ends included; by default so many as the first template's curve has points.

    Raises
    ------
    InputError
        If there is no template, one names a landmark twice or shares none with the first, a curve is open on one and
        closed on another, or patches of one name differ in the number of points.
    """
    if not given:
        raise InputError("landmarks: no landmark file is given")
    given, respelt = with_one_spelling(given)
    builder, notes = _Builder(transforms, curve_points), [*respelt]
    (first, like), *others = given.items()
    builder.add(first, like)
    for name, marks in others:
        renamed, how = called_like(marks, like)
        if how:
            notes.append(Note("landmarks-renamed", (name,), {"template": first, "how": how}))
        builder.add(name, renamed)
    return replace(builder.table(), notes=tuple(notes))


class _Builder:
    """Collects the points of one template after another by label."""

    def __init__(self, transforms: Mapping[str, FloatArray], curve_points: int | None) -> None:
        self._transforms, self._curve_points = transforms, curve_points
        self._columns: dict[str, dict[str, FloatArray]] = {}
        self._sets: dict[str, tuple[SemilandmarkKind, tuple[str, ...]]] = {}

    def add(self, name: str, marks: Landmarks) -> None:
        """Add a template."""
        own: dict[str, FloatArray] = {}
        pairs = list(zip(marks.labels, marks.points, strict=True))
        for one in marks.semilandmarks:
            placed = self._placed(one, name)
            pairs += zip(self._sets[one.name][1], self._counted(one, name, placed), strict=True)
        for label, point in pairs:
            if label in own:
                raise InputError(
                    f"{name}: two landmarks are called {label!r}; give each a name of its own"
                )
            own[label] = point
        first = next(iter(self._columns), None)
        if first is not None and not set(own) & set(self._columns[first]):
            here, there = (listed([*map(repr, one)]) for one in (own, self._columns[first]))
            raise InputError(
                f"{name}: no landmark ({here}) has the name of one of {first} ({there}). Give the same "
                "landmarks the same labels in both files"
            )
        self._columns[name] = own

    def table(self) -> LandmarkTable:
        """Return everything in the order of first appearance."""
        labels = tuple(dict.fromkeys(label for own in self._columns.values() for label in own))
        numbers, missing = {label: at for at, label in enumerate(labels)}, np.full(3, np.nan)
        points = {}
        for name, own in self._columns.items():
            points[name] = np.stack([own.get(label, missing) for label in labels])
        return LandmarkTable(
            labels=labels,
            points=points,
            semilandmarks=tuple(
                SemilandmarkRows(name, kind, tuple(numbers[label] for label in own))
                for name, (kind, own) in self._sets.items()
            ),
        )

    def _placed(self, one: Semilandmarks, template: str) -> FloatArray:
        """Return the points of a curve, evenly spaced, or of a patch, in the number that the first template set."""
        num = len(one.points) if one.kind == "patch" else self._curve_points or len(one.points)
        own = tuple(f"{one.name}-{number}" for number in range(1, num + 1))
        kind, labels = self._sets.setdefault(one.name, (one.kind, own))
        if kind != one.kind:
            raise InputError(
                f"{template}: {one.name!r} is a {one.kind} here and a {kind} on another specimen"
            )
        if one.kind != "patch":
            return evenly_spaced(one.points, len(labels), closed=kind == "closed curve")
        if len(labels) != num:
            raise InputError(
                f"{template}: the patch {one.name!r} has {num} points, on another specimen {len(labels)}"
            )
        return one.points

    def _counted(self, one: Semilandmarks, template: str, placed: FloatArray) -> FloatArray:
        """Return a curve's points in the order of the first template that has the curve."""
        labels = self._sets[one.name][1]
        first = next((name for name, own in self._columns.items() if labels[0] in own), None)
        if first is None or one.kind == "patch":
            return placed
        there = np.stack([self._columns[first][label] for label in labels])
        like = moved_by(self._transforms[first], there)
        here = moved_by(self._transforms[template], placed)
        order = counting_like(here, like, closed=one.kind == "closed curve")
        return placed[order]
