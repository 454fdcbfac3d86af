"""One shape prepared for non-rigid matching: eigenfunctions, samples, descriptors; everything pairs share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.surface.geometry import orientation_form, outward, smoothed_curvature
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.invariants import NUM_SPECTRUM, wave_kernel_signature
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.notes import Note
from data_tools.options import SamplingOptions
from data_tools.surface.cleaning import clean
from data_tools.surface.closest import SurfacePoints, closest_on_triangles
from data_tools.surface.laplacian import Spectrum
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Energies of the wave kernel signature.
NUM_WAVES = 40
#: Local maxima of the average geodesic distance, at most, that start the samples.
NUM_SEEDS = 10
#: Low functions whose orientation form is kept.
NUM_ORIENTATION = 12
#: Heat times of the curvature that is compared, at unit area.
CURVATURE_TIMES = (0.0001, 0.0003)


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralShape:
    """A shape prepared for non-rigid matching.

    Attributes
    ----------
    name : str
    vertices, faces : ndarray, shapes (w, 3) and (f, 3)
        The working surface, in the units of the file: the largest component, decimated if it was large.
    to_working : ndarray of int, shape (v,)
        For each vertex of the file the vertex of the working surface that stands for it, -1 for none.
    to_original : ndarray of int, shape (w,)
        For each vertex of the working surface its vertex of the file.
    in_file, points : ndarray, shapes (p,) and (p, 3)
        The vertices of the file that the working surface stands for, ascending, and where they are.
    places : SurfacePoints
        Of these on the working surface, about.
    area : float
        In squared units of the file.
    eigenvalues : ndarray, shape (m,)
        Of the surface scaled to unit area, without the constant one.
    functions : ndarray, shape (w, m)
        Orthonormal in ``mass``.
    mass : ndarray, shape (w,)
        Sums to one.
    agd : ndarray, shape (w,)
        Average geodesic distance over sqrt(area).
    waves : ndarray, shape (w, e)
        Wave kernel signature.
    curvature : ndarray, shape (w, t)
        Smoothed mean curvatures; NaN for a point cloud.
    samples, dense : ndarray of int
        Working vertices: geodesic farthest points in order, and Euclidean farthest points.
    orientation : ndarray, shape (len(dense), q, q)
        Orientation form of the lowest functions; NaN for a point cloud.
    notes : tuple of Note
        What a user should know about the preparation.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    to_working: IntArray
    to_original: IntArray
    in_file: IntArray
    points: FloatArray
    places: SurfacePoints
    area: float
    eigenvalues: FloatArray
    functions: FloatArray
    mass: FloatArray
    agd: FloatArray
    waves: FloatArray
    curvature: FloatArray
    samples: IntArray
    dense: IntArray
    orientation: FloatArray
    notes: tuple[Note, ...]

    @property
    def basis(self) -> FloatArray:
        """The constant function and the eigenfunctions, shape (w, m + 1)."""
        return np.column_stack([np.ones(len(self.functions)), self.functions])

    @property
    def nearest_dense(self) -> IntArray:
        """Position in ``dense`` of the sample nearest to each working vertex, shape (w,)."""
        return np.asarray(cKDTree(self.vertices[self.dense]).query(self.vertices)[1])

    @property
    def working_shape(self) -> Shape:
        """The working surface as a shape."""
        return Shape.from_arrays(self.vertices, self.faces, name=self.name)


@one_blas_thread()
def prepare_surface(shape: Shape, options: SurfaceOptions | None = None) -> SpectralShape:
    """Prepare a shape for non-rigid matching.

    Parameters
    ----------
    shape : Shape
        A mesh or point cloud as stored: several components, isolated vertices, holes and non-manifold edges are
        allowed, and vertices may be repeated; the largest component is used.
    options : SurfaceOptions, optional

    Raises
    ------
    InputError
        If the largest component has too few vertices for the functions or samples asked for.
    """
    options = options or SurfaceOptions()
    part, kept, notes = _matched_part(shape)
    surface = WorkingSurface(part, SamplingOptions(max_faces=options.max_faces))
    working = outward(surface.shape) if surface.shape.is_mesh else surface.shape
    num = len(working.vertices)
    if num < options.num_functions + 2 or num < options.num_samples:
        raise InputError(
            f"{shape.file or shape.name}: its largest part has {num} vertices; {options.num_functions} functions and "
            f"{options.num_samples} samples need more: refine the mesh, or lower num_functions and num_samples"
        )
    dense = farthest_points(working, min(options.num_dense, num), metric="euclidean")
    eigen = surface.eigenfunctions(options.num_functions)
    lowest = Spectrum(eigen.values[:NUM_SPECTRUM], eigen.functions[:, :NUM_SPECTRUM], eigen.mass, eigen.kind)
    samples = farthest_points(working, options.num_samples, seeds=surface.seeds(NUM_SEEDS), solver=surface.geodesics)
    in_file = shape.file_indices
    places = _places(shape.vertices[kept], working.vertices)
    to_working = np.full(shape.file_size or len(shape.vertices), -1)
    to_working[in_file[kept]] = places.nearest
    curvature, orientation = _outside(surface, working, eigen, dense)
    return SpectralShape(
        name=shape.name,
        vertices=working.vertices,
        faces=working.faces,
        to_working=read_only(to_working),
        to_original=read_only(part.file_indices[surface.to_original]),
        in_file=read_only(in_file[kept]),
        points=shape.vertices[kept],
        places=places,
        area=surface.area,
        eigenvalues=eigen.values,
        functions=eigen.functions,
        mass=eigen.mass,
        agd=read_only(surface.agd),
        waves=read_only(wave_kernel_signature(lowest, NUM_WAVES)),
        curvature=read_only(curvature),
        samples=samples,
        dense=dense,
        orientation=read_only(orientation),
        notes=(*notes, *surface.notes),
    )


def _matched_part(shape: Shape) -> tuple[Shape, IntArray, tuple[Note, ...]]:
    """Return the component of the largest area, the shape's vertices that lie at its vertices, and notes."""
    part = clean(shape)
    kept = np.flatnonzero(cKDTree(part.vertices).query(shape.vertices)[0] == 0.0)
    total = shape.file_size or len(shape.vertices)
    num = total - len(kept)
    lost = (Note("outside-component", values={"num": num, "total": total}),) if num else ()
    return part, kept, part.notes + lost


def _places(points: FloatArray, vertices: FloatArray) -> SurfacePoints:
    """Return the places closest to points on the triangles of the three vertices nearest to each."""
    corners = cKDTree(vertices).query(points, 3)[1]
    return SurfacePoints(corners=corners, weights=closest_on_triangles(points, vertices[corners]))


def _outside(
    surface: WorkingSurface, working: Shape, eigen: Spectrum, dense: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return curvatures and the orientation form at the dense samples; NaN where there are no normals."""
    num = min(NUM_ORIENTATION, len(eigen.values))
    if not working.is_mesh:
        return np.full((len(working.vertices), len(CURVATURE_TIMES)), np.nan), np.full((len(dense), num, num), np.nan)
    operators = surface.operators
    curvature = np.column_stack([smoothed_curvature(working, operators, time=t) for t in CURVATURE_TIMES])
    return curvature, orientation_form(working, eigen.functions[:, :num])[dense]
