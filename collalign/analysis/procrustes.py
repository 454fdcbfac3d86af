"""Shape statistics: Procrustes mean and distances, principal components, a map of distances, changes of poses.

Everything here takes samples with consistent labels, shape (N, k, 3): row b of every shape is the same landmark.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import BoolArray, FloatArray, IntArray, as_floats, read_only
from data_tools.errors import InputError
from data_tools.poses import AGREE_DEG
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg
from data_tools.threads import one_blas_thread

#: Rounds of superimposition on the mean, at most; it has settled when its squared movement is below this, relative to
#: its squared size.
MAX_SUPERIMPOSITIONS, SETTLED = 200, 1e-20
#: Fewest common labels from which a pose in space is determined.
MIN_LABELS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class PrincipalComponents:
    """Principal components of superimposed shapes.

    Attributes
    ----------
    mean : ndarray, shape (k, 3)
    axes : ndarray, shape (m, k, 3)
        Orthonormal as vectors of 3k numbers, largest variance first; the largest entry of each is positive.
    variances : ndarray, shape (m,)
        Along each axis, with N - 1 in the denominator.
    shares : ndarray, shape (m,)
        Of the total variance.
    scores : ndarray, shape (N, m)
    """

    mean: FloatArray
    axes: FloatArray
    variances: FloatArray
    shares: FloatArray
    scores: FloatArray

    def shape_at(self, component: int, deviations: float) -> FloatArray:
        """Return the shape ``deviations`` standard deviations from the mean along a component, shape (k, 3)."""
        return self.mean + deviations * np.sqrt(self.variances[component]) * self.axes[component]


def common_labels(samples: ArrayLike) -> BoolArray:
    """Return labels that every shape has, shape (k,): those without NaN in any shape."""
    points = np.asarray(samples, dtype=np.float64)
    return np.asarray(~np.isnan(points).any(axis=(0, 2)))


@one_blas_thread()
def generalized_procrustes(samples: ArrayLike) -> FloatArray:
    """Superimpose all shapes, at unit size, on their mean, repeatedly, until the mean stands still.

    Rotations only: shapes of opposite handedness must have been mirrored before, as aligned samples are.

    Parameters
    ----------
    samples : array_like, shape (N, k, 3)
        Complete; see :func:`common_labels`.

    Returns
    -------
    ndarray, shape (N, k, 3)
        The superimposed shapes, of unit centroid size.

    Raises
    ------
    InputError
        If samples are missing or a shape is a single point.

    References
    ----------
    Gower, Generalized Procrustes analysis, Psychometrika 40 (1975). Rohlf and Slice, Extensions of the Procrustes
    method for the optimal superimposition of landmarks, Systematic Zoology 39 (1990).

    Examples
    --------
    >>> landmarks = np.load("landmarks.npy")  # (12, 8, 3): six specimens, each digitised twice
    >>> collalign.statistics.generalized_procrustes(landmarks).shape
    (12, 8, 3)
    """
    shapes = unit_size(as_floats(samples, "samples", shape=(None, None, 3)))
    if not len(shapes):
        raise InputError("samples: no shapes")
    mean = shapes[0]
    for _ in range(MAX_SUPERIMPOSITIONS):
        aligned = shapes @ np.swapaxes(best_rotations(mean, shapes), 1, 2)
        new = aligned.mean(axis=0)
        new /= np.linalg.norm(new)
        moved, mean = np.sum((new - mean) ** 2) / np.sum(mean**2), new
        if moved <= SETTLED:
            break
    return read_only(aligned)


def best_rotations(targets: FloatArray, sources: FloatArray) -> FloatArray:
    """Return rotations that bring sources closest to targets, shape (..., 3, 3); both centred, determinant +1.

    Kabsch's solution; ``targets`` and ``sources`` broadcast against each other.
    """
    return nearest_orthogonal(np.swapaxes(targets, -1, -2) @ sources, determinant=1.0)


@one_blas_thread()
def principal_components(aligned: ArrayLike) -> PrincipalComponents:
    """Find the principal components of superimposed shapes.

    Parameters
    ----------
    aligned : array_like, shape (N, k, 3)
        At least two, superimposed, as :func:`generalized_procrustes` returns them.

    Raises
    ------
    InputError
        If there are fewer than two shapes or samples are missing.

    Examples
    --------
    >>> aligned = collalign.statistics.generalized_procrustes(np.load("landmarks.npy"))
    >>> collalign.statistics.principal_components(aligned).scores.shape
    (12, 11)
    """
    points = as_floats(aligned, "aligned", shape=(None, None, 3))
    if len(points) < 2:
        raise InputError(
            f"aligned: principal components need at least two shapes, got {len(points)}"
        )
    mean = points.mean(axis=0)
    left, singular, axes = np.linalg.svd(
        (points - mean).reshape(len(points), -1), full_matrices=False
    )
    count = min(len(points) - 1, axes.shape[0])
    rows = np.arange(len(axes))
    flip = np.sign(axes[rows, np.abs(axes).argmax(axis=1)])
    variances = singular**2 / (len(points) - 1)
    total = float(variances.sum())
    return PrincipalComponents(
        mean=read_only(mean),
        axes=read_only((axes * flip[:, None])[:count].reshape(count, -1, 3)),
        variances=read_only(variances[:count]),
        shares=read_only(variances[:count] / total if total > 0 else np.zeros(count)),
        scores=read_only((left * singular * flip)[:, :count]),
    )


@one_blas_thread()
def procrustes_distances(samples: ArrayLike) -> FloatArray:
    """Return partial Procrustes distances of all pairs, each superimposed on the labels that both shapes have.

    ``2 sin(rho / 2)``, rho the arccos of the summed singular values of the two unit-size configurations (Dryden and
    Mardia, Statistical Shape Analysis, chapter 4).

    Parameters
    ----------
    samples : array_like, shape (N, k, 3)
        NaN where a shape has no such label.

    Returns
    -------
    ndarray, shape (N, N)
        Symmetric, zero diagonal; NaN for pairs with fewer than three labels in common.
    """
    points = np.array(samples, dtype=np.float64)
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"samples: expected shape (N, k, 3), got {points.shape}")
    present = np.asarray(~np.isnan(points).any(axis=2))
    cosines = np.ones((len(points), len(points)))
    for i in range(len(points) - 1):
        cosines[i, i + 1 :] = cosines[i + 1 :, i] = _cosines(
            points[i], points[i + 1 :], present[i] & present[i + 1 :]
        )
    rho = np.arccos(np.clip(cosines, -1.0, 1.0))
    np.fill_diagonal(rho, 0.0)
    return 2 * np.sin(rho / 2)


def unit_size(points: FloatArray) -> FloatArray:
    """Return configurations, shape (N, k, 3), centred and of unit centroid size.

    Raises
    ------
    InputError
        If one is a single point.
    """
    sizes = centroid_sizes(points)
    if (sizes <= 0).any():
        raise InputError(f"samples: shape {int(sizes.argmin())} is a single point and has no size")
    return (points - points.mean(axis=1, keepdims=True)) / sizes[:, None, None]


def centroid_sizes(points: FloatArray) -> FloatArray:
    """Return the square root of the summed squared distances of points from their centroid, shape (N,).

    Parameters
    ----------
    points : ndarray, shape (N, k, 3)
        NaN where a shape has no such point; the size of a shape without any is NaN.
    """
    known = np.asarray(np.isfinite(points).all(axis=2))
    counts = known.sum(axis=1)
    filled = np.where(known[..., None], points, 0.0)
    centres = filled.sum(axis=1) / np.maximum(counts, 1)[:, None]
    squares = np.where(known, ((filled - centres[:, None]) ** 2).sum(axis=2), 0.0).sum(axis=1)
    return np.asarray(np.sqrt(np.where(counts > 0, squares, np.nan)))


def _cosines(one: FloatArray, others: FloatArray, common: BoolArray) -> FloatArray:
    """Return sums of signed singular values of ``one`` against each of ``others``, NaN if few labels are common."""
    counts = common.sum(axis=1)
    mask = common[:, :, None].astype(np.float64)
    num = np.maximum(counts, 1)[:, None, None]
    a = np.nan_to_num(one)[None] * mask
    b = np.nan_to_num(others) * mask
    a = (a - a.sum(axis=1, keepdims=True) / num) * mask
    b = (b - b.sum(axis=1, keepdims=True) / num) * mask
    norms = np.linalg.norm(a, axis=(1, 2)) * np.linalg.norm(b, axis=(1, 2))
    cross = np.swapaxes(a, 1, 2) @ b
    singular = np.linalg.svd(cross, compute_uv=False)
    singular[:, 2] *= np.sign(np.linalg.det(cross))
    usable = (counts >= MIN_LABELS) & (norms > 0)
    return np.where(usable, singular.sum(axis=1) / np.where(norms > 0, norms, 1.0), np.nan)


#: Coordinates of multidimensional scaling.
NUM_DIMENSIONS = 2


@one_blas_thread()
def classical_mds(distances: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return principal coordinates (classical multidimensional scaling) of a complete distance matrix.

    Parameters
    ----------
    distances : array_like, shape (N, N)

    Returns
    -------
    coordinates : ndarray, shape (N, NUM_DIMENSIONS)
        The largest entry of each column is positive.
    shares : ndarray, shape (NUM_DIMENSIONS,)
        Part of the sum of positive eigenvalues that each axis shows.

    References
    ----------
    Torgerson, Multidimensional scaling: I. Theory and method, Psychometrika 17 (1952).
    """
    squared = as_floats(distances, "distances") ** 2
    centring = np.eye(len(squared)) - 1.0 / len(squared)
    values, vectors = np.linalg.eigh(-0.5 * centring @ squared @ centring)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    coordinates = np.zeros((len(squared), NUM_DIMENSIONS))
    count = min(NUM_DIMENSIONS, len(squared))
    coordinates[:, :count] = (vectors * np.sqrt(values))[:, :count]
    largest = np.abs(coordinates).argmax(axis=0)
    coordinates *= np.where(coordinates[largest, np.arange(NUM_DIMENSIONS)] < 0, -1.0, 1.0)
    shares = np.zeros(NUM_DIMENSIONS)
    shares[:count] = values[:count] / max(float(values.sum()), np.finfo(float).tiny)
    return coordinates, shares


def pose_changes(
    reference: FloatArray, again: FloatArray, part_numbers: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Return by how much each pose differs, and whether it is mirrored as before, in the frame that most agree with.

    The common frame of an alignment is arbitrary. So the second one is rotated as the shape asks with which most
    others are within :data:`AGREE_DEG`, of several such frames as that with the smallest sum of angles.

    Parameters
    ----------
    reference, again : ndarray, shape (n, 3, 3)
        ``R_common_shape`` of the same shapes.
    part_numbers : ndarray of int, shape (n,)
        Shapes of different part_numbers are not aligned with each other in the reference.

    Returns
    -------
    changes_deg : ndarray, shape (n,)
        NaN where mirrored differently, and for a shape alone in its group, which has nothing to stand still to.
    same_chirality : ndarray of bool, shape (n,)
    """
    changes_deg, same = np.full(len(part_numbers), np.nan), np.ones(len(part_numbers), dtype=bool)
    for number in np.unique(part_numbers):
        members = np.flatnonzero(part_numbers == number)
        if len(members) < 2:
            continue
        before, after = reference[members], again[members]
        frames = before @ np.swapaxes(after, 1, 2)
        angles = rotation_angle_deg(frames[:, None] @ after[None], before)
        worst = np.nan_to_num(angles, nan=180.0)
        best = np.lexsort((worst.sum(axis=1), -(worst <= AGREE_DEG).sum(axis=1)))[0]
        changes_deg[members], same[members] = angles[best], ~np.isnan(angles[best])
    return changes_deg, same
