"""The landmarks, curves and patches of all templates as one table: the same rows for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collalign.landmarks.curves import counting_like, evenly_spaced
from collalign.landmarks.labels import called_like
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.landmarks.landmark_files import Landmarks, SemilandmarkKind, SemilandmarkRows, Semilandmarks
from data_tools.notes import Note
from data_tools.percent import listed
from data_tools.poses import moved_by


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


def landmark_table(
    given: Mapping[str, Landmarks], transforms: Mapping[str, FloatArray], *, curve_points: int | None = None
) -> LandmarkTable:
    """Bring the landmarks of all templates into one order.

    Landmarks and curves that are called as the first template's but for a prefix or a shift of their numbers are
    the same ones. Curves are spaced evenly and counted as the first template's that has them, whichever way they were
    drawn.

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
    builder, notes = _Builder(transforms, curve_points), list[Note]()
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
                raise InputError(f"{name}: two landmarks are called {label!r}; give each a name of its own")
            own[label] = point
        first = next(iter(self._columns), None)
        if first is not None and not set(own) & set(self._columns[first]):
            here, there = (listed([*map(repr, one)]) for one in (own, self._columns[first]))
            raise InputError(
                f"{name}: none of its landmarks ({here}) is called as any of {first} ({there}); give the same "
                "landmarks the same labels in both files"
            )
        self._columns[name] = own

    def table(self) -> LandmarkTable:
        """Return everything in the order of first appearance."""
        labels = tuple(dict.fromkeys(label for own in self._columns.values() for label in own))
        numbers, missing = {label: at for at, label in enumerate(labels)}, np.full(3, np.nan)
        return LandmarkTable(
            labels=labels,
            points={
                name: np.stack([own.get(label, missing) for label in labels]) for name, own in self._columns.items()
            },
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
            raise InputError(f"{template}: {one.name!r} is a {one.kind} here and a {kind} on another specimen")
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
        like = moved_by(self._transforms[first], np.stack([self._columns[first][label] for label in labels]))
        here = moved_by(self._transforms[template], placed)
        order = counting_like(here, like, closed=one.kind == "closed curve")
        return placed[order]
