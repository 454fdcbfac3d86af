"""Landmarks of some specimens: on the mean surface, and by it on all."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collalign.analysis.measurement_error import check_repeats
from collalign.analysis.procrustes import MIN_LABELS
from collalign.analysis.symmetry import means_of_rows
from collalign.output.collection import Collection
from collalign.template_landmarks.on_surface import place_templates
from collalign.template_landmarks.table import landmark_table
from collalign.template_landmarks.templates import read_templates
from collalign.tools.correspond import DenseCorrespondence
from collalign.tools.variation.surface_variation import SurfaceVariation
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.landmark_files import Landmarks
from data_tools.names import by_known_names
from data_tools.notes import Note, listed
from data_tools.poses import moved_by
from data_tools.surface.closest import SurfaceLocator


def posed_landmarks(
    collection: Collection, landmarks: Mapping[str, Landmarks] | Sequence[str | Path]
) -> tuple[tuple[str, ...], dict[str, FloatArray], tuple[Note, ...]]:
    """Read landmarks and pose them like their shapes.

    Parameters
    ----------
    collection : Collection
    landmarks : mapping of name to Landmarks, or sequence of path
        Of some of its shapes.

    Returns
    -------
    names : tuple of str, length l
    posed : dict of str to ndarray, shape (l, 3)
        By shape; NaN where it lacks a landmark.
    notes : tuple of Note
        What there is to say about the files.

    Raises
    ------
    InputError
        If a file is damaged, or belongs to no shape.
    """
    if not landmarks:
        return (), {}, ()
    given = (
        dict(landmarks)
        if isinstance(landmarks, Mapping)
        else read_templates(landmarks, collection.names)
    )
    given = by_known_names("landmarks", given, collection.names)
    transforms = {name: collection.transforms[collection.index(name)] for name in given}
    files = {name: collection.file(collection.index(name)) for name in given}
    surfaces = tuple(
        (name, *mesh) for name, mesh in zip(collection.names, collection.surfaces, strict=True)
    )
    placed, notes, _ = place_templates(
        given, files, surfaces, collection.options.cleaning, transforms=transforms
    )
    table = landmark_table(placed, transforms)
    alone = table.landmark_rows
    posed = {name: moved_by(transforms[name], one[alone]) for name, one in table.points.items()}
    return tuple(table.labels[row] for row in alone), posed, (*notes, *table.notes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Digitised:
    """Landmarks that were placed several times.

    Attributes
    ----------
    landmarks : tuple of str, length l
        Those that every digitisation has.
    shapes : tuple of str, length M
        Of each configuration; those that were placed again are there several times.
    points : ndarray, shape (M, l, 3)
        In the common frame, in the unit of each file.
    """

    landmarks: tuple[str, ...]
    shapes: tuple[str, ...]
    points: FloatArray

    @property
    def errors(self) -> FloatArray:
        """Standard deviation of each landmark about its mean on each shape, root of the sum of axes, shape (l,)."""
        _, rows, counts = np.unique(self.shapes, return_inverse=True, return_counts=True)
        apart = self.points - means_of_rows(self.points, rows, counts)[rows]
        return np.asarray(np.sqrt((apart**2).sum(axis=(0, 2)) / (counts - 1).sum()))


def digitised_again(
    collection: Collection,
    first: tuple[Sequence[str], Mapping[str, FloatArray]],
    repeats: Sequence[Mapping[str, Landmarks]] | Sequence[str | Path],
    counted: Container[str],
) -> tuple[Digitised, tuple[Note, ...]]:
    """Join several digitisations of the landmarks of the same shapes.

    Parameters
    ----------
    collection : Collection
    first : (names, posed)
        The first digitisation, see :func:`posed_landmarks`.
    repeats : sequence of mapping of name to Landmarks, or of path
        The others; the files of each are in a folder of their own.
    counted : container of str
        Shapes that count. Configurations that lack a landmark do not.

    Returns
    -------
    digitised : Digitised
    notes : tuple of Note
        What there is to say about the files.

    Raises
    ------
    InputError
        If there is no first digitisation, too few landmarks are in all, or no shape that counts was placed again.
    """
    if not first[0]:
        raise InputError(
            "repeats: are of landmarks; name the files of the first digitisation (landmarks)"
        )
    folders = dict[Path, list[Path]]()
    sessions: list[Mapping[str, Landmarks] | list[Path]] = []
    for one in repeats:
        if isinstance(one, Mapping):
            sessions.append(one)
        else:
            folders.setdefault(Path(one).resolve().parent, []).append(Path(one))
    every, notes = [first], list[Note]()
    for session in (*sessions, *folders.values()):
        labels, placed_again, said = posed_landmarks(collection, session)
        every.append((labels, placed_again))
        notes += said
    common = [name for name in first[0] if all(name in names for names, _ in every)]
    if len(common) < MIN_LABELS:
        raise InputError(
            f"repeats: {len(common)} landmarks have the same name in all digitisations, {MIN_LABELS} at least are "
            f"needed. The first one has {listed(first[0])}"
        )
    shapes, points = list[str](), list[FloatArray]()
    for names, posed in every:
        rows = [names.index(name) for name in common]
        for shape, placed in posed.items():
            if shape in counted and np.isfinite(placed[rows]).all():
                shapes.append(shape)
                points.append(placed[rows] / collection.scales[collection.index(shape)])
    check_repeats(shapes)
    found = Digitised(landmarks=tuple(common), shapes=tuple(shapes), points=np.array(points))
    return found, tuple(dict.fromkeys(notes))


def landmarks_on_mean(
    dense: DenseCorrespondence, mean: FloatArray, posed: Mapping[str, FloatArray], num: int
) -> FloatArray:
    """Return the mean place of each of ``num`` landmarks on the mean surface, over the shapes that have it.

    Parameters
    ----------
    dense : DenseCorrespondence
    mean : ndarray, shape (v, 3)
        Of its triangulation.
    posed : mapping of str to ndarray, shape (num, 3)
        See :func:`posed_landmarks`.
    num : int

    Returns
    -------
    ndarray, shape (num, 3)
        NaN where no shape that counts has the landmark.
    """
    places = []
    for name, points in posed.items():
        if name in dense.names:
            row = dense.names.index(name)
            copy = dense.completed[row]
            has = np.asarray(np.isfinite(points).all(axis=1))[:, None]
            found = SurfaceLocator(copy, dense.faces).closest(np.where(has, points, copy[0]))
            places.append(np.where(has, found.on(mean), np.nan))
    stacked = np.array(places).reshape(len(places), num, 3)
    there = np.isfinite(stacked)
    total = np.where(there, stacked, 0.0).sum(axis=0)
    return np.asarray(np.where(there.any(axis=0), total / np.maximum(there.sum(axis=0), 1), np.nan))


def landmarks_of_all(
    found: SurfaceVariation,
    vertices: FloatArray,
    posed: Mapping[str, FloatArray],
    on_mean: tuple[Sequence[str], FloatArray],
    rows: Sequence[int],
) -> tuple[FloatArray, tuple[Note, ...]]:
    """Return landmarks of all shapes: their own if all have them, else those that the mean surface carries.

    Parameters
    ----------
    found : SurfaceVariation
    vertices : ndarray, shape (N, v, 3)
        Of its shapes.
    posed : mapping of str to ndarray, shape (l, 3)
        See :func:`posed_landmarks`.
    on_mean : (names, points)
        See :func:`landmarks_on_mean`.
    rows : sequence of int
        The landmarks that are needed.

    Returns
    -------
    points : ndarray, shape (N, l, 3)
        Complete in these rows.
    notes : tuple of Note
        That landmarks are carried.

    Raises
    ------
    InputError
        If no shape that counts has one of them.
    """
    names, points = on_mean
    own = [posed[name] for name in found.names if name in posed]
    if len(own) == len(found.names) and np.isfinite(np.array(own)[:, rows]).all():
        return np.array(own), ()
    if missing := [names[row] for row in rows if not np.isfinite(points[row]).all()]:
        raise InputError(f"blocks: no shape that counts has {listed(missing)}")
    # Rows that are not needed may be missing: any place stands for them.
    known = np.where(np.isfinite(points), points, found.mean[0])
    places = SurfaceLocator(found.mean, found.faces).closest(known)
    return np.array([places.on(shape) for shape in vertices]), (Note("blocks-carried"),)
