"""Registers one surface to another: closest points both ways pull on a smooth field, coarse deformations first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from collalign.registration.field import SmoothField, gaussian_kernel
from collalign.registration.options import RegistrationOptions
from collalign.registration.surface import RegistrationSurface
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Added to the kernel's diagonal, in parts of it: centres of a smooth kernel are nearly dependent.
_JITTER = 1e-6
#: However many correspondences there are, they weigh like so many independent ones: neighbours say the same. With
#: 6000, nine of ten pairs of molars fold and skulls err 5 % more; from 400 to 60 nothing changes but fewer folds.
_NUM_INDEPENDENT = 60
#: A deformation that shrinks volume to less than this at any of the source's points counts as folding.
MIN_VOLUME_CHANGE = 0.05
#: Factor of the noise when a field folds, and where it is given up.
_STIFFER, _MAX_STIFFNESS = 1.5, 1000.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """A source surface laid onto a target.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3)
        The source's vertices, moved. Read-only.
    residual : ndarray, shape (v,)
        Distance of each to the target's surface. Read-only.
    quality : ndarray, shape (v,)
        Between 0 (no counterpart: beyond the rim, too far, or facing elsewhere) and 1. Read-only.
    field : SmoothField
        Moves any point of space as the vertices are moved.
    stiffness : float
        So many times the noise of the options was needed to keep space from folding; 1 is none.
    """

    vertices: FloatArray
    residual: FloatArray
    quality: FloatArray
    field: SmoothField
    stiffness: float


@one_blas_thread()
def register(
    target: RegistrationSurface, source: RegistrationSurface, options: RegistrationOptions | None = None
) -> Registration:
    """Deform a source onto a target that it is posed on already.

    The field is the posterior mean of a Gaussian process, given the closest points of both surfaces on each other
    (positions and normals compared), which are found again in every iteration while their noise is lowered.
    Correspondences on a rim, with normals that disagree, or far beyond the median distance have no say. Where an
    iteration would fold space, correspondences are trusted less from then on, until none does.

    Parameters
    ----------
    target, source : RegistrationSurface
    options : RegistrationOptions, optional

    Raises
    ------
    InputError
        If nothing on one surface corresponds to anything on the other.

    References
    ----------
    Lüthi et al. 2018 (Gaussian process registration); Feldmar and Ayache 1996 (closest points with normals); Chen and
    Medioni 1992 (offsets along normals count more than those along the surface); Tukey's biweight.
    """
    options = options or RegistrationOptions()
    search = _Search(target, source, options)
    solver = _FieldSolver(target, source, options)
    moved, field, stiffness = source.vertices, solver.still, 1.0
    for noise in options.noise:
        pulls = search.pulls(moved, noise)
        field, stiffness = solver.fold_free(moved, pulls, noise * target.radius, stiffness)
        moved = solver.moved(field)
    residual, quality = search.fit(moved, options.noise[-1])
    return Registration(
        vertices=read_only(np.array(moved)),
        residual=read_only(residual),
        quality=read_only(quality),
        field=field,
        stiffness=stiffness,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pulls:
    """Which source vertices should go where, and how much each counts."""

    vertices: IntArray
    offsets: FloatArray
    weights: FloatArray


class _Search:
    """Finds what corresponds: closest points in positions beside normals, which shrink with the iteration's noise."""

    def __init__(
        self, target: RegistrationSurface, source: RegistrationSurface, options: RegistrationOptions
    ) -> None:
        self._target, self._source, self._options = target, source, options
        self._has_normals = target.oriented and source.oriented
        self._target_normals = target.normals(target.vertices)

    def pulls(self, moved: FloatArray, noise: float) -> _Pulls:
        """Return the closest points of both surfaces on each other as offsets of source vertices."""
        target, source = self._target, self._source
        normals = source.normals(moved)
        ours, theirs = (
            self._features(moved, normals, noise),
            self._features(target.vertices, self._target_normals, noise),
        )
        hit = cKDTree(theirs).query(ours[source.spread])[1]
        struck = cKDTree(ours).query(theirs[target.spread])[1]
        at, to = np.concatenate([source.spread, struck]), np.concatenate([hit, target.spread])
        weights = self._trust(moved, normals, at, to)
        weights *= ~np.concatenate([target.on_rim[hit], source.on_rim[struck]])
        kept = weights > 0
        if not kept.any():
            raise InputError("registration: no point of one surface has a counterpart on the other at these poses")
        at, to = at[kept], to[kept]
        offsets = target.vertices[to] - moved[at]
        if self._has_normals:
            along = (offsets * self._target_normals[to]).sum(axis=1, keepdims=True) * self._target_normals[to]
            offsets = along + self._options.tangential * (offsets - along)
        return _Pulls(vertices=at, offsets=offsets, weights=weights[kept])

    def fit(self, moved: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
        """Distance of every moved vertex to the target's surface, and how well it corresponds to anything there."""
        target, normals = self._target, self._source.normals(moved)
        places = target.locator.closest(moved).on(target.vertices)
        ours, theirs = (
            self._features(moved, normals, noise),
            self._features(target.vertices, self._target_normals, noise),
        )
        hit = cKDTree(theirs).query(ours)[1]
        quality = self._trust(moved, normals, np.arange(len(moved)), hit) * ~target.on_rim[hit]
        return np.asarray(np.linalg.norm(places - moved, axis=1)), np.asarray(quality)

    def _features(self, vertices: FloatArray, normals: FloatArray, noise: float) -> FloatArray:
        """Positions beside scaled normals: their Euclidean distance is what "closest" means."""
        scale = self._target.radius * noise / self._options.normal_noise if self._has_normals else 0.0
        return np.hstack([vertices, scale * normals])

    def _trust(self, moved: FloatArray, normals: FloatArray, at: IntArray, to: IntArray) -> FloatArray:
        """Tukey's biweight of each correspondence's distance, zero where normals disagree."""
        distances = np.linalg.norm(self._target.vertices[to] - moved[at], axis=1)
        scale = max(self._options.cutoff * float(np.median(distances)), 1e-9 * self._target.radius)
        weights = np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2
        if self._has_normals:
            weights *= (normals[at] * self._target_normals[to]).sum(axis=1) > self._options.min_cosine
        return np.asarray(weights)


class _FieldSolver:
    """Finds the field that correspondences ask for."""

    def __init__(
        self, target: RegistrationSurface, source: RegistrationSurface, options: RegistrationOptions
    ) -> None:
        centres = source.vertices[source.spread[: options.num_centres]]
        widths = tuple(target.radius * width for width in options.widths)
        amplitudes = tuple(target.radius * amplitude for amplitude in options.amplitudes)
        self.still = SmoothField(
            centres=centres, weights=np.zeros_like(centres), widths=widths, amplitudes=amplitudes
        )
        self._source = source.vertices
        self._checked = source.vertices[source.spread]
        self._slopes = self.still.slope_kernel(self._checked)
        self._basis = gaussian_kernel(source.vertices, centres, widths, amplitudes)
        self._prior = gaussian_kernel(centres, centres, widths, amplitudes)
        self._prior[np.diag_indices_from(self._prior)] *= 1.0 + _JITTER

    def moved(self, field: SmoothField) -> FloatArray:
        """Return the source's vertices where a field takes them."""
        return np.asarray(self._source + self._basis @ field.weights)

    def fold_free(
        self, moved: FloatArray, pulls: _Pulls, noise: float, stiffness: float
    ) -> tuple[SmoothField, float]:
        """Return the field at the least stiffness, from the given one on, that folds nothing, and that stiffness.

        Weights ``w`` are of least ``sum_i t_i |B_i w - y_i|^2 / s^2 + w^T K w``, with the noise ``s`` multiplied by
        the stiffness. A field that cannot be made to unfold stays still.
        """
        rows = self._basis[pulls.vertices]
        weighted = rows * pulls.weights[:, None]
        asked = weighted.T @ ((moved - self._source)[pulls.vertices] + pulls.offsets)
        data, per_point = rows.T @ weighted, len(rows) / _NUM_INDEPENDENT
        while stiffness <= _MAX_STIFFNESS:
            system = data + (stiffness * noise) ** 2 * per_point * self._prior
            field = self.still.with_weights(cho_solve(cho_factor(system, lower=True), asked))
            if np.linalg.det(field.jacobian(self._checked, self._slopes)).min() >= MIN_VOLUME_CHANGE:
                return field, stiffness
            stiffness *= _STIFFER
        return self.still, stiffness
