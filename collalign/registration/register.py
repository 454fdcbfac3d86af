"""Registers one surface to another: closest points settle the pose and pull on a smooth field of displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, TypeAlias

import numpy as np
import scipy

from collalign.registration.surface import TUNED, RegistrationSurface
from data_tools.arrays import BoolArray, FloatArray, Holds, IntArray, read_only
from data_tools.errors import InputError
from data_tools.poses import fitting_similarity, moved_by, scales_of
from data_tools.threads import one_blas_thread

#: Points whose kernels are in memory at a time.
_BLOCK = 4096


#: Displacements that the prior allows less than this part of the variance of the one that it allows most are left
#: out: of 600, 120 to 290 are left. Vertices of seven molars and of six skulls move by .0006 radii at most for it, on
#: average over each, and those of a seventh skull by .002, as they do if its points come in another order.
_NEGLIGIBLE = 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldSpace:
    """Smooth displacements that a sum of Gaussians at some centres can be, as far as a prior allows them.

    The prior is a Gaussian process with the kernel ``k(x, c) = sum_s a_s^2 exp(-|x - c|^2 / (2 s^2))``.

    Attributes
    ----------
    centres : ndarray, shape (m, 3)
    modes : ndarray, shape (m, r)
        Weights of the centres, for coefficients that are independent and of unit variance.
    widths, amplitudes : tuple of float
        Of the kernel's terms, in the unit of the centres.

    References
    ----------
    Lüthi, Gerig, Jud and Vetter, Gaussian process morphable models, IEEE PAMI 40 (2018): sums of kernels as a
    prior of deformations of several scales, and the leading eigenfunctions of a kernel as their basis.
    """

    centres: FloatArray
    modes: FloatArray
    widths: tuple[float, ...]
    amplitudes: tuple[float, ...]

    @classmethod
    def at(
        cls, centres: FloatArray, widths: tuple[float, ...], amplitudes: tuple[float, ...]
    ) -> FieldSpace:
        """Return the displacements that centres (m, 3) allow."""
        values, vectors = np.linalg.eigh(gaussian_kernel(centres, centres, widths, amplitudes))
        kept = values > _NEGLIGIBLE * values[-1]
        modes = vectors[:, kept] / np.sqrt(values[kept])
        return cls(centres=centres, modes=modes, widths=widths, amplitudes=amplitudes)

    def basis(self, points: FloatArray) -> FloatArray:
        """Return what each coefficient adds to the displacement of points, shape (q, r)."""
        kernel = gaussian_kernel(points, self.centres, self.widths, self.amplitudes)
        return np.asarray(kernel @ self.modes)

    def slopes(self, points: FloatArray) -> FloatArray:
        """Return the derivatives of the basis along each axis, shape (3, q, r)."""
        scaled = tuple(a / s for a, s in zip(self.amplitudes, self.widths, strict=True))
        kernel = gaussian_kernel(points, self.centres, self.widths, scaled)
        toward = (self.centres[:, axis] - points[:, axis, None] for axis in range(points.shape[1]))
        return np.stack([(kernel * arms) @ self.modes for arms in toward])


@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothField:
    """A displacement ``u(x)`` of a space, shape (r, 3) of its coefficients."""

    space: FieldSpace
    coefficients: FloatArray

    @property
    def bending(self) -> float:
        """How unlikely the prior finds the displacement: the squared norm of the coefficients."""
        return float((self.coefficients**2).sum())

    def moved(self, points: FloatArray) -> FloatArray:
        """Return points where the field takes them, shape (q, 3)."""
        blocks = [block + self.space.basis(block) @ self.coefficients for block in _blocks(points)]
        return np.concatenate(blocks) if blocks else np.array(points)

    def jacobian(self, slopes: FloatArray) -> FloatArray:
        """Return ``d(x + u)_i / dx_j``, shape (q, 3, 3), given the slopes of the space at points."""
        return np.asarray(np.eye(3) + np.moveaxis(slopes @ self.coefficients, 0, 2))


def gaussian_kernel(
    points: FloatArray,
    centres: FloatArray,
    widths: tuple[float, ...],
    amplitudes: tuple[float, ...],
) -> FloatArray:
    """Return the kernel of points and centres, shape (q, m)."""
    squares = (points**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * points @ centres.T
    np.maximum(squares, 0.0, out=squares)
    total = np.zeros_like(squares)
    for width, amplitude in zip(widths, amplitudes, strict=True):
        total += amplitude**2 * np.exp(squares / (-2.0 * width**2))
    return total


def _blocks(points: FloatArray) -> list[FloatArray]:
    return [points[start : start + _BLOCK] for start in range(0, len(points), _BLOCK)]


#: A deformation that shrinks volume to less than this at any of the source's points counts as folding.
MIN_VOLUME_CHANGE = 0.05
#: Factor of the noise when a field folds, and where it is given up.
_STIFFER, _MAX_STIFFNESS = 1.5, 1000.0
#: Which source vertices are pulled, by how much, and how much each counts.
_Pulls: TypeAlias = tuple[IntArray, FloatArray, FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """A source surface laid onto a target. Arrays are read-only.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3)
        The source's vertices, moved.
    residual : ndarray, shape (v,)
        Distance of each to the target's surface.
    quality : ndarray, shape (v,)
        Between 0 (no counterpart: beyond the rim, too far, or facing elsewhere) and 1.
    pose : ndarray, shape (4, 4)
        Similarity that lays the source, once it is bent, onto the target.
    missing : ndarray of bool, shape (v,)
        Vertices of parts that the target is known to lack.
    """

    vertices: Annotated[FloatArray, Holds(shape="v 3")]
    residual: Annotated[FloatArray, Holds(shape="v")]
    quality: Annotated[FloatArray, Holds(shape="v")]
    pose: Annotated[FloatArray, Holds(shape="4 4")]
    missing: Annotated[BoolArray, Holds(shape="v")]

    @property
    def unposed(self) -> FloatArray:
        """The vertices without the similarity, shape (v, 3): what is averaged differs in shape alone."""
        return moved_by(np.asarray(np.linalg.inv(self.pose), dtype=np.float64), self.vertices)


@one_blas_thread()
def register(
    target: RegistrationSurface, source: RegistrationSurface
) -> tuple[Registration, SmoothField]:
    """Deform a source onto a target that it is posed on already, and return the field that does it before the pose.

    The common poses of a collection fit a pair but roughly, above all in size. So the source is shifted and scaled,
    and in a second attempt rotated as well, by closest points; kept is the attempt from which the surface has to be
    bent less to fit as well, since closest points slide around a surface of revolution.

    The field is the posterior mean of a Gaussian process, given the closest points of both surfaces on each other
    (positions and normals compared), which are found again in every iteration while their noise is lowered.
    Correspondences on a rim, with normals that disagree, or far beyond the median distance have no say. Where an
    iteration would fold space, correspondences are trusted less from then on, until none does.

    Raises
    ------
    InputError
        If nothing on one surface corresponds to anything on the other.

    References
    ----------
    Lüthi et al. 2018 (Gaussian process registration); Feldmar and Ayache 1996 (closest points with normals); Chen and
    Medioni 1992 (offsets along normals count more than those along the surface); Tukey's biweight.
    """
    solver = _solver_of(source)
    poses = [closest_pose(target, source, may_rotate=may_rotate) for may_rotate in (False, True)]
    few = [one.with_fewer(TUNED.num_compared_points) for one in (target, source)]
    fits = [_Fit.start(few[0], few[1], solver, pose) for pose in poses]
    fits = [fit.iterated(TUNED.noise[: TUNED.num_compared]) for fit in fits]
    best = min(fits, key=lambda fit: fit.energy(TUNED.noise[TUNED.num_compared - 1]))
    every = _Fit.start(target, source, solver, best.pose)
    fit = replace(every, field=best.field, stiffness=best.stiffness)
    return fit.iterated(TUNED.noise[TUNED.num_compared :]).result(TUNED.noise[-1])


def closest_pose(
    target: RegistrationSurface, source: RegistrationSurface, *, may_rotate: bool
) -> FloatArray:
    """Return the similarity, shape (4, 4), that lays a source onto a target best by what corresponds on both."""
    few = [one.with_fewer(TUNED.num_pose_points) for one in (target, source)]
    search = _Search(few[0], few[1], tangential=1.0, cutoff=TUNED.pose_cutoff)
    pose, moved, normals = np.eye(4), source.vertices, source.normals(source.vertices)
    for noise in TUNED.pose_noise:
        rotation = pose[:3, :3] / scales_of(pose)
        at, offsets, weights = search.pulls(moved, normals @ rotation.T, noise)
        pose = fitting_similarity(
            moved[at] + offsets, source.vertices[at], weights, may_rotate=may_rotate
        )
        moved = moved_by(pose, source.vertices)
    return pose


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """How far a registration from one pose has come; the target is brought to the source by the pose's inverse."""

    search: _Search
    solver: _FieldSolver
    pose: FloatArray
    radius: float
    field: SmoothField
    stiffness: float

    @classmethod
    def start(
        cls,
        target: RegistrationSurface,
        source: RegistrationSurface,
        solver: _FieldSolver,
        pose: FloatArray,
    ) -> _Fit:
        brought = target.placed(np.asarray(np.linalg.inv(pose)))
        search = _Search(brought, source, tangential=TUNED.tangential, cutoff=TUNED.cutoff)
        return cls(
            search=search,
            solver=solver,
            pose=pose,
            radius=brought.radius,
            field=solver.still,
            stiffness=1.0,
        )

    def iterated(self, noises: Sequence[float]) -> _Fit:
        """Return the fit after an iteration per noise."""
        field, stiffness = self.field, self.stiffness
        for noise in noises:
            moved = self.solver.moved(field)
            pulls = self.search.pulls(moved, self.search.normals(moved), noise)
            field, stiffness = self.solver.fold_free(moved, pulls, noise * self.radius, stiffness)
        return replace(self, field=field, stiffness=stiffness)

    def energy(self, noise: float) -> float:
        """Return minus twice the logarithm of the posterior, but for a constant: bending, and what does not fit."""
        moved = self.solver.moved(self.field)
        _, offsets, weights = self.search.pulls(moved, self.search.normals(moved), noise)
        squares = (offsets**2).sum(axis=1) / (noise * self.radius) ** 2
        return self.field.bending + TUNED.num_independent * float(
            np.average(squares, weights=weights)
        )

    def result(self, noise: float) -> tuple[Registration, SmoothField]:
        """Bring everything back to the target."""
        moved = self.solver.moved(self.field)
        residual, quality = self.search.fit(moved, noise)
        found = Registration(
            vertices=read_only(moved_by(self.pose, moved)),
            residual=read_only(float(scales_of(self.pose)) * residual),
            quality=read_only(quality),
            pose=read_only(self.pose),
            missing=read_only(np.zeros(len(moved), dtype=bool)),
        )
        return found, self.field


class _Search:
    """Finds what corresponds: closest points in positions with normals, which shrink with the iteration's noise."""

    def __init__(
        self,
        target: RegistrationSurface,
        source: RegistrationSurface,
        *,
        tangential: float,
        cutoff: float,
    ) -> None:
        self._target, self._source, self._tangential, self._cutoff = (
            target,
            source,
            tangential,
            cutoff,
        )
        self._has_normals = target.oriented and source.oriented
        self._target_normals = target.normals(target.vertices)
        self._noise, self._known = float("nan"), (target.vertices, _tree(target.vertices[:0]))

    def normals(self, moved: FloatArray) -> FloatArray:
        """Return the normals of the source with its vertices elsewhere, shape (v, 3)."""
        return self._source.normals(moved)

    def pulls(self, moved: FloatArray, normals: FloatArray, noise: float) -> _Pulls:
        """Return the closest points of both surfaces on each other as offsets of source vertices."""
        target, source = self._target, self._source
        ours, (theirs, tree) = self._features(moved, normals, noise), self._target_tree(noise)
        hit = tree.query(ours[source.spread])[1]
        struck = _tree(ours).query(theirs[target.spread])[1]
        at, to = np.concatenate([source.spread, struck]), np.concatenate([hit, target.spread])
        weights = self._trust(moved, normals, at, to, noise)
        weights *= ~np.concatenate([target.on_rim[hit], source.on_rim[struck]])
        kept = weights > 0
        if not kept.any():
            raise InputError(
                "registration: no point of one surface has a counterpart on the other at these poses"
            )
        at, to = at[kept], to[kept]
        offsets = target.vertices[to] - moved[at]
        if self._has_normals:
            along = (offsets * self._target_normals[to]).sum(
                axis=1, keepdims=True
            ) * self._target_normals[to]
            offsets = along + self._tangential * (offsets - along)
        return at, offsets, weights[kept]

    def fit(self, moved: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
        """Return the distance of every moved vertex to the target, and how well it corresponds to anything there."""
        target, normals = self._target, self.normals(moved)
        places = target.locator.closest(moved).on(target.vertices)
        hit = self._target_tree(noise)[1].query(self._features(moved, normals, noise))[1]
        quality = (
            self._trust(moved, normals, np.arange(len(moved)), hit, noise) * ~target.on_rim[hit]
        )
        return np.asarray(np.linalg.norm(places - moved, axis=1)), np.asarray(quality)

    def _target_tree(self, noise: float) -> tuple[FloatArray, scipy.spatial.cKDTree]:
        """Return the features of the target, and a tree of them; those of the last noise are kept."""
        if noise != self._noise:
            features = self._features(self._target.vertices, self._target_normals, noise)
            self._noise, self._known = noise, (features, _tree(features))
        return self._known

    def _features(self, vertices: FloatArray, normals: FloatArray, noise: float) -> FloatArray:
        """Return positions joined with scaled normals: their Euclidean distance is what "closest" means."""
        scale = self._target.radius * noise / TUNED.normal_noise if self._has_normals else 0.0
        return np.hstack([vertices, scale * normals])

    def _trust(
        self, moved: FloatArray, normals: FloatArray, at: IntArray, to: IntArray, noise: float
    ) -> FloatArray:
        """Tukey's biweight of each correspondence's distance, zero where normals disagree.

        Where almost everything fits, the noise is the scale: what differs in one place is not an error for that.
        """
        distances = np.linalg.norm(self._target.vertices[to] - moved[at], axis=1)
        scale = self._cutoff * max(float(np.median(distances)), noise * self._target.radius)
        weights = np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2
        if self._has_normals:
            weights *= (normals[at] * self._target_normals[to]).sum(axis=1) > TUNED.min_cosine
        return np.asarray(weights)


def _tree(points: FloatArray) -> scipy.spatial.cKDTree:
    """Return a tree that is built in a third of the usual time, for few queries."""
    return scipy.spatial.cKDTree(points, balanced_tree=False, compact_nodes=False)


@lru_cache(maxsize=1)
def _solver_of(source: RegistrationSurface) -> _FieldSolver:
    """Return the solver of a source; the one before is kept, since one source is registered to many targets."""
    return _FieldSolver(source)


class _FieldSolver:
    """Finds the field that correspondences ask for."""

    def __init__(self, source: RegistrationSurface) -> None:
        space = FieldSpace.at(
            source.vertices[source.spread[: TUNED.num_centres]],
            tuple(source.radius * width for width in TUNED.widths),
            tuple(source.radius * amplitude for amplitude in TUNED.amplitudes),
        )
        self.still = SmoothField(space=space, coefficients=np.zeros((space.modes.shape[1], 3)))
        self._source, self._basis = source.vertices, space.basis(source.vertices)
        self._slopes = space.slopes(source.vertices[source.spread])

    def moved(self, field: SmoothField) -> FloatArray:
        """Return the source's vertices where a field takes them."""
        return np.asarray(self._source + self._basis @ field.coefficients)

    def fold_free(
        self, moved: FloatArray, pulls: _Pulls, noise: float, stiffness: float
    ) -> tuple[SmoothField, float]:
        """Return the field at the least stiffness, from the given one on, that folds nothing, and that stiffness.

        Coefficients ``w`` are of least ``sum_i t_i |B_i w - y_i|^2 / s^2 + |w|^2``, with the noise ``s`` multiplied
        by the stiffness. A field that cannot be made to unfold stays still.
        """
        at, offsets, weights = pulls
        total = np.bincount(at, weights=weights, minlength=len(moved))
        pulled = np.flatnonzero(total)
        summed = [np.bincount(at, weights=weights * one, minlength=len(moved)) for one in offsets.T]
        toward = np.column_stack(summed) + total[:, None] * (moved - self._source)
        root = np.sqrt(total[pulled])[:, None]
        rows = self._basis[pulled]
        rows *= root
        right_side = rows.T @ (toward[pulled] / root)
        # the lower triangle, which is all that the factorization reads, in half the time
        data = scipy.linalg.blas.dsyrk(1.0, rows.T, lower=True)
        diagonal, per_point = np.diag_indices_from(data), len(at) / TUNED.num_independent
        while stiffness <= _MAX_STIFFNESS:
            system = data.copy()
            system[diagonal] += (stiffness * noise) ** 2 * per_point
            found = scipy.linalg.cho_solve(scipy.linalg.cho_factor(system, lower=True), right_side)
            field = replace(self.still, coefficients=found)
            if np.linalg.det(field.jacobian(self._slopes)).min() >= MIN_VOLUME_CHANGE:
                return field, stiffness
            stiffness *= _STIFFER
        return self.still, stiffness
