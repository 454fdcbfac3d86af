"""Maps that start from poses, or from signs of eigenfunctions: then a few steps of ZoomOut on few samples.

A non-rigid match searches for the map from inside the surfaces alone and takes seconds; from a pose it takes
milliseconds. The map then says where the pose should be (the rotation that Procrustes takes from it) and whether the
pose was a good idea (the evidence of :mod:`collalign.nonrigid.map_evidence`): a pose that puts the back on the front
leads to a map that is torn, or that does not keep left and right. Where a limb is where another shape has its other
one, closest points exchange them at every pose; there the signs of the lowest eigenfunctions start from within.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy

from collalign.confidence.map_model import Evidence
from collalign.nonrigid.functional_map import FunctionalMap, TargetRows
from collalign.nonrigid.map_evidence import measure_evidence
from collalign.nonrigid.refine import Refiner, unit_rows
from collalign.nonrigid.spectral_shape import (
    CURVATURE_TIMES,
    NUM_ORIENTATION,
    SpectralShape,
    orientation_form,
    outward,
    smoothed_curvature,
)
from collalign.nonrigid.tips import Tips
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.invariants import heat_kernel_signature, standardised
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.options import SamplingOptions
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.closest import SurfacePoints
from data_tools.surface.laplacian import Spectrum
from data_tools.surface.shape import Shape, vertex_normals

#: Triangles, points and eigenfunctions of a prepared surface: few enough that a map takes a few milliseconds.
MAX_FACES, NUM_POINTS, NUM_FUNCTIONS = 6000, 200, 39


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedSurface:
    """What maps from poses need of a shape, at its dense samples alone.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Dense samples, centred, of root mean square radius 1, in the orientation of the file.
    normals : ndarray, shape (n, 3)
        Outward.
    descriptors : ndarray, shape (n, m)
        Heat kernel signature and average geodesic distance, standardised.
    spectral : SpectralShape
        Its vertices are the dense samples; no triangles or descriptors.
    """

    points: FloatArray
    normals: FloatArray
    descriptors: FloatArray
    spectral: SpectralShape


def prepare_posed(shape: Shape) -> PosedSurface:
    """Prepare a mesh for maps that start from poses.

    Raises
    ------
    InputError
        If the shape is no mesh, or its surface has too few vertices.
    """
    if not shape.is_mesh:
        raise InputError(f"{shape.file or shape.name}: maps from poses need a mesh")
    surface = WorkingSurface(shape, SamplingOptions(max_faces=MAX_FACES))
    working = outward(surface.shape)
    if len(working.vertices) < NUM_POINTS:
        raise InputError(
            f"{shape.file or shape.name}: {len(working.vertices)} vertices, {NUM_POINTS} are needed"
        )
    dense = surface.farthest_points(NUM_POINTS, "euclidean", seeded=False)
    eigen = surface.eigenfunctions(NUM_FUNCTIONS)
    operators = surface.operators
    curvature = np.column_stack(
        [smoothed_curvature(working, operators, time=t) for t in CURVATURE_TIMES]
    )
    spectral = spectral_samples(
        name=shape.name,
        vertices=working.vertices[dense],
        area=surface.area,
        eigenvalues=eigen.values,
        functions=eigen.functions[dense],
        mass=eigen.mass[dense] / eigen.mass[dense].sum(),
        agd=surface.agd[dense] / surface.area**0.5,
        curvature=curvature[dense],
        orientation=orientation_form(working, eigen.functions[:, :NUM_ORIENTATION])[dense],
    )
    return posed_surface(spectral, vertex_normals(working.vertices, working.faces)[dense])


def spectral_samples(**known: Any) -> SpectralShape:
    """Return a prepared shape that is known at its dense samples only.

    Parameters
    ----------
    **known
        The other fields of :class:`SpectralShape` that samples have; arrays have one row for each.
    """
    num = len(known["vertices"])
    nothing, none = read_only(np.empty((num, 0))), read_only(np.empty(0, dtype=np.int64))
    kept: dict[str, Any] = {
        name: read_only(v) if isinstance(v, np.ndarray) else v for name, v in known.items()
    }
    return SpectralShape(
        faces=read_only(np.empty((0, 3), dtype=np.int64)),
        to_working=none,
        to_original=none,
        in_file=none,
        points=read_only(np.empty((0, 3))),
        places=SurfacePoints(corners=none.reshape(0, 3), weights=np.empty((0, 3))),
        waves=nothing,
        samples=none,
        dense=read_only(np.arange(num)),
        tips=Tips.none(),
        notes=(),
        **kept,
    )


def posed_surface(spectral: SpectralShape, normals: FloatArray) -> PosedSurface:
    """Return the surface with its samples centred and scaled, given the normals of its vertices (v, 3)."""
    centred = spectral.vertices - spectral.vertices.mean(axis=0)
    points = centred / np.sqrt((centred**2).sum(axis=1).mean())
    eigen = Spectrum(spectral.eigenvalues, spectral.functions, spectral.mass, "cotangent")
    everything, unit = np.arange(len(points)), np.sqrt(len(points))
    heat = standardised(heat_kernel_signature(eigen), everything)
    distance = standardised(spectral.agd[:, None], everything)
    return PosedSurface(
        points=read_only(points),
        normals=read_only(normals),
        descriptors=read_only(unit * np.hstack([heat, distance])),
        spectral=spectral,
    )


def first_samples(surface: PosedSurface, num_points: int, num_functions: int) -> PosedSurface:
    """Return the surface at its first samples, which are spread evenly, with its lowest functions alone."""
    whole, first = surface.spectral, slice(num_points)
    few = _at(whole, first, whole.orientation[first], num_functions)
    return posed_surface(few, surface.normals[first])


def sampled_surface(shape: SpectralShape) -> PosedSurface:
    """Return a shape that is prepared in full, at its dense samples; it must have triangles."""
    sampled = _at(shape, shape.dense, shape.orientation, len(shape.eigenvalues))
    return posed_surface(sampled, vertex_normals(shape.vertices, shape.faces)[shape.dense])


def _at(
    shape: SpectralShape, rows: IntArray | slice, orientation: FloatArray, num_functions: int
) -> SpectralShape:
    """Return a shape at some of its vertices, with its lowest functions alone."""
    return spectral_samples(
        name=shape.name,
        vertices=shape.vertices[rows],
        area=shape.area,
        eigenvalues=shape.eigenvalues[:num_functions],
        functions=shape.functions[rows][:, :num_functions],
        mass=shape.mass[rows] / shape.mass[rows].sum(),
        agd=shape.agd[rows],
        curvature=shape.curvature[rows],
        orientation=orientation,
    )


#: Functions, the constant one included, that ZoomOut starts with, and how fast their number grows.
FIRST_SIZE, GROWTH = 10, 1.5
#: Weights of unit normals, and of the descriptors (each kind of unit variance), in the closest points of a start.
#: Positions have root mean square radius 1. Measured on 30 pairs of armadillos.
START_NORMAL_WEIGHT, START_DESCRIPTOR_WEIGHT = 0.3, 0.6
#: Weight of unit normals relative to positions of root mean square radius 1 where surfaces are compared.
SURFACE_NORMAL_WEIGHT = 0.5
#: Lowest functions whose signs are enumerated, and how many of the maps that they give are refined: 50 ms a pair. Two
#: of 20 of SHREC07's armadillos, whose other candidates all exchange two limbs, come right by them (``python -m
#: experiments bending``).
NUM_SIGNS, NUM_SIGN_MAPS = 6, 24


def axis_poses(target: PosedSurface, source: PosedSurface, *, mirrored: bool) -> FloatArray:
    """Return the rotations that bring the source's principal axes onto the target's in every order, shape (m, 3, 3).

    24 rotations, and with ``mirrored`` 24 reflections as well: crude poses, but evenly spread, and the same for
    shapes in any pose.
    """
    rotations = scipy.spatial.transform.Rotation.create_group("O").as_matrix()
    if mirrored:
        rotations = np.concatenate([rotations, -rotations])
    return np.asarray(_principal_axes(target.points) @ rotations @ _principal_axes(source.points).T)


def _principal_axes(points: FloatArray) -> FloatArray:
    axes = np.linalg.svd(points, full_matrices=False)[2].T.copy()
    axes[:, 2] *= np.linalg.det(axes)
    return axes


class PoseMapper:
    """Maps between two surfaces from any number of poses."""

    def __init__(self, target: PosedSurface, source: PosedSurface) -> None:
        self.target, self.source = target, source
        self._refiner = Refiner(target.spectral, source.spectral, first=FIRST_SIZE, factor=GROWTH)
        self._starts = TargetRows(_start_features(target, np.eye(3)))
        self._facing = np.hstack([target.points, SURFACE_NORMAL_WEIGHT * target.normals])
        self._near = TargetRows(self._facing)

    def map_from(self, R_target_source: FloatArray) -> FunctionalMap:
        """Return the map that closest points at a pose (3, 3), of either determinant, lead to."""
        return self._refiner.zoomout.refine(*self.closest_points(R_target_source))

    def closest_points(self, R_target_source: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the maps of the samples, (k,) and (n,), by closest points at a pose (3, 3)."""
        return self._starts.mutual(_start_features(self.source, R_target_source))

    def maps_from_signs(self, num: int = NUM_SIGN_MAPS) -> list[FunctionalMap]:
        """Return the maps that signs of the lowest eigenfunctions lead to, those that fit best at the start.

        Eigenfunctions of near-isometric surfaces agree up to sign where their eigenvalues are simple; the descriptors
        steady those that are not. No pose takes part.
        """
        target, source = (
            np.hstack(
                [
                    unit_rows(one.spectral.functions[:, :NUM_SIGNS]),
                    START_DESCRIPTOR_WEIGHT * one.descriptors,
                ]
            )
            for one in (self.target, self.source)
        )
        unsigned, signed = (
            scipy.spatial.distance.cdist(target, source, "sqeuclidean"),
            4.0 * target[:, :NUM_SIGNS],
        )

        def gaps_of(flips: tuple[float, ...]) -> FloatArray:
            # |t + s|^2 = |t - s|^2 + 4 t s
            return np.asarray(unsigned + (signed * flips) @ source[:, :NUM_SIGNS].T)

        def loss_of(flips: tuple[float, ...]) -> float:
            gaps = gaps_of(flips)
            return float(gaps.min(axis=0).mean() + gaps.min(axis=1).mean())

        best = sorted(product((0.0, 1.0), repeat=NUM_SIGNS), key=loss_of)[:num]
        return [
            self._refiner.zoomout.refine(gaps.argmin(axis=0), gaps.argmin(axis=1))
            for gaps in map(gaps_of, best)
        ]

    def oriented(self, found: FunctionalMap, *, preserving: bool) -> FunctionalMap:
        """Return the map that keeps the orientation of the surfaces, or reverses it, which a map leads to."""
        return self._refiner.oriented(found.C_source_target, preserving=preserving)

    def evidence(self, found: FunctionalMap) -> Evidence:
        """Return the evidence for a map."""
        return measure_evidence(self.target.spectral, self.source.spectral, found)

    def surface_gap(self, R_target_source: FloatArray) -> float:
        """Return the mean squared distance of closest points and normals at a pose (3, 3), both ways."""
        rotation, source, fixed = R_target_source.T, self.source, self._facing
        moved = np.hstack(
            [source.points @ rotation, SURFACE_NORMAL_WEIGHT * source.normals @ rotation]
        )
        there, back = self._near.mutual(moved)
        gaps = np.concatenate([fixed[there] - moved, fixed - moved[back]])
        return float((gaps**2).sum(axis=1).mean())

    def rotation_of(self, found: FunctionalMap, *, chirality: float) -> FloatArray:
        """Return the orthogonal matrix (3, 3) of determinant ``chirality`` that fits a map and its inverse best."""
        to = np.vstack([self.target.points[found.map_target_source], self.target.points])
        of = np.vstack([self.source.points, self.source.points[found.map_source_target]])
        return nearest_orthogonal(
            (to - to.mean(axis=0)).T @ (of - of.mean(axis=0)), determinant=chirality
        )

    def normal_gap(self, found: FunctionalMap, R_target_source: FloatArray) -> float:
        """Return the mean of 1 - cosine of the normals that a map and its inverse match, at a pose (3, 3)."""
        forward, backward = found.map_target_source, found.map_source_target
        target, source = self.target.normals, self.source.normals @ R_target_source.T
        cosines = np.concatenate([target[forward] * source, target * source[backward]]).sum(axis=1)
        return float(1.0 - cosines.mean())


def _start_features(surface: PosedSurface, rotation: FloatArray) -> FloatArray:
    """Return what closest points compare at the start, shape (n, 6 + m)."""
    normals = START_NORMAL_WEIGHT * surface.normals @ rotation.T
    return np.hstack(
        [surface.points @ rotation.T, normals, START_DESCRIPTOR_WEIGHT * surface.descriptors]
    )
