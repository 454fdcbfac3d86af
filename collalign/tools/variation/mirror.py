"""Mirror pairs of landmarks, and the map of a bilateral surface to its own mirror image."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import scipy

from collalign.registration.register import register
from collalign.registration.surface import RegistrationSurface
from data_tools.arrays import FloatArray, IntArray, rms_length
from data_tools.errors import InputError
from data_tools.io.files import existing_file, read_any_text
from data_tools.poses import Similarity
from data_tools.rotations import spread_directions
from data_tools.surface.closest import SurfacePoints
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread
from pairwise.dense import DensePoints
from pairwise.surface_fit import fit_surfaces


def read_landmark_pairs(path: Path | str, labels: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Read pairs of landmarks, left and right, one pair a row of a CSV file; a header is allowed.

    Raises
    ------
    InputError
        If a row does not hold two labels.
    """
    rows = [
        [word.strip() for word in row]
        for row in csv.reader(_lines(path))
        if any(map(str.strip, row))
    ]
    if rows and not set(rows[0]) & set(labels):
        rows = rows[1:]
    for row in rows:
        if len(row) != 2 or not all(row):
            raise InputError(f"{path}: expected two landmarks in each row, got {','.join(row)!r}")
        unknown = [word for word in row if word not in labels]
        if unknown:
            raise InputError(f"{path}: there is no landmark {unknown[0]!r}")
    if not rows:
        raise InputError(f"{path}: holds no pairs of landmarks")
    return tuple((row[0], row[1]) for row in rows)


def landmark_partners(labels: Sequence[str], pairs: Iterable[tuple[str, str]]) -> IntArray:
    """Return the partner of every landmark, shape (l,); one that is in no pair is on the midline, and its own.

    Raises
    ------
    InputError
        If a pair names an unknown landmark or one that has a partner already.
    """
    partner = np.arange(len(labels))
    for pair in pairs:
        for label in pair:
            if label not in labels:
                raise InputError(f"pairs: there is no landmark {label!r}")
        left, right = (list(labels).index(label) for label in pair)
        if left == right or partner[left] != left or partner[right] != right:
            raise InputError(
                f"pairs: {pair[0]!r} and {pair[1]!r}: a landmark is in two pairs or its own partner"
            )
        partner[[left, right]] = right, left
    return partner


def _lines(path: Path | str) -> list[str]:
    return read_any_text(existing_file(Path(path))).splitlines()


#: Directions that are tried as the mirror plane's normal, points that are compared, and how many planes are refined.
_NUM_TRIED_PLANES, _NUM_MIRRORED_POINTS, _NUM_REFINED_PLANES = 200, 500, 6
#: A surface whose mirror image lies farther from it than this, root mean square in parts of the radius, is not
#: bilateral. Bilateral classes have at most .053, molars at least .116.
MOST_UNLIKE = 0.08


@one_blas_thread()
def mirror_map(shape: Shape, *, normal: FloatArray | None = None) -> SurfacePoints:
    """Find the other side of a surface by registering its mirror image to it.

    Parameters
    ----------
    shape : Shape
    normal : ndarray, shape (3,), optional
        Of the mirror plane, roughly; by default the plane is looked for whose mirror image fits best.

    Returns
    -------
    SurfacePoints
        Where on the surface the counterpart of each vertex lies.

    Raises
    ------
    InputError
        If the mirror image is too unlike the surface.
    """
    surface = RegistrationSurface.from_shape(shape)
    centre = surface.vertices[surface.spread].mean(axis=0)
    points = _dense_points(surface, centre)
    starts = _best_normals(points) if normal is None else np.asarray(normal)[None]
    found = [
        fit_surfaces(points, points, _reflection(start), estimate_scale=False) for start in starts
    ]
    best = min(found, key=lambda one: one.energy)
    rotation = best.pose.rotation
    pose = Similarity(
        rotation=rotation, scale=1.0, shift=best.pose.shift + centre - rotation @ centre
    )
    image = shape.transformed(pose.transform)
    source = RegistrationSurface.from_shape(image)
    gaps = surface.locator.closest(image.vertices).on(shape.vertices) - image.vertices
    unlikeness = rms_length(gaps) / surface.radius
    if unlikeness > MOST_UNLIKE:
        raise InputError(
            f"{shape.name}: is not bilateral: its mirror image fits to {unlikeness:.2f} of the radius at best, "
            f"{MOST_UNLIKE} at most is meant"
        )
    return surface.locator.closest(register(surface, source)[0].vertices)


def _dense_points(surface: RegistrationSurface, centre: FloatArray) -> DensePoints:
    chosen = surface.spread[:_NUM_MIRRORED_POINTS]
    normals = surface.normals(surface.vertices)[chosen] if surface.oriented else None
    return DensePoints.from_user(surface.vertices[chosen] - centre, normals)


def _best_normals(points: DensePoints) -> FloatArray:
    """Return directions, of those spread over a hemisphere, along which the mirror image lies nearest."""
    tree = scipy.spatial.cKDTree(points.points)
    half = spread_directions(2 * _NUM_TRIED_PLANES)[:_NUM_TRIED_PLANES]
    gaps = [(tree.query(points.points @ _reflection(normal).T)[0] ** 2).mean() for normal in half]
    return half[np.argsort(gaps, kind="stable")[:_NUM_REFINED_PLANES]]


def _reflection(normal: FloatArray) -> FloatArray:
    return np.asarray(np.eye(3) - 2.0 * np.outer(normal, normal) / (normal @ normal))
