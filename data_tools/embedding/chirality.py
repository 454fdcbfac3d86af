"""The chirality of a surface by itself: which way its local features turn about the outward normal.

Each vertex has features that a mirror image shares, and that bending hardly changes: heat kernel signatures, and how
far the surface bulges. The corners of a triangle enclose an area in the space of these features. This bivector
changes its sign in the mirror image. Two halves of a body that mirror each other cancel in any posture, because their
features are the same. Neither poses nor correspondences are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, Holds, IntArray, read_only
from data_tools.embedding.invariants import HKS_TIMES, NUM_SPECTRUM, heat_kernel_signature
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import SamplingOptions
from data_tools.surface.shape import Shape, orientation_defects, vertex_normals
from data_tools.surface.topology import face_areas, face_crosses
from data_tools.threads import one_blas_thread

#: Radii of the neighbourhoods over which a surface bulges, in square roots of the area.
BULGE_RADII = (0.08, 0.16)
#: An open surface has an outer side if its signed volume about the centroid is at least this share of the unsigned
#: one; a thin open sheet has none.
LEAST_FACING = 0.5
#: A surface has no outer side if more than the first share of its edges is run through twice in the same direction.
#: It is too coarse to turn either way if one triangle has more than the second share of its area. Chosen between
#: skulls of thin sheets (.05) and triangles wound at random (.5); scans (.005) and furniture of boxes (.06).
MOST_DEFECTS, LARGEST_TRIANGLE = 0.1, 0.03
#: Random Fourier features of a Gaussian kernel of width 1. With 2000 the scores of teeth change by a tenth.
NUM_RANDOM_WAVES = 400

_NUM_FEATURES = len(HKS_TIMES) + len(BULGE_RADII)
_ROWS, _COLUMNS = np.triu_indices(_NUM_FEATURES, 1)
_NUM_PAIRS = len(_ROWS)

#: Surfaces whose features have less than this share in common are compared as if they had as much: they hardly score.
LEAST_SHARED = 1e-3
#: Share of the area that a place of a surface covers whose part in its chirality is asked for.
PLACE_AREA = 0.15


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceChirality:
    """The triangles of a surface with the features of their corners. Arrays are read-only.

    Attributes
    ----------
    features : ndarray, shape (v, 6)
        Log heat kernel signatures at four times, and bulges at two radii.
    faces : ndarray of int, shape (f, 3)
        Counterclockwise seen from outside. Empty if the surface has no outer side: a point cloud, a thin open sheet,
        or triangles that disagree on a side or are too coarse.
    areas : ndarray, shape (f,)
        Shares of the surface area.
    centres : ndarray, shape (f, 3)
        Of the triangles.
    """

    features: Annotated[FloatArray, Holds(shape="v 6")]
    faces: Annotated[IntArray, Holds(shape="f 3")]
    areas: Annotated[FloatArray, Holds(shape="f")]
    centres: Annotated[FloatArray, Holds(shape="f 3")]


#: Of a surface without an outer side.
NO_CHIRALITY = SurfaceChirality(
    features=np.empty((0, _NUM_FEATURES)),
    faces=np.empty((0, 3), dtype=np.int32),
    areas=np.empty(0),
    centres=np.empty((0, 3)),
)


@one_blas_thread()
def surface_chirality(shape: Shape, surface: WorkingSurface | None = None) -> SurfaceChirality:
    """Compute the features of a surface that show its chirality.

    Parameters
    ----------
    shape : Shape
        Clean, as :func:`data_tools.surface.cleaning.clean` leaves it.
    surface : WorkingSurface, optional
        Of this shape, if there is one already.

    Raises
    ------
    InputError
        If the surface is too poor for eigenfunctions.
    """
    surface = WorkingSurface(shape, SamplingOptions()) if surface is None else surface
    faces = _outward(surface)
    points = surface.shape.vertices / surface.area**0.5
    areas = face_areas(points, faces)
    if not len(faces) or areas.max() > LARGEST_TRIANGLE * areas.sum():
        return NO_CHIRALITY
    spectrum = surface.eigenfunctions(NUM_SPECTRUM)
    bulges = _bulges(points, vertex_normals(points, faces), spectrum.mass)
    return SurfaceChirality(
        features=read_only(np.column_stack([heat_kernel_signature(spectrum), bulges])),
        faces=read_only(np.ascontiguousarray(faces, dtype=np.int32)),
        areas=read_only(areas / areas.sum()),
        centres=read_only(points[faces].mean(axis=1)),
    )


def _outward(surface: WorkingSurface) -> IntArray:
    """Return the triangles, counterclockwise seen from outside, shape (f, 3); none where there is no outer side."""
    shape = surface.shape
    if not shape.is_mesh or orientation_defects(shape) > MOST_DEFECTS:
        return NO_CHIRALITY.faces
    arms = shape.vertices - shape.vertices.mean(axis=0)
    volumes = np.einsum("df,fd->f", face_crosses(arms, shape.faces), arms[shape.faces[:, 0]])
    if surface.rim == "open" and abs(volumes.sum()) < LEAST_FACING * np.abs(volumes).sum():
        return NO_CHIRALITY.faces
    return shape.faces[:, ::-1] if volumes.sum() < 0 else shape.faces


def _bulges(points: FloatArray, normals: FloatArray, mass: FloatArray) -> FloatArray:
    """Return how far outward the mean of each vertex's neighbourhood lies, by its radius, shape (v, radii)."""
    tree, found = scipy.spatial.cKDTree(points), []
    weighted = mass[:, None] * np.column_stack([points, np.ones(len(points))])
    for radius in BULGE_RADII:
        rows, columns = tree.query_pairs(radius, output_type="ndarray").T
        near = scipy.sparse.coo_array(
            (np.ones(len(rows)), (rows, columns)), shape=(len(points), len(points))
        )
        sums = near @ weighted + near.T @ weighted + weighted
        mean = sums[:, :3] / sums[:, 3:]
        found.append(np.einsum("vd,vd->v", mean - points, normals) / radius)
    return np.column_stack(found)


@one_blas_thread()
def chirality_scores(surfaces: Sequence[SurfaceChirality]) -> FloatArray:
    """Return how far every two surfaces turn the same way, shape (N, N).

    The score of two surfaces is ``sum k(x, y) <B_x, B_y>`` over their triangles x and y, relative to ``sum k(x, y)
    |B_x| |B_y|``: B are the bivectors of the features, k is a Gaussian kernel of width 1 in the features, which are
    whitened over all surfaces. Each bivector is scaled to the root of its length times the triangle's area, so that
    few sharp features do not outweigh all others. Random Fourier features (Rahimi and Recht 2007) make the sums
    inner products of one vector per surface. A mirror image has the negative score.

    Parameters
    ----------
    surfaces : sequence of SurfaceChirality

    Returns
    -------
    ndarray, shape (N, N)
        In [-1, 1], symmetric. NaN for surfaces without an outer side, and on the diagonal.
    """
    scores = np.full((len(surfaces), len(surfaces)), np.nan)
    known = _with_outer_side(surfaces)
    if len(known) < 2:
        return scores
    turning, shared = _compared([surfaces[i] for i in known])
    scores[np.ix_(known, known)] = turning @ turning.T / shared
    np.fill_diagonal(scores, np.nan)
    return scores


@one_blas_thread()
def place_shares(surfaces: Sequence[SurfaceChirality], mirrored: BoolArray) -> FloatArray:
    """Return how much of what tells each surface's side lies in one place of it, shape (N,).

    That is the largest share of its mean score with the others, those of the other side mirrored, that the triangles
    of one place contribute; more than 1 where other places contradict it.

    Parameters
    ----------
    surfaces : sequence of SurfaceChirality
    mirrored : ndarray of bool, shape (N,)
        The side of each.

    Returns
    -------
    ndarray, shape (N,)
        NaN for surfaces without an outer side, and where no other has one.
    """
    shares = np.full(len(surfaces), np.nan)
    known = _with_outer_side(surfaces)
    if len(known) < 2:
        return shares
    measured = [surfaces[i] for i in known]
    turning, shared = _compared(measured)
    signs = np.where(mirrored[known], -1.0, 1.0)
    weights = np.outer(signs, signs) / shared
    np.fill_diagonal(weights, 0.0)
    whitening = _whitening(measured)
    for i, surface, others in zip(known, measured, weights @ turning, strict=True):
        bivectors, waves, _ = _turning(surface, whitening)
        of_faces = np.einsum("fb,fb->f", bivectors, waves @ others.reshape(_NUM_PAIRS, -1).T)
        shares[i] = (_places(surface) @ of_faces).max() / of_faces.sum()
    return shares


def _with_outer_side(surfaces: Sequence[SurfaceChirality]) -> list[int]:
    return [i for i, surface in enumerate(surfaces) if len(surface.faces)]


def _places(surface: SurfaceChirality) -> BoolArray:
    """Return which triangles belong to each of some places, evenly spread over a surface, shape (places, f).

    Each triangle belongs to about four places.
    """
    points = np.unique(surface.centres, axis=0)
    num = min(round(4.0 / PLACE_AREA), len(points))
    starts = points[farthest_points(Shape.from_arrays(points), num, metric="euclidean")]
    nearest = np.argsort(scipy.spatial.distance.cdist(starts, surface.centres), axis=1)
    within = np.cumsum(surface.areas[nearest], axis=1) <= PLACE_AREA
    places = np.zeros_like(within)
    np.put_along_axis(places, nearest, within, axis=1)
    return places


def _compared(surfaces: Sequence[SurfaceChirality]) -> tuple[FloatArray, FloatArray]:
    """Return each surface's sum of bivectors (n, m), and what the products of any two are relative to (n, n)."""
    whitening = _whitening(surfaces)
    sums = []
    for surface in surfaces:
        bivectors, waves, sizes = _turning(surface, whitening)
        sums.append(((bivectors.T @ waves).ravel(), sizes @ waves))
    turning, sizes = (np.stack(each) for each in zip(*sums, strict=True))
    products = sizes @ sizes.T
    own = np.sqrt(np.maximum(np.diag(products), np.finfo(float).tiny))
    return turning, np.maximum(products, LEAST_SHARED * np.outer(own, own))


def _whitening(surfaces: Sequence[SurfaceChirality]) -> tuple[FloatArray, FloatArray]:
    """Return the mean of the features over all surfaces, and the matrix that whitens them."""
    centres = np.concatenate([surface.features[surface.faces].mean(axis=1) for surface in surfaces])
    areas = np.concatenate([surface.areas for surface in surfaces])
    values, axes = np.linalg.eigh(np.cov(centres.T, aweights=areas, bias=True))
    whitening = axes / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    return np.average(centres, axis=0, weights=areas), whitening


def _turning(
    surface: SurfaceChirality, whitening: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the bivectors of a surface's triangles (f, 15), their Fourier features (f, waves) and lengths (f,)."""
    mean, axes = whitening
    corners = ((surface.features - mean) @ axes)[surface.faces]
    first, second = (corners[:, k] - corners[:, 0] for k in (1, 2))
    bivectors = 0.5 * (
        first[:, _ROWS] * second[:, _COLUMNS] - first[:, _COLUMNS] * second[:, _ROWS]
    )
    lengths = np.linalg.norm(bivectors, axis=1)
    damped = np.sqrt(surface.areas / np.maximum(lengths, np.finfo(float).tiny))
    rng = np.random.default_rng(0)
    phases = rng.uniform(0.0, 2.0 * np.pi, NUM_RANDOM_WAVES)
    angles = corners.mean(axis=1) @ rng.standard_normal((_NUM_FEATURES, NUM_RANDOM_WAVES)) + phases
    # Random features are far less accurate than single precision, in which a cosine takes a fraction of the time.
    waves = np.cos(angles.astype(np.float32))
    return damped[:, None] * bivectors, waves, damped * lengths
