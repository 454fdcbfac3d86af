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
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.embedding.invariants import HKS_TIMES, NUM_SPECTRUM, heat_kernel_signature
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import SamplingOptions
from data_tools.surface.normals import orientation_defects, vertex_normals
from data_tools.surface.shape import Shape
from data_tools.surface.topology import face_areas, face_crosses
from data_tools.threads import one_blas_thread

#: Radii of the neighbourhoods over which a surface bulges, in square roots of the area.
BULGE_RADII = (0.08, 0.16)
#: An open surface has an outer side if its signed volume about the centroid is at least this share of the unsigned
#: one; a thin open sheet has none.
LEAST_FACING = 0.5
#: A surface has no outer side if more than this share of its edges is run through twice in the same direction.
#: Skulls of thin sheets have 5 % where the sheets meet, triangles wound at random have half.
MOST_DEFECTS = 0.1
#: Random Fourier features of a Gaussian kernel of width 1. With 2000 the scores of teeth change by a tenth.
NUM_WAVES = 400

_NUM_FEATURES = len(HKS_TIMES) + len(BULGE_RADII)
_ROWS, _COLUMNS = np.triu_indices(_NUM_FEATURES, 1)

#: Surfaces whose features have less than this share in common are compared as if they had as much: they hardly score.
LEAST_SHARED = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceChirality:
    """The triangles of a surface with the features of their corners. Arrays are read-only.

    Attributes
    ----------
    features : ndarray, shape (v, 6)
        Log heat kernel signatures at four times, and bulges at two radii.
    faces : ndarray of int, shape (f, 3)
        Counterclockwise seen from outside. Empty if the surface has no outer side: a point cloud, a thin open sheet,
        or triangles that disagree on a side.
    areas : ndarray, shape (f,)
        Shares of the surface area.
    """

    features: Annotated[FloatArray, Holds(shape="v 6")]
    faces: Annotated[IntArray, Holds(shape="f 3")]
    areas: Annotated[FloatArray, Holds(shape="f")]


#: Of a surface without an outer side.
NO_CHIRALITY = SurfaceChirality(
    features=np.empty((0, _NUM_FEATURES)), faces=np.empty((0, 3), dtype=np.int32), areas=np.empty(0)
)


@one_blas_thread()
def surface_chirality(shape: Shape) -> SurfaceChirality:
    """Compute the features of a surface that show its chirality.

    Parameters
    ----------
    shape : Shape
        Clean, as :func:`data_tools.surface.cleaning.clean` leaves it.

    Raises
    ------
    InputError
        If the surface is too poor for eigenfunctions.
    """
    surface = WorkingSurface(shape, SamplingOptions())
    faces = _outward(surface)
    if not len(faces):
        return NO_CHIRALITY
    points = surface.shape.vertices / surface.area**0.5
    spectrum = surface.eigenfunctions(NUM_SPECTRUM)
    bulges = _bulges(points, vertex_normals(points, faces), spectrum.mass)
    areas = face_areas(points, faces)
    return SurfaceChirality(
        features=read_only(np.column_stack([heat_kernel_signature(spectrum), bulges])),
        faces=read_only(np.ascontiguousarray(faces, dtype=np.int32)),
        areas=read_only(areas / areas.sum()),
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
    tree, found = cKDTree(points), []
    weighted = mass[:, None] * np.column_stack([points, np.ones(len(points))])
    for radius in BULGE_RADII:
        rows, columns = tree.query_pairs(radius, output_type="ndarray").T
        near = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(points), len(points)))
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
    known = [i for i, surface in enumerate(surfaces) if len(surface.faces)]
    if len(known) < 2:
        return scores
    centres = [surfaces[i].features[surfaces[i].faces].mean(axis=1) for i in known]
    areas = np.concatenate([surfaces[i].areas for i in known])
    values, axes = np.linalg.eigh(np.cov(np.concatenate(centres).T, aweights=areas, bias=True))
    whitening = axes / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    mean = np.average(np.concatenate(centres), axis=0, weights=areas)
    sums = [_turning_and_size(surfaces[i], mean, whitening) for i in known]
    turning, sizes = (np.stack(each) for each in zip(*sums, strict=True))
    products = sizes @ sizes.T
    own = np.sqrt(np.maximum(np.diag(products), np.finfo(float).tiny))
    scores[np.ix_(known, known)] = (
        turning @ turning.T / np.maximum(products, LEAST_SHARED * np.outer(own, own))
    )
    np.fill_diagonal(scores, np.nan)
    return scores


def _turning_and_size(
    surface: SurfaceChirality, mean: FloatArray, whitening: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a surface's sum of bivectors, and of their lengths, by random Fourier features of whitened features."""
    corners = ((surface.features - mean) @ whitening)[surface.faces]
    first, second = (corners[:, k] - corners[:, 0] for k in (1, 2))
    bivectors = 0.5 * (
        first[:, _ROWS] * second[:, _COLUMNS] - first[:, _COLUMNS] * second[:, _ROWS]
    )
    lengths = np.linalg.norm(bivectors, axis=1)
    damped = np.sqrt(surface.areas / np.maximum(lengths, np.finfo(float).tiny))
    rng = np.random.default_rng(0)
    phases = rng.uniform(0.0, 2.0 * np.pi, NUM_WAVES)
    angles = corners.mean(axis=1) @ rng.standard_normal((_NUM_FEATURES, NUM_WAVES)) + phases
    # Random features are far less accurate than single precision, in which a cosine takes a fraction of the time.
    waves = np.cos(angles.astype(np.float32))
    return ((damped[:, None] * bivectors).T @ waves).ravel(), (damped * lengths) @ waves
