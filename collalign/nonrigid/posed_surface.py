"""Surfaces at few dense samples, with what maps that start from poses need of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from collalign.nonrigid.spectral_shape import (
    CURVATURE_TIMES,
    NUM_ORIENTATION,
    SpectralShape,
    orientation_form,
    outward,
    smoothed_curvature,
)
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.invariants import heat_kernel_signature, standardised
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.options import SamplingOptions
from data_tools.surface.closest import SurfacePoints
from data_tools.surface.laplacian import Spectrum
from data_tools.surface.normals import vertex_normals
from data_tools.surface.shape import Shape

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
        raise InputError(f"{shape.file or shape.name}: {len(working.vertices)} vertices, {NUM_POINTS} are needed")
    dense = surface.farthest_points(NUM_POINTS, "euclidean", seeded=False)
    eigen = surface.eigenfunctions(NUM_FUNCTIONS)
    operators = surface.operators
    curvature = np.column_stack([smoothed_curvature(working, operators, time=t) for t in CURVATURE_TIMES])
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
    kept: dict[str, Any] = {name: read_only(v) if isinstance(v, np.ndarray) else v for name, v in known.items()}
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


def _at(shape: SpectralShape, rows: IntArray | slice, orientation: FloatArray, num_functions: int) -> SpectralShape:
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
