"""How well the surface around a landmark holds it, and whether a rigid fit of it agrees with the smooth map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from data_tools.poses import each_moved_by, fitting_similarity
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import vertex_normals


class LocalFit(NamedTuple):
    """Numbers of the fit; lengths are in parts of the mean's root mean square radius.

    Chosen on planes and birds with one template, by the rank correlation of slip and error; the last three by that of
    radius and error, each of seven classes left out.
    """

    around: tuple[float, ...] = (0.12, 0.2, 0.32)
    """Surroundings reach so far; the mean of a fit of each counts. Chosen on skulls and molars: landmarks of bones,
    teddies and planes are nearer as well than with .2 alone, and templates agree better."""
    num_around: int = 40
    """So many points of each are fitted."""
    fewest: int = 12
    """Where fewer are there, the nearest ones are taken."""
    num_steps: int = 4
    """Of the fit. Birds gain from 6, planes lose."""
    reach: float = 1.5
    """Unit of lengths in a fit, in sizes of the surroundings."""
    outlier: float = 0.1
    """Gaps of this size count half, in that unit."""
    share: float = 0.5
    """How far a landmark goes from where the map takes it to where the fit does. Chosen on skulls, bones and molars;
    teddies, planes and birds were held out."""
    damping: float = 2e-3
    """How much of each movement stays that no plane holds: a flat place slides."""
    reaches: tuple[float, ...] = (0.15, 0.4, 0.9)
    """Of the neighbourhoods that hold a landmark: the features of a surface that is smooth there may be far."""
    turn: float = 0.03
    """What a turn costs that hides a slide of a neighbourhood."""
    least_hold: float = 3e-4
    """Of a place on which nothing is seen of a slide."""


#: The numbers in use.
FIT = LocalFit()


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """What is around each landmark of a template, in the common frame.

    Attributes
    ----------
    landmarks : ndarray, shape (l, 3)
        Anything where there is none.
    points : ndarray, shape (n, l, k, 3)
        Of the template's surface, in neighbourhoods of several sizes.
    rows : ndarray of int, shape (n, l, k)
        Vertices of the mean.
    """

    landmarks: FloatArray
    points: FloatArray
    rows: IntArray

    @classmethod
    def of(
        cls,
        landmarks: FloatArray,
        places: FloatArray,
        surface: FloatArray,
        mean: FloatArray,
        unit: float,
    ) -> Surroundings:
        """Find the surroundings of a template's landmarks.

        Parameters
        ----------
        landmarks : ndarray, shape (l, 3)
            NaN where missing.
        places : ndarray, shape (l, 3)
            Of the landmarks on the mean.
        surface, mean : ndarray, shapes (w, 3) and (v, 3)
            Vertices of the template and of the mean.
        unit : float
            Root mean square radius of the mean.
        """
        known = np.nan_to_num(landmarks)
        return cls(
            landmarks=known,
            points=surface[_near(surface, known, unit)],
            rows=_near(mean, places, unit),
        )


def _near(points: FloatArray, places: FloatArray, unit: float) -> IntArray:
    """Return even choices of the points around each place, in the order of the file, shape (n, l, k)."""
    tree = scipy.spatial.cKDTree(points)
    nearest = tree.query(places, k=min(FIT.fewest, len(points)))[1]
    chosen = []
    for around in FIT.around:
        for few, many in zip(nearest, tree.query_ball_point(places, around * unit), strict=True):
            rows = np.union1d(few, many).astype(np.int64)
            chosen.append(rows[np.linspace(0, len(rows) - 1, FIT.num_around).astype(np.int64)])
    return np.array(chosen).reshape(len(FIT.around), len(places), FIT.num_around)


def fit_surroundings(
    around: Surroundings,
    template: FloatArray,
    specimen: FloatArray,
    surface: SurfaceLocator,
    normals: FloatArray,
    unit: float,
) -> tuple[FloatArray, FloatArray]:
    """Fit the surroundings of each landmark to a specimen, rigidly, from where the dense correspondence takes them.

    Parameters
    ----------
    around : Surroundings
    template, specimen : ndarray, shape (v, 3)
        Copies of the mean on both.
    surface : SurfaceLocator
        Of the specimen.
    normals : ndarray, shape (w, 3)
        At the vertices of that surface, not normalized; zero where there are none, and then nothing moves.
    unit : float
        Root mean square radius of the mean.

    Returns
    -------
    places : ndarray, shape (l, 3)
        Where the fits take the landmarks; the mean over the sizes of surroundings.
    misfits : ndarray, shape (l,)
        Root mean square distance of the surroundings from the specimen after the fits; the mean over the sizes.

    References
    ----------
    Chen and Medioni, Object modelling by registration of multiple range images (1992): points to tangent planes.
    """
    fits = []
    for size, points, rows in zip(FIT.around, around.points, around.rows, strict=True):
        even = np.ones(rows.shape[1])
        starts = fitting_similarity(specimen[rows], template[rows], even)
        moved = np.concatenate([around.landmarks[:, None], points], axis=1)
        moved = each_moved_by(starts, moved)
        fits.append(_fitted(moved, surface, normals, FIT.reach * size * unit))
    places, misfits = zip(*fits, strict=True)
    return np.mean(places, axis=0), np.mean(misfits, axis=0)


def _fitted(
    moved: FloatArray, surface: SurfaceLocator, normals: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return where a landmark goes, (l, 3), with the k points that follow it in (l, 1 + k, 3), and their misfit."""
    for _ in range(FIT.num_steps):
        nearest, planes = _tangent_planes(surface, normals, moved[:, 1:])
        centres = moved[:, 1:].mean(axis=1, keepdims=True)
        gaps = ((nearest - moved[:, 1:]) * planes).sum(axis=2) / reach
        arms = np.cross((moved[:, 1:] - centres) / reach, planes)
        rows = np.concatenate([arms, planes], axis=2)
        weighted = np.swapaxes(rows / (1.0 + (gaps / FIT.outlier) ** 2)[:, :, None], 1, 2)
        moments = weighted @ rows + FIT.damping * rows.shape[1] * np.eye(6)
        steps = np.linalg.solve(moments, weighted @ gaps[:, :, None])[:, :, 0]
        rotations = scipy.spatial.transform.Rotation.from_rotvec(steps[:, :3]).as_matrix()
        turned = (moved - centres) @ np.swapaxes(rotations, 1, 2)
        moved = turned + centres + reach * steps[:, None, 3:]
    nearest, _ = _tangent_planes(surface, normals, moved[:, 1:])
    misfits = np.sqrt(((nearest - moved[:, 1:]) ** 2).sum(axis=2).mean(axis=1))
    return moved[:, 0], misfits


def _tangent_planes(
    surface: SurfaceLocator, normals: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the nearest point of a surface for each of (l, k, 3) points, and its unit normal."""
    places = surface.closest(points.reshape(-1, 3))
    planes = (normals[places.corners] * places.weights[:, :, None]).sum(axis=1)
    planes /= np.maximum(np.linalg.norm(planes, axis=1, keepdims=True), np.finfo(float).tiny)
    return places.on(surface.vertices).reshape(points.shape), planes.reshape(points.shape)


def holds(
    places: FloatArray, vertices: FloatArray, faces: IntArray, unit: float
) -> tuple[FloatArray, FloatArray]:
    """Return how well a surface determines the place of each landmark on it, at least and in every direction.

    A neighbourhood that slides along itself leaves the surface by a mean squared distance, even where a turn hides
    some of it. In squares of the slide it is the hold: about 1 along the normal, 0 on planes and along a smooth
    shaft. The geometric mean over neighbourhoods of three sizes counts.

    Parameters
    ----------
    places : ndarray, shape (l, 3)
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    unit : float
        Root mean square radius of the surface.

    Returns
    -------
    least : ndarray, shape (l,)
        Hold in the direction where it is least.
    held : ndarray, shape (l, 3, 3)
        Square root of the hold: an error times it is large where it would be seen.

    References
    ----------
    Gelfand and Guibas, Shape segmentation using local slippage analysis (SGP 2004).
    """
    normals = vertex_normals(vertices, faces)
    tree = scipy.spatial.cKDTree(vertices)
    nearest = tree.query(places, k=min(FIT.fewest, len(vertices)))[1]
    logs, held = np.zeros(len(places)), np.zeros((len(places), 3, 3))
    for reach in FIT.reaches:
        balls = tree.query_ball_point(places, reach * unit)
        for at, (few, many) in enumerate(zip(nearest, balls, strict=True)):
            near = np.union1d(few, many).astype(np.int64)
            arms = np.cross((vertices[near] - places[at]) / (reach * unit), normals[near])
            rows = np.concatenate([arms, normals[near]], axis=1)
            moments = rows.T @ rows / len(near)
            turns = np.linalg.solve(moments[:3, :3] + FIT.turn * np.eye(3), moments[:3, 3:])
            values, axes = np.linalg.eigh(moments[3:, 3:] - moments[3:, :3] @ turns)
            values = np.log(np.maximum(values, FIT.least_hold)) / len(FIT.reaches)
            logs[at] += values[0]
            held[at] += (axes * values) @ axes.T
    values, axes = np.linalg.eigh(held)
    return np.exp(logs), (axes * np.exp(0.5 * values)[:, None]) @ np.swapaxes(axes, 1, 2)
