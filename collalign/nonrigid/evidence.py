"""Evidence for a map that the matching energy does not see: curvature, commutativity, smoothness, orientation.

The energy prefers maps that squeeze the shapes into each other over true ones, so candidates are judged by what it
does not contain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.surface.geometry import NUM_FORM_FUNCTIONS
from collalign.nonrigid.surface.spectral import SpectralShape
from data_tools.arrays import FloatArray, IntArray

#: Functions, the constant one included, whose images must be smooth.
NUM_SMOOTH = 30
#: Below this absolute correlation of orientation forms, left and right are mixed.
MIXED_ORIENTATION = 0.4
#: Neighbours of a sample whose images should be near each other.
NUM_NEIGHBOURS = 6
#: Weight of the logarithm of the stretch, chosen on the 40 pairs of SHREC07's ants and glasses on which maps are
#: published: .5 to 1 choose the same candidates, of mean error .139 and .091; .25 .162 and .122, 0 .167 and .092.
STRETCH_WEIGHT = 0.5
#: Floor of a disagreement inside its logarithm.
FLOOR = 1e-3
#: Weights of the logarithms of what the best pose leaves, beside 1 for commutativity and roughness: their ratios in
#: :data:`collalign.stages.evidence.odds.WEIGHTS`, which were fitted on other pairs.
NORMALS_WEIGHT, SURFACE_WEIGHT = 0.8, 0.5


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """How well a map of the dense samples agrees with what the shapes are.

    Attributes
    ----------
    curvature : float
        1 - correlation of the smoothed mean curvatures at matched points; NaN without normals.
    commutativity : float
        Share of the functional map that does not commute with the two Laplacians, in [0, 1].
    roughness : float
        Mean squared difference between the target's low functions at the images and the smooth functions that the
        functional map makes of them: a map that is torn, or turned over in part, cannot be smooth.
    orientation : float
        Correlation of the orientation forms: near 1 keeps left and right, near -1 swaps them, near 0 mixes them; NaN
        without normals.
    coverage : float
        Share of the target's dense samples that are some point's image.
    bijectivity : float
        Share of the source's dense samples that come back, by map and inverse, to a point nearer than 0.1 sqrt(area).
    stretch : float
        Squared distances of neighbouring samples' images over those of the samples, the mean of both ways: a map that
        is torn takes neighbours far apart.
    normals : float
        Mean of 1 - cosine of matched normals at the rotation that the map asks for; NaN where no pose was asked.
    surface : float
        Mean squared distance of closest points with normals there; NaN likewise.
    """

    curvature: float
    commutativity: float
    roughness: float
    orientation: float
    coverage: float
    bijectivity: float
    stretch: float = float("nan")
    normals: float = float("nan")
    surface: float = float("nan")

    @property
    def score(self) -> float:
        """The map's own score and what its pose leaves, where one was asked, by logarithms; the lower the better."""
        if not np.isfinite(self.normals):
            return self.map_score
        left = NORMALS_WEIGHT * np.log(max(self.normals, FLOOR)) + SURFACE_WEIGHT * np.log(max(self.surface, FLOOR))
        return self.map_score + float(left)

    @property
    def map_score(self) -> float:
        """Logarithms of the map's disagreements plus what the orientation leaves open; the lower the better.

        Curvature counts twice, because it alone tells the sides of an intrinsically symmetric surface apart.
        """
        total = np.log(max(self.commutativity, FLOOR)) + np.log(max(self.roughness, FLOOR))
        if np.isfinite(self.curvature):
            total += 2.0 * np.log(max(self.curvature, FLOOR))
        if np.isfinite(self.stretch):
            total += STRETCH_WEIGHT * np.log(max(self.stretch, FLOOR))
        if np.isfinite(self.orientation):
            total += 1.0 - abs(self.orientation)
        return float(total)


def judge(target: SpectralShape, source: SpectralShape, refined: FunctionalMap) -> Evidence:
    """Return the evidence for a refined map of the dense samples (all of them or the first ones)."""
    forward, backward = refined.map_target_source, refined.map_source_target
    on_target, on_source = target.dense[: len(backward)], source.dense[: len(forward)]
    returned = source.vertices[on_source[backward[forward]]] - source.vertices[on_source]
    return Evidence(
        curvature=_curvature_gap(target.curvature[on_target[forward]], source.curvature[on_source]),
        commutativity=_commutativity_gap(refined.C_source_target, target.eigenvalues, source.eigenvalues),
        roughness=_roughness(target, source, refined),
        orientation=orientation_of(target, source, refined.C_source_target, forward),
        coverage=len(np.unique(forward)) / len(backward),
        stretch=0.5
        * (
            _stretch(target.vertices[on_target], source.vertices[on_source[backward]]) * target.area / source.area
            + _stretch(source.vertices[on_source], target.vertices[on_target[forward]]) * source.area / target.area
        ),
        bijectivity=float((np.linalg.norm(returned, axis=1) <= 0.1 * source.area**0.5).mean()),
    )


def orientation_of(
    target: SpectralShape, source: SpectralShape, c_source_target: FloatArray, map_target_source: IntArray
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
    first, second = paired_forms(
        target.orientation[map_target_source], source.orientation[: len(map_target_source)], c_source_target
    )
    norm = np.linalg.norm(first) * np.linalg.norm(second)
    return float((first * second).sum() / norm) if norm > 0 else float("nan")


def paired_forms(
    form_target: FloatArray, form_source: FloatArray, c_source_target: FloatArray, *, sign: float = 1.0
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
    used = form_source[:, : len(pull), : len(pull)]
    pulled = np.einsum("ab,xac,cd->xbd", pull, used, pull, optimize=True)
    upper = np.triu_indices(few, 1)
    return form_target[:, upper[0], upper[1]], sign * pulled[:, upper[0], upper[1]]


def _curvature_gap(of_target: FloatArray, of_source: FloatArray) -> float:
    """Return 1 - the mean correlation of matched curvatures over the heat times."""
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


def _stretch(points: FloatArray, images: FloatArray) -> float:
    """Return the squared distances of neighbours' images over those of the neighbours."""
    distances, neighbours = cKDTree(points).query(points, NUM_NEIGHBOURS + 1)
    apart = images[neighbours[:, 1:]] - images[:, None]
    return float((apart**2).sum() / (distances**2).sum())


def _commutativity_gap(c: FloatArray, target_values: FloatArray, source_values: FloatArray) -> float:
    """Return ``|Lambda_S C - C Lambda_T| / (|Lambda_S C| + |C Lambda_T|)`` in Frobenius norms."""
    size = len(c)
    of_target = np.concatenate([[0.0], target_values])[:size]
    of_source = np.concatenate([[0.0], source_values])[:size]
    left, right = of_source[:, None] * c, c * of_target
    total = np.linalg.norm(left) + np.linalg.norm(right)
    return float(np.linalg.norm(left - right) / total) if total > 0 else 1.0
