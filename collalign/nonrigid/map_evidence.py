"""Evidence for a map that the matching energy does not see: curvature, commutativity, smoothness, orientation.

The energy prefers maps that squeeze the shapes into each other over true ones, so candidates are judged by what it
does not contain.

**Front and back.**
A half turn about the long axis of a body keeps the orientation of the surface. No evidence of the inside sees it.
The outside does, at the ends of limbs: a foot points forwards, a knee bends one way, a face is on one side of the
head. So each neighbourhood there is laid onto its image by the best rotation. Along a limb that always fits. How much
of the extent across it fits as well tells front from back.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
import scipy

from collalign.confidence.map_model import Evidence
from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.spectral_shape import NUM_FORM_FUNCTIONS, SpectralShape
from collalign.nonrigid.tips import edge_net
from data_tools.arrays import FloatArray, IntArray, read_only

#: Functions, the constant one included, whose images must be smooth.
NUM_SMOOTH = 30
#: Below this absolute correlation of orientation forms, left and right are mixed.
MIXED_ORIENTATION = 0.4
#: Neighbours of a sample whose images should be near each other.
NUM_NEIGHBOURS = 6
#: Ends of limbs: of so many samples the share that is farthest from the rest by the average geodesic distance, and
#: how far their neighbourhoods reach, in units of sqrt(area). Of radii from .12 to .35 on humans and armadillos.
NUM_CENTRES, END_SHARE, LIMB_RADIUS = 250, 0.4, 0.25
#: Extents across below this, in squared units of sqrt(area), count as that.
FLAT = 1e-9


def measure_evidence(
    target: SpectralShape, source: SpectralShape, refined: FunctionalMap
) -> Evidence:
    """Return the evidence for a refined map of the dense samples (all of them or the first ones)."""
    forward, backward = refined.map_target_source, refined.map_source_target
    on_target, on_source = target.dense[: len(backward)], source.dense[: len(forward)]
    return Evidence(
        curvature=_curvature_gap(target.curvature[on_target[forward]], source.curvature[on_source]),
        commutativity=_commutativity_gap(
            refined.C_source_target, target.eigenvalues, source.eigenvalues
        ),
        roughness=_roughness(target, source, refined),
        orientation=orientation_of(target, source, refined.C_source_target, forward),
        stretch=0.5
        * (
            _stretch(target, source.vertices[on_source[backward]]) * target.area / source.area
            + _stretch(source, target.vertices[on_target[forward]]) * source.area / target.area
        ),
    )


def limb_gap(
    target: SpectralShape, source: SpectralShape, refined: FunctionalMap, *, chirality: float
) -> float:
    """Return the share of the extent across limbs that does not fit under a map of all dense samples of two meshes.

    The mean over the ends of limbs of both shapes of ``1 - (s_2 + s_3) / sqrt(v_x v_y)``. s are the singular values
    of the covariance of a neighbourhood with its image, signed such that a rotation results (Umeyama 1991). v is the
    variance of either in its two shortest directions.

    Parameters
    ----------
    target, source : SpectralShape
    refined : FunctionalMap
    chirality : float
        -1 for maps that swap left and right, whose neighbourhoods fit by a reflection.
    """
    of_target, of_source = _limbs(target), _limbs(source)
    forward, backward = refined.map_target_source, refined.map_source_target
    return 0.5 * (
        of_source.gap(of_target.points[forward], chirality)
        + of_target.gap(of_source.points[backward], chirality)
    )


class _Limbs:
    """Neighbourhoods of the samples at the ends of the limbs of a mesh of unit area."""

    def __init__(self, spectral: SpectralShape) -> None:
        places, dense = spectral.vertices / spectral.area**0.5, spectral.dense
        agd, self.points = spectral.agd[dense], places[dense]
        centres = dense[:NUM_CENTRES][agd[:NUM_CENTRES] >= np.quantile(agd, 1.0 - END_SHARE)]
        net = edge_net(places, spectral.faces)
        reached = scipy.sparse.csgraph.dijkstra(
            net, directed=False, indices=centres, limit=LIMB_RADIUS
        )[:, dense]
        inside = np.isfinite(reached).astype(np.float64)
        self._weights = inside / inside.sum(axis=1, keepdims=True)
        self._across = self._extent_across(self.points)

    def gap(self, images: FloatArray, chirality: float) -> float:
        """Return the mean share of the extent across limbs that does not fit where the samples go to ``images``."""
        values = np.linalg.svd(self._covariance(images, self.points), compute_uv=False)
        sign = np.sign(np.linalg.det(self._covariance(images, self.points))) * chirality
        fitting = values[:, 1] + np.where(sign < 0, -1.0, 1.0) * values[:, 2]
        extent = np.sqrt(self._across * self._extent_across(images))
        return float(1.0 - (fitting / np.maximum(extent, FLAT)).mean())

    def _covariance(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return the covariances (c, 3, 3) of two sets of places of the samples in each neighbourhood."""
        products = (first[:, :, None] * second[:, None, :]).reshape(len(first), 9)
        means = (self._weights @ first)[:, :, None] * (self._weights @ second)[:, None, :]
        return np.asarray((self._weights @ products).reshape(-1, 3, 3) - means)

    def _extent_across(self, places: FloatArray) -> FloatArray:
        """Return the variance of the samples' places in each neighbourhood in its two shortest directions, (c,)."""
        shortest = np.linalg.eigvalsh(self._covariance(places, places))[:, :2].sum(axis=1)
        return np.asarray(np.maximum(shortest, 0.0))  # rounding may leave less than 0


@lru_cache(maxsize=4)
def _limbs(shape: SpectralShape) -> _Limbs:
    return _Limbs(shape)


def orientation_of(
    target: SpectralShape,
    source: SpectralShape,
    c_source_target: FloatArray,
    map_target_source: IntArray,
) -> float:
    """Return the correlation of the source's orientation form of pulled-back functions with the target's form.

    Parameters
    ----------
    target, source : SpectralShape
    c_source_target : ndarray, shape (m, m)
        Functional map with the constant function first.
    map_target_source : ndarray of int
        Of the first dense samples of the source into those of the target.
    """
    own = source.orientation[: len(map_target_source)]
    of_target, second = paired_forms(target.orientation, own, c_source_target)
    first = of_target[map_target_source]
    norm = np.linalg.norm(first) * np.linalg.norm(second)
    return float((first * second).sum() / norm) if norm > 0 else float("nan")


def paired_forms(
    form_target: FloatArray,
    form_source: FloatArray,
    c_source_target: FloatArray,
    *,
    sign: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the orientation forms of the target's lowest functions, and of what they become on the source.

    Parameters
    ----------
    form_target, form_source : ndarray, shapes (s, q, q) and (t, q, q)
        At points of the two shapes.
    c_source_target : ndarray, shape (m, m)
        The constant function first.
    sign : float
        Factor of the source's form; -1 for mirrored maps.

    Returns
    -------
    ndarray, shapes (s, p) and (t, p)
        One column for each pair of functions.
    """
    size = form_source.shape[1]
    few = min(NUM_FORM_FUNCTIONS, size)
    pull = c_source_target[1 : size + 1, 1 : few + 1]
    used = form_source[:, : len(pull), : len(pull)].reshape(len(form_source), -1)
    a, b = _every_two(few)
    pulled = used @ (pull[:, None, a] * pull[:, b]).reshape(-1, len(a))
    return form_target[:, a, b], sign * pulled


@cache
def _every_two(num: int) -> tuple[IntArray, IntArray]:
    """Return every two of so many functions, each (p,)."""
    first, second = np.triu_indices(num, 1)
    return read_only(first), read_only(second)


def _curvature_gap(of_target: FloatArray, of_source: FloatArray) -> float:
    """Return 1 - the mean correlation of curvatures, (m, t) each: of m matched points, at t heat times."""
    first, second = of_target - of_target.mean(axis=0), of_source - of_source.mean(axis=0)
    norms = np.linalg.norm(first, axis=0) * np.linalg.norm(second, axis=0)
    correlations = (first * second).sum(axis=0) / np.where(norms > 0, norms, 1.0)
    return float(1.0 - correlations.mean())


def _roughness(target: SpectralShape, source: SpectralShape, refined: FunctionalMap) -> float:
    """Return the mean of ``(Phi_T[map] - Phi_S C)^2`` over samples and the low functions of the target."""
    forward, c = refined.map_target_source, refined.C_source_target
    few = min(NUM_SMOOTH, len(c))
    images = target.functions[target.dense[forward], : few - 1]
    own = source.dense[: len(forward)]
    smooth = c[0, 1:few] + source.functions[own, : len(c) - 1] @ c[1:, 1:few]
    return float(((images - smooth) ** 2).mean())


def _stretch(shape: SpectralShape, images: FloatArray) -> float:
    """Return the squared distances of the images of neighbours, the first dense samples, over those of these."""
    neighbours, squares = _neighbours(shape, len(images))
    return float(((images[neighbours] - images[:, None]) ** 2).sum() / squares)


@lru_cache(maxsize=4)
def _neighbours(shape: SpectralShape, num: int) -> tuple[IntArray, float]:
    """Return the nearest of the first dense samples to each, and the sum of their squared distances."""
    points = shape.vertices[shape.dense[:num]]
    distances, neighbours = scipy.spatial.cKDTree(points).query(points, NUM_NEIGHBOURS + 1)
    return neighbours[:, 1:], float((distances**2).sum())


def _commutativity_gap(
    c: FloatArray, target_values: FloatArray, source_values: FloatArray
) -> float:
    """Return ``|Lambda_S C - C Lambda_T| / (|Lambda_S C| + |C Lambda_T|)`` in Frobenius norms."""
    size = len(c)
    of_target = np.concatenate([[0.0], target_values])[:size]
    of_source = np.concatenate([[0.0], source_values])[:size]
    left, right = of_source[:, None] * c, c * of_target
    total = np.linalg.norm(left) + np.linalg.norm(right)
    return float(np.linalg.norm(left - right) / total) if total > 0 else 1.0
