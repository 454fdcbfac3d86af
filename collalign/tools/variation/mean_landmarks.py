"""Landmarks of some specimens: on the mean surface, and by it on all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from collalign.landmarks.on_surface import place_templates
from collalign.landmarks.table import landmark_table
from collalign.landmarks.templates import read_templates
from collalign.output.collection import Collection
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
    placed, notes, _ = place_templates(given, files, surfaces)
    table = landmark_table(placed, transforms)
    alone = table.landmark_rows
    posed = {name: moved_by(transforms[name], one[alone]) for name, one in table.points.items()}
    return tuple(table.labels[row] for row in alone), posed, (*notes, *table.notes)


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
    known = np.where(np.isfinite(points), points, found.mean[0])
    places = SurfaceLocator(found.mean, found.faces).closest(known)
    return np.array([places.on(shape) for shape in vertices]), (Note("blocks-carried"),)
