"""The surface that preprocessing works on: at most so many triangles, with everything computed once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.invariants import boundary_distance
from data_tools.embedding.sampling import farthest_points
from data_tools.notes import Note
from data_tools.options import CleaningOptions, SamplingOptions
from data_tools.sight import lines_that_saw
from data_tools.surface.cleaning import clean, decimate
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.geodesics import (
    AGD_SOURCES,
    GeodesicSolver,
    agd_maxima,
    average_geodesic_distance,
)
from data_tools.surface.joined import cell_size, joined_surface
from data_tools.surface.laplacian import (
    NUM_CLOUD_NEIGHBOURS,
    Spectrum,
    SurfaceOperators,
    spectrum,
    surface_operators,
    vertex_areas,
)
from data_tools.surface.shape import MAX_DEFECTS, Shape, outward_normals
from data_tools.surface.topology import (
    face_areas,
    is_open_surface,
    mesh_components,
)

#: Larger point clouds are thinned to this many points; samples stay points of the original.
MOST_CLOUD_POINTS = 6_000
#: A decimated mesh has at least four vertices for each sample to choose from.
FACES_PER_SAMPLE = 8
#: Vertices of components are not inside if they are no farther than this from the surface around all, in its cells.
OUTSIDE_CELLS = 1.5
#: No two seeds are nearer than this, times the square root of the area.
SEED_SPACING = 0.2


class WorkingSurface:
    """A clean, possibly decimated copy of a shape, its geodesics and its spectrum.

    Parameters
    ----------
    shape : Shape
        Any mesh or point cloud.
    options : SamplingOptions
        Says from which size on the copy is decimated.
    joined : bool
        Whether the copy is the surface around all components of a mesh, where there are several. Views from one side
        stay as they are.
    split : bool
        Whether the triangles of a mesh of fewer vertices than samples are split, so that samples lie between these.

    Attributes
    ----------
    shape : Shape
        The copy.
    to_original : ndarray of int, shape (w,)
        The vertex of the given shape nearest to each vertex of the copy.
    notes : tuple of Note
        What differs from the given shape, and which operators were used so far.
    is_joined : bool
        Whether it is the surface around all components.
    is_split : bool
        Whether triangles were split.
    lies_between : bool
        Whether vertices of the copy lie between those of the given shape.
    """

    def __init__(
        self, shape: Shape, options: SamplingOptions, *, joined: bool = False, split: bool = False
    ) -> None:
        self._given = shape
        self.is_joined = joined and _is_assembled(shape)
        self.is_split = (
            split
            and not self.is_joined
            and shape.is_mesh
            and len(_used(shape)) < options.num_points
        )
        self.shape, self.to_original, note = _reduce(
            joined_surface(shape) if self.is_joined else shape, options
        )
        if self.is_split:
            self.shape = _split(self.shape, max(options.num_points, options.num_dense_points))
        self.lies_between = self.is_joined or self.is_split
        if self.lies_between:
            self.to_original = _nearest_used(shape, self.shape.vertices)
        self._notes = [note] if note else []
        self._spectra: dict[int, Spectrum] = {}
        self._farthest: dict[tuple[int, str, bool], IntArray] = {}

    def places(self, chosen: IntArray) -> FloatArray:
        """Return where vertices (k,) of the copy lie on the given shape, shape (k, 3).

        These are its nearest vertices, or its nearest points where the copy lies between them: a board has few.
        """
        if not self.lies_between:
            return self._given.vertices[self.to_original[chosen]]
        given = SurfaceLocator(self._given.vertices, self._given.faces)
        return given.closest(self.shape.vertices[chosen]).on(self._given.vertices)

    def corners(self, num: int) -> tuple[IntArray, IntArray]:
        """Return given vertices (m,) that a joined surface goes around, and its vertices beside these (m,).

        At most ``num`` at different places, each the farthest from those before.
        """
        used = _used(self._given)
        used = used[np.unique(self._given.vertices[used], axis=0, return_index=True)[1]]
        given = self._given.vertices[used]
        around = SurfaceLocator(self.shape.vertices, self.shape.faces).closest(given)
        gaps = np.linalg.norm(around.on(self.shape.vertices) - given, axis=1)
        near = np.flatnonzero(gaps <= OUTSIDE_CELLS * cell_size(self._given))
        if len(near):
            outside = Shape.from_arrays(given[near], name=self._given.name)
            near = near[farthest_points(outside, min(num, len(near)), metric="euclidean")]
        return used[near], around.nearest[near]

    def normals(self, chosen: IntArray) -> FloatArray:
        """Return the outward normals at vertices (k,) of the copy, (k, 3); (0, 3) where the shape has no sides."""
        if self.lies_between:
            return outward_normals(self.shape, at=chosen, max_defects=MAX_DEFECTS)
        return outward_normals(self._given, at=self.to_original[chosen])

    @property
    def notes(self) -> tuple[Note, ...]:
        """What a user should know about the preprocessing."""
        return tuple(self._notes)

    @cached_property
    def rim(self) -> str:
        """As in :class:`data_tools.embedding.embedding.Samples`."""
        if not self.shape.is_mesh:
            return "unknown"
        return "open" if is_open_surface(self.shape.vertices, self.shape.faces) else "closed"

    @cached_property
    def is_connected(self) -> bool:
        """Whether it is a mesh of one component."""
        return self.shape.is_mesh and _is_connected(self.shape)

    @cached_property
    def geodesics(self) -> GeodesicSolver:
        """Geodesic distances."""
        solver = GeodesicSolver(self.shape)
        if self.shape.is_mesh and solver.method != "heat":
            self._notes.append(Note("edge-geodesics"))
        return solver

    @property
    def has_enough_points(self) -> bool:
        """Whether it is a mesh, or a cloud of enough points for a surface."""
        return self.shape.is_mesh or len(self.shape.vertices) > NUM_CLOUD_NEIGHBOURS

    @cached_property
    def operators(self) -> SurfaceOperators:
        """Stiffness and mass."""
        operators = surface_operators(self.shape)
        if operators.kind == "tufted":
            self._notes.append(Note("tufted-laplacian"))
        return operators

    @cached_property
    def agd(self) -> FloatArray:
        """Average geodesic distance of each vertex, shape (w,)."""
        num = min(AGD_SOURCES, len(self.shape.vertices))
        sources = farthest_points(self.shape, num, metric="euclidean")
        return average_geodesic_distance(self.shape, self.geodesics, sources)

    @cached_property
    def area(self) -> float:
        """Surface area in squared units (estimated, for a point cloud)."""
        return float(vertex_areas(self.shape).sum())

    def seeds(self, num: int) -> IntArray:
        """Return indices (m,) of at most ``num`` extrema of the average geodesic distance."""
        return agd_maxima(self.agd, self.geodesics, num=num, radius=SEED_SPACING * self.area**0.5)

    @cached_property
    def boundary_distance(self) -> FloatArray:
        """Distance of each vertex to the rim, shape (w,); zero where there is none."""
        return boundary_distance(self.shape, self.geodesics)

    def farthest_points(self, num: int, metric: str, *, seeded: bool) -> IntArray:
        """Return farthest points (num,); if ``seeded``, up to half of them extrema of average geodesic distance."""
        key = (num, metric, seeded)
        if key not in self._farthest:
            seeds = self.seeds(num // 2) if seeded else None
            solver = self.geodesics if metric == "geodesic" else None
            self._farthest[key] = farthest_points(
                self.shape, num, metric=metric, seeds=seeds, solver=solver
            )
        return self._farthest[key]

    def eigenfunctions(self, num: int) -> Spectrum:
        """Return the lowest non-constant eigenpairs, as many as the surface has vertices for."""
        if num not in self._spectra:
            size = min(num, len(self.shape.vertices) - 2)
            self._spectra[num] = spectrum(self.operators, size, name=self.shape.name)
        return self._spectra[num]


def _is_connected(mesh: Shape) -> bool:
    return mesh_components(len(mesh.vertices), mesh.faces)[0] == 1


def _reduce(shape: Shape, options: SamplingOptions) -> tuple[Shape, IntArray, Note | None]:
    max_faces = max(options.max_faces, FACES_PER_SAMPLE * options.num_points)
    if shape.is_mesh and len(shape.faces) > max_faces:
        return _decimate(shape, max_faces)
    if not shape.is_mesh and len(shape.vertices) > MOST_CLOUD_POINTS:
        rng = np.random.default_rng(0)
        kept = np.sort(rng.choice(len(shape.vertices), MOST_CLOUD_POINTS, replace=False))
        note = Note("subsampled", values={"kept": len(kept), "total": len(shape.vertices)})
        return Shape.from_arrays(shape.vertices[kept], name=shape.name, file=shape.file), kept, note
    used = _used(shape)
    if shape.is_mesh and len(used) < len(shape.vertices):
        faces = np.searchsorted(used, shape.faces)
        return (
            Shape.from_arrays(shape.vertices[used], faces, name=shape.name, file=shape.file),
            used,
            None,
        )
    return shape, np.arange(len(shape.vertices)), None


def _split(mesh: Shape, num: int) -> Shape:
    """Return a mesh with all triangles split into four until it has so many vertices."""
    import trimesh

    vertices, faces = mesh.vertices, mesh.faces
    while len(vertices) < num:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return Shape.from_arrays(vertices, faces, name=mesh.name, file=mesh.file)


def _used(shape: Shape) -> IntArray:
    """Return the vertices of triangles, ascending."""
    in_triangle = np.zeros(len(shape.vertices), dtype=np.bool_)
    in_triangle[shape.faces] = True
    return np.flatnonzero(in_triangle)


def _decimate(shape: Shape, max_faces: int) -> tuple[Shape, IntArray, Note]:
    """Return a decimated copy; its vertices map back to the nearest original one.

    Where thin legs come off, so that 1 % of the area is lost, it gets more triangles.
    """
    kept = CleaningOptions(components="largest" if _is_connected(shape) else "all")
    for finer in (1, 2, 4):
        vertices, faces = decimate(shape.vertices, shape.faces, finer * max_faces)
        small = clean(Shape.from_arrays(vertices, faces, name=shape.name, file=shape.file), kept)
        if (
            face_areas(small.vertices, small.faces).sum()
            >= 0.99 * face_areas(vertices, faces).sum()
        ):
            break
    note = Note("decimated", values={"before": len(shape.faces), "after": len(small.faces)})
    return small, _nearest_used(shape, small.vertices), note


def _nearest_used(shape: Shape, points: FloatArray) -> IntArray:
    """Return the vertex of a triangle that is nearest to each of the points (q, 3)."""
    used = _used(shape)
    tree = scipy.spatial.cKDTree(shape.vertices[used], compact_nodes=False, balanced_tree=False)
    return used[tree.query(points)[1]]


def _is_assembled(shape: Shape) -> bool:
    """Return whether a mesh has several components and was not seen from one side only."""
    if not shape.is_mesh or _is_connected(shape):
        return False
    return not len(lines_that_saw(shape))
