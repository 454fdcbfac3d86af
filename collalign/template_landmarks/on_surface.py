"""Whether landmarks lie on their template, in which coordinate system, and what would help where they do not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias, TypeVar

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only, rms_length
from data_tools.errors import InputError
from data_tools.io.shapes import LPS_RAS, CoordinateSystem, declared_system, read_shape
from data_tools.io.source import Origin
from data_tools.landmark_files import Landmarks, Semilandmarks
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.poses import moved_by, scales_of
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.outliers import UNIT_FACTORS
from data_tools.surface.shape import Shape

#: Median distances from the surface, in its root mean square radii: landmarks of experts are nearer than the first,
#: single ones than the second. Chosen on 14 mouse skulls and 45 shapes of SHREC07.
ON_SURFACE, OFF_SURFACE = 0.02, 0.1
#: A remedy is named where it brings landmarks so many times nearer. Below :data:`OFF_SURFACE` it counts only for so
#: many landmarks.
_NEARER, _MIN_LANDMARKS = 4.0, 4
#: Landmarks that spread over less, in the same unit, are near any surface through that place.
_ONE_PLACE = 0.2
#: A place between samples of a cloud may be as far as most of them are from their third neighbours.
_NTH_NEAREST, _MOST_VERTICES = 4, 0.95
_Points = TypeVar("_Points", Landmarks, Semilandmarks)
#: Names, vertices and faces of all specimens.
Meshes: TypeAlias = Sequence[tuple[str, FloatArray, IntArray]]


class _Surface:
    """A surface on which landmarks are expected, and the unit of distances from it."""

    def __init__(self, shape: Shape) -> None:
        self.radius = _spread(shape.vertices)
        self._locator = SurfaceLocator(shape.vertices, shape.faces)
        self._slack = 0.0
        if not shape.is_mesh:  # a landmark may lie between the samples of a cloud
            around = scipy.spatial.cKDTree(shape.vertices).query(shape.vertices, k=[_NTH_NEAREST])[
                0
            ]
            self._slack = float(np.quantile(around, _MOST_VERTICES))

    def distances(self, points: FloatArray) -> FloatArray:
        """Return distances of points (q, 3) in root mean square radii, shape (q,)."""
        found = np.linalg.norm(
            self._locator.closest(points).on(self._locator.vertices) - points, axis=1
        )
        return np.asarray(np.maximum(found - self._slack, 0.0) / self.radius)

    def median(self, points: FloatArray) -> float:
        """Return the median distance of points in root mean square radii."""
        return float(np.median(self.distances(points)))


def place_templates(
    given: Mapping[str, Landmarks],
    files: Mapping[str, Origin],
    meshes: Meshes,
    cleaning: CleaningOptions = CleaningOptions(),  # noqa: B008
    *,
    transforms: Mapping[str, FloatArray] | None = None,
) -> tuple[dict[str, Landmarks], tuple[Note, ...], CoordinateSystem]:
    """Bring landmarks into the coordinate systems of their templates and check that they lie on these.

    Landmarks that are declared LPS or RAS are converted to what the template's file declares; where that declares
    nothing, to the system in which they lie on the surface, LPS (as 3D Slicer takes it) where that may be both.

    Parameters
    ----------
    given : mapping of str to Landmarks
        By template.
    files : mapping of str to Path or Source
        Of the templates.
    meshes : sequence of (name, vertices, faces)
        All specimens, perhaps coarsely: whose landmarks might they be?
    cleaning : CleaningOptions
        How the files are read; all components are kept.
    transforms : mapping of str to ndarray, shape (4, 4), optional
        File coordinates of each template to the common frame: are the landmarks in that?

    Returns
    -------
    landmarks : dict of str to Landmarks
        By template, in the coordinates of its file.
    notes : tuple of Note
        How coordinate systems were brought together, which landmarks are off their surface, and which ones were taken
        as missing: those farther than one root mean square radius from it, and those off it whose coordinates are one
        number, which is a code (-999, 9999, -1, 0).
    system : {"LPS", "RAS"}
        What the landmarks say of the coordinates of shapes whose files declare none.

    Raises
    ------
    InputError
        If landmarks do not lie on their template, with the remedy where one is found.
    """
    placed, notes, systems = {}, list[Note](), set()
    cleaning = replace(cleaning, components="all", inner="keep")
    for name, marks in given.items():
        surface = _Surface(read_shape(files[name], cleaning, name=name))
        declared = declared_system(files[name])
        system = declared or _system_on(marks, surface)
        placed[name], codes = _without(name, _in_system(marks, system), surface, _is_code)
        systems |= {system} if system and not declared else set()
        notes += _conversions(name, marks, system)
        if marks.left_out:
            notes.append(Note("no-landmarks", (name,), {"kinds": marks.left_out}))
        notes += [Note("landmark-codes", (name,), {"labels": codes})] if codes else []
        if len(points := _known(one.points for one in _sets(placed[name]))):
            notes += _check(name, points, surface, meshes, (transforms or {}).get(name))
            placed[name], stray = _without(name, placed[name], surface, _is_beyond)
            notes += [Note("landmarks-too-far", (name,), {"labels": stray})] if stray else []
            notes += _off_surface(name, placed[name], surface)
        elif codes:
            raise InputError(
                f"{name}: no landmark is on the surface. Each is one number three times, which is a code for missing "
                "landmarks. Give a specimen with landmarks"
            )
    return placed, tuple(notes), "RAS" if systems == {"RAS"} else "LPS"


def _conversions(name: str, marks: Landmarks, system: CoordinateSystem | None) -> list[Note]:
    """Say how landmarks and surface came together, where anything but LPS is declared."""
    declared = sorted({one.system for one in _sets(marks) if one.system})
    if not declared or {*declared, system} == {"LPS"}:
        return []
    code = "landmarks-in-system" if declared == [system] else "landmarks-converted"
    return [Note(code, (name,), {"declared": tuple(declared), "system": str(system)})]


def _system_on(marks: Landmarks, surface: _Surface) -> CoordinateSystem | None:
    """Return the system in which landmarks that declare one lie on a surface that declares none."""
    declared = _known(one.points for one in _sets(_in_system(marks, "LPS")) if one.system)
    declared = declared[~_one_number(declared)]
    if not len(declared):
        return None
    off = surface.median(declared)
    return "RAS" if off > ON_SURFACE and surface.median(declared * LPS_RAS) < off / 2 else "LPS"


def _without(
    name: str,
    marks: Landmarks,
    surface: _Surface,
    wrong: Callable[[FloatArray, _Surface], BoolArray],
) -> tuple[Landmarks, tuple[str, ...]]:
    """Return landmarks and semilandmarks without those that are wrong, and the names of these.

    Raises
    ------
    InputError
        If too few points of a curve are left.
    """
    names, kept = list[str](), list[Semilandmarks]()
    lost = _found_wrong(marks.points, surface, wrong)
    names += [marks.labels[at] for at in np.flatnonzero(lost)]
    for one in marks.semilandmarks:
        gone = _found_wrong(one.points, surface, wrong)
        names += [f"{one.name}-{at + 1}" for at in np.flatnonzero(gone)]
        points = (
            np.where(gone[:, None], np.nan, one.points)
            if one.kind == "patch"
            else one.points[~gone]
        )
        if len(points) < (3 if one.kind == "closed curve" else 2):
            raise InputError(
                f"{name}: the curve {one.name!r} has {len(points)} points near the surface, too few"
            )
        kept.append(replace(one, points=read_only(points)))
    points = read_only(np.where(lost[:, None], np.nan, marks.points))
    return replace(marks, points=points, semilandmarks=tuple(kept)), tuple(names)


def _found_wrong(
    points: FloatArray, surface: _Surface, wrong: Callable[[FloatArray, _Surface], BoolArray]
) -> BoolArray:
    """Return which of the points that are known are wrong, shape (q,)."""
    known = np.isfinite(points).all(axis=1)
    found = np.zeros(len(points), dtype=bool)
    if known.any():
        found[known] = wrong(points[known], surface)
    return found


def _is_code(points: FloatArray, surface: _Surface) -> BoolArray:
    """Return which points are a code for what is missing: three times one number, away from the surface."""
    return np.asarray(_one_number(points) & (surface.distances(points) > ON_SURFACE))


def _is_beyond(points: FloatArray, surface: _Surface) -> BoolArray:
    """Return which points are more than one radius from the surface: a code for what is missing, or a slip."""
    return np.asarray(surface.distances(points) > 1.0)


def _one_number(points: FloatArray) -> BoolArray:
    """Return which points have three times the same coordinate, but for the signs, which another system changes."""
    return np.asarray((np.abs(points) == np.abs(points[:, :1])).all(axis=1))


def _check(
    name: str, points: FloatArray, surface: _Surface, meshes: Meshes, pose: FloatArray | None
) -> list[Note]:
    """Refuse landmarks that are off the surface, or somewhat off and on it by a remedy; doubt those in one place."""
    off, several = surface.median(points), len(points) >= _MIN_LANDMARKS
    if off <= ON_SURFACE:
        crowded = several and _spread(points) < _ONE_PLACE * surface.radius
        times, near = min(
            _rescaled(points, surface, larger=True), key=lambda one: one[1], default=(1.0, np.inf)
        )
        return (
            [Note("landmarks-close", (name,), {"times": times})]
            if crowded and near <= ON_SURFACE
            else []
        )
    unit = "{:.4g} times as large they lie on it: the files are in different units"
    found = [(unit.format(times), near) for times, near in _rescaled(points, surface)]
    found += [(_OTHER_SYSTEM, surface.median(points * LPS_RAS))]
    if pose is not None:
        inverse = np.asarray(np.linalg.inv(pose), dtype=np.float64)
        for size in (1.0, float(scales_of(pose))):
            found.append((_COMMON_FRAME, surface.median(moved_by(inverse, size * points))))
    for other, vertices, faces in meshes:
        near = _Surface(Shape.from_arrays(vertices, faces)).median(points)
        found.append((f"they lie on {other}: is the file that of another specimen?", near))
    remedy, near = min(found, key=lambda one: one[1])
    helps = near <= min(off / _NEARER, OFF_SURFACE)
    if off > OFF_SURFACE or (helps and several):
        raise InputError(
            f"{name}: its landmarks are not on its surface. The median distance is {off * surface.radius:.4g}, and "
            f"the root mean square radius of the surface is {surface.radius:.4g}. "
            + (
                f"Possible reason: {remedy}"
                if helps
                else "Check the specimen, its unit and its coordinate system"
            )
        )
    return []


_COMMON_FRAME = (
    "they lie on it in the common frame of the result: write the file again with --space raw"
)
_OTHER_SYSTEM = "with x and y negated they lie on it: one of the files is in RAS, the other in LPS"


def _rescaled(
    points: FloatArray, surface: _Surface, *, larger: bool = False
) -> list[tuple[float, float]]:
    """Return other units, and how near landmarks are in them; none that brings them all into one place."""
    factors = [*UNIT_FACTORS, *(() if larger else (1 / unit for unit in UNIT_FACTORS))]
    spread = _spread(points)
    return [
        (factor, surface.median(points * factor))
        for factor in factors
        if factor * spread >= _ONE_PLACE * surface.radius
    ]


def _off_surface(name: str, placed: Landmarks, surface: _Surface) -> list[Note]:
    known = np.flatnonzero(np.isfinite(placed.points).all(axis=1))
    if not len(known):
        return []
    away = surface.distances(placed.points[known])
    far = np.flatnonzero(away > OFF_SURFACE)
    if not len(far):
        return []
    labels, distances = (
        tuple(placed.labels[at] for at in known[far]),
        tuple((away[far] * surface.radius).tolist()),
    )
    return [Note("landmarks-off-surface", (name,), {"labels": labels, "distances": distances})]


def _sets(marks: Landmarks) -> tuple[Landmarks | Semilandmarks, ...]:
    return (marks, *marks.semilandmarks)


def _in_system(marks: Landmarks, system: CoordinateSystem | None) -> Landmarks:
    semilandmarks = tuple(_converted(one, system) for one in marks.semilandmarks)
    return replace(_converted(marks, system), semilandmarks=semilandmarks)


def _converted(one: _Points, system: CoordinateSystem | None) -> _Points:
    if one.system in (None, system):
        return one
    return replace(one, points=read_only(one.points * LPS_RAS), system=system)


def _known(sets: Iterable[FloatArray]) -> FloatArray:
    points = np.concatenate([np.empty((0, 3)), *sets])
    return points[np.isfinite(points).all(axis=1)]


def _spread(points: FloatArray) -> float:
    return rms_length(points - points.mean(axis=0))
