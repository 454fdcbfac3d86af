"""Surfaces as maps see them: eigenfunctions, descriptors, and what the outside adds to the inside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy

from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.tips import Tips, find_tips
from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.embedding.invariants import NUM_SPECTRUM, wave_kernel_signature
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.notes import Note
from data_tools.options import SamplingOptions
from data_tools.surface.cleaning import clean
from data_tools.surface.closest import SurfacePoints
from data_tools.surface.laplacian import Spectrum, SurfaceOperators, factor_symmetric
from data_tools.surface.shape import MAX_DEFECTS, Shape, orientation_defects, vertex_normals
from data_tools.surface.topology import face_areas
from data_tools.threads import one_blas_thread

#: Lowest functions of the target whose orientation is compared; the source needs more to represent them.
NUM_FORM_FUNCTIONS = 6


def outward(shape: Shape) -> Shape:
    """Return the mesh with its triangles, made to agree, counterclockwise from outside by the sign of its volume."""
    if orientation_defects(shape) > MAX_DEFECTS:
        import trimesh

        mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        trimesh.repair.fix_winding(mesh)
        shape = replace(shape, faces=read_only(np.array(mesh.faces, dtype=np.int64)))
    if signed_volume(shape) >= 0:
        return shape
    return replace(shape, faces=read_only(np.ascontiguousarray(shape.faces[:, ::-1])))


def signed_volume(shape: Shape) -> float:
    """Return the volume inside a mesh (of an open one, of the cone from its centroid); negative if inside out."""
    a, b, c = (shape.vertices[shape.faces[:, i]] - shape.vertices.mean(axis=0) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def smoothed_curvature(shape: Shape, operators: SurfaceOperators, *, time: float) -> FloatArray:
    """Return the mean curvature of the smoothed surface, times sqrt(area), shape (v,); positive where convex.

    Positions take two implicit steps of the heat flow (Desbrun et al. 1999), half the normal part of their Laplacian
    takes a third one; so the triangulation hardly matters. Values beyond the central 98 % are clipped: they belong to
    single sharp vertices.

    Parameters
    ----------
    shape : Shape
        A mesh with outward normals.
    operators : SurfaceOperators
        Of the shape.
    time : float
        Step of the flow at unit area: features larger than about sqrt(time) survive.
    """
    mass = scipy.sparse.diags_array(operators.mass).tocsc()
    step = factor_symmetric((mass + (time * shape.area) * operators.stiffness).tocsc())
    positions = shape.vertices
    for _ in range(2):
        positions = step.solve(mass @ positions)
    bending = ((operators.stiffness @ positions) * vertex_normals(shape.vertices, shape.faces)).sum(
        axis=1
    )
    curvature = 0.5 * np.sqrt(shape.area) * step.solve(bending)
    return np.clip(curvature, *np.quantile(curvature, [0.01, 0.99]))


def orientation_form(shape: Shape, functions: FloatArray) -> FloatArray:
    """Return n . (grad f_a x grad f_b), times the area, at every vertex for all pairs of functions, shape (v, m, m).

    Antisymmetric in (a, b). A map that preserves orientation pulls the form of one shape back to that of the other,
    a mirrored map to its negative (Ren et al. 2018 use the same form as an operator).

    Parameters
    ----------
    shape : Shape
        A mesh with outward normals.
    functions : ndarray, shape (v, m)
        A few smooth functions.
    """
    values = functions[shape.faces]
    along, across = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    wedge = along[:, :, None] * across[:, None, :]
    wedge = wedge - np.swapaxes(wedge, 1, 2)
    around = _around(shape)
    doubled_areas = around @ (2.0 * face_areas(shape.vertices, shape.faces))
    sums = (around @ wedge.reshape(len(wedge), -1)).reshape(-1, *wedge.shape[1:])
    return sums * (shape.area / np.where(doubled_areas > 0, doubled_areas, 1.0))[:, None, None]


def _around(shape: Shape) -> scipy.sparse.csr_array:
    """Return the (v, f) matrix that sums over the triangles around each vertex."""
    num_faces = len(shape.faces)
    columns = np.repeat(np.arange(num_faces), 3)
    entries = (np.ones(3 * num_faces), (shape.faces.ravel(), columns))
    return scipy.sparse.coo_array(entries, shape=(len(shape.vertices), num_faces)).tocsr()


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
    tips : Tips
        Ends of limbs; a point cloud has none.
    notes : tuple of Note
        What a user should know about the preparation.
    """

    name: str
    vertices: Annotated[FloatArray, Holds(shape="w 3")]
    faces: Annotated[IntArray, Holds(shape="_ 3")]
    to_working: Annotated[IntArray, Holds(shape="_", lower=-1)]
    to_original: Annotated[IntArray, Holds(shape="w")]
    in_file: Annotated[IntArray, Holds(shape="p")]
    points: Annotated[FloatArray, Holds(shape="p 3")]
    places: SurfacePoints
    area: Annotated[float, Holds(positive=True)]
    eigenvalues: Annotated[FloatArray, Holds(shape="m")]
    functions: Annotated[FloatArray, Holds(shape="w m")]
    mass: Annotated[FloatArray, Holds(shape="w")]
    agd: Annotated[FloatArray, Holds(shape="w")]
    waves: Annotated[FloatArray, Holds(shape="w _")]
    curvature: Annotated[FloatArray, Holds(shape="w _", nan=True)]
    samples: Annotated[IntArray, Holds(shape="_")]
    dense: Annotated[IntArray, Holds(shape="s")]
    orientation: Annotated[FloatArray, Holds(shape="s _ _", nan=True)]
    tips: Tips
    notes: tuple[Note, ...]

    @property
    def basis(self) -> FloatArray:
        """The constant function and the eigenfunctions, shape (w, m + 1)."""
        return np.column_stack([np.ones(len(self.functions)), self.functions])

    @property
    def nearest_dense(self) -> IntArray:
        """Position in ``dense`` of the sample nearest to each working vertex, shape (w,)."""
        return np.asarray(scipy.spatial.cKDTree(self.vertices[self.dense]).query(self.vertices)[1])

    @property
    def working_shape(self) -> Shape:
        """The working surface as a shape."""
        return Shape.from_arrays(self.vertices, self.faces, name=self.name)

    @property
    def mirrored(self) -> SpectralShape:
        """The mirror image of a mesh, its triangles outward."""
        flip = np.array([-1.0, 1.0, 1.0])
        return replace(
            self,
            vertices=self.vertices * flip,
            faces=self.faces[:, ::-1],
            points=self.points * flip,
            orientation=-self.orientation,
        )

    def coarse(self, num_dense: int, num_functions: int) -> SpectralShape:
        """Return the shape with its first dense samples, which are spread evenly, and its lowest functions alone."""
        return replace(
            self,
            dense=self.dense[:num_dense],
            orientation=self.orientation[:num_dense],
            eigenvalues=self.eigenvalues[:num_functions],
            functions=self.functions[:, :num_functions],
        )


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
    lowest = Spectrum(
        eigen.values[:NUM_SPECTRUM], eigen.functions[:, :NUM_SPECTRUM], eigen.mass, eigen.kind
    )
    samples = farthest_points(
        working, options.num_samples, seeds=surface.seeds(NUM_SEEDS), solver=surface.geodesics
    )
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
        tips=find_tips(working, surface.agd, surface.area) if working.is_mesh else Tips.none(),
        notes=(*notes, *surface.notes),
    )


def _matched_part(shape: Shape) -> tuple[Shape, IntArray, tuple[Note, ...]]:
    """Return the component of the largest area, the shape's vertices that lie at its vertices, and notes."""
    part = clean(shape)
    kept = np.flatnonzero(scipy.spatial.cKDTree(part.vertices).query(shape.vertices)[0] == 0.0)
    total = shape.file_size or len(shape.vertices)
    num = total - len(kept)
    lost = (Note("outside-component", values={"num": num, "total": total}),) if num else ()
    return part, kept, part.notes + lost


def _places(points: FloatArray, vertices: FloatArray) -> SurfacePoints:
    """Return the places closest to points on the triangles of the three vertices nearest to each."""
    from data_tools.surface.triangle_tree import closest_on_triangles

    corners = scipy.spatial.cKDTree(vertices).query(points, 3)[1]
    return SurfacePoints(corners=corners, weights=closest_on_triangles(points, vertices[corners]))


def _outside(
    surface: WorkingSurface, working: Shape, eigen: Spectrum, dense: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return curvatures and the orientation form at the dense samples; NaN where there are no normals."""
    num = min(NUM_ORIENTATION, len(eigen.values))
    if not working.is_mesh:
        no_curvature = np.full((len(working.vertices), len(CURVATURE_TIMES)), np.nan)
        return no_curvature, np.full((len(dense), num, num), np.nan)
    operators = surface.operators
    curvature = np.column_stack(
        [smoothed_curvature(working, operators, time=t) for t in CURVATURE_TIMES]
    )
    return curvature, orientation_form(working, eigen.functions[:, :num])[dense]
