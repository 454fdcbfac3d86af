"""Distances along a surface, and the average geodesic distance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray, as_indices
from data_tools.surface.laplacian import vertex_areas
from data_tools.surface.shape import Shape
from data_tools.surface.topology import mesh_edges, vertex_components

if TYPE_CHECKING:
    import potpourri3d

#: Neighbours of each point in the graph of a point cloud.
CLOUD_NEIGHBOURS = 12
#: The heat method is trusted where it differs from shortest paths by less than this, relatively, at the median.
HEAT_AGREEMENT = 0.3
#: Sources over which the average geodesic distance is integrated.
AGD_SOURCES = 64


class GeodesicSolver:
    """Geodesic distances on one shape: set up once, then a few milliseconds per source.

    The heat method (Crane, Weischedel and Wardetzky 2013) on connected meshes; shortest paths along the edges on
    other meshes, and along the graph of 12 nearest neighbours in point clouds. Points that cannot be
    reached are infinitely far.

    Parameters
    ----------
    shape : Shape
        Its arrays are valid by construction; unreferenced vertices and several components are allowed.

    Attributes
    ----------
    method : str
        "heat" or "shortest paths".
    edges : ndarray of int, shape (e, 2)
        Which vertices are neighbours.
    """

    def __init__(self, shape: Shape) -> None:
        vertices = shape.vertices
        self._num_vertices = len(vertices)
        self.edges = mesh_edges(shape.faces) if shape.is_mesh else neighbour_edges(vertices)
        self._graph = edge_graph(vertices, self.edges)
        self._heat = _heat_solver(shape, self.edges, self._graph) if shape.is_mesh else None
        self.method = "shortest paths" if self._heat is None else "heat"

    def from_vertices(self, sources: IntArray) -> FloatArray:
        """Return the distance of every vertex to the nearest source, shape (v,), in units of the shape.

        Raises
        ------
        InputError
            If a source is no vertex.
        """
        sources = as_indices(sources, "sources", upper=self._num_vertices, shape=(None,))
        if self._heat is None:
            return scipy.sparse.csgraph.dijkstra(self._graph, indices=sources, min_only=True)
        if len(sources) == 1:
            return np.array(self._heat.compute_distance(int(sources[0])))
        return np.array(self._heat.compute_distance_multisource([int(s) for s in sources]))

    def from_vertex(self, source: int) -> FloatArray:
        """Return the distance of every vertex to one vertex, shape (v,)."""
        return self.from_vertices(np.array([source]))

    def from_each(self, sources: IntArray) -> FloatArray:
        """Return the distance of every vertex to each of some vertices, shape (s, v)."""
        if self._heat is None:
            return np.asarray(scipy.sparse.csgraph.dijkstra(self._graph, indices=sources))
        return np.stack([self.from_vertex(int(source)) for source in sources])


def neighbour_edges(points: FloatArray) -> IntArray:
    """Return the edges along which geodesics of a point cloud run, between nearest neighbours, shape (e, 2)."""
    num = min(CLOUD_NEIGHBOURS, len(points) - 1)
    if num < 1:
        return np.empty((0, 2), dtype=np.int64)
    _, neighbours = scipy.spatial.cKDTree(points).query(points, k=num + 1)
    pairs = np.column_stack([np.repeat(np.arange(len(points)), num), neighbours[:, 1:].ravel()])
    pairs = np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1)
    return np.column_stack(np.divmod(np.unique(pairs @ [len(points), 1]), len(points)))


def edge_graph(vertices: FloatArray, edges: IntArray) -> scipy.sparse.csr_array:
    """Return the graph along which geodesics run: the symmetric sparse matrix of edge lengths, shape (v, v)."""
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    both = np.concatenate([edges, edges[:, ::-1]])
    entries = (np.concatenate([lengths, lengths]), (both[:, 0], both[:, 1]))
    return scipy.sparse.coo_array(entries, shape=(len(vertices),) * 2).tocsr()


def average_geodesic_distance(
    shape: Shape, solver: GeodesicSolver, sources: IntArray
) -> FloatArray:
    """Return AGD(x) = (1 / A) int g(x, y) dy / sqrt(A) at every vertex, shape (v,); dimensionless.

    The integral is a sum over ``sources``, each weighted by the area of the vertices nearest to it, so that the
    result depends neither on the scale of the shape nor on how densely it is meshed (Kim, Lipman and Funkhouser
    2011; Hilaga et al. 2001).

    Parameters
    ----------
    shape : Shape
    solver : GeodesicSolver
        For the same shape.
    sources : ndarray of int, shape (s,)
        Well spread vertices, for instance 64 Euclidean farthest points.
    """
    distances = solver.from_each(sources)
    reachable = np.isfinite(distances)
    distances = np.where(reachable, distances, distances.max(initial=0.0, where=reachable))
    areas = vertex_areas(shape)
    cells = np.bincount(distances.argmin(axis=0), weights=areas, minlength=len(sources))
    return cells @ distances / areas.sum() ** 1.5


def agd_maxima(agd: FloatArray, solver: GeodesicSolver, *, num: int, radius: float) -> IntArray:
    """Return local maxima of the average geodesic distance: the tips of limbs and corners.

    Parameters
    ----------
    agd : ndarray, shape (v,)
    solver : GeodesicSolver
    num : int
        At most so many, the highest first.
    radius : float
        No two are nearer than this along the surface.

    Returns
    -------
    ndarray of int, shape (at least 1 and at most num,)
    """
    is_maximum = np.ones(len(agd), dtype=bool)
    a, b = solver.edges.T
    is_maximum[a[agd[a] < agd[b]]] = False
    is_maximum[b[agd[b] < agd[a]]] = False
    candidates = np.flatnonzero(is_maximum)
    candidates = candidates[np.argsort(-agd[candidates], kind="stable")]
    chosen: list[int] = []
    nearest = np.full(len(agd), np.inf)
    for vertex in candidates:
        if len(chosen) == num:
            break
        if nearest[vertex] >= radius:
            chosen.append(int(vertex))
            nearest = np.minimum(nearest, solver.from_vertex(int(vertex)))
    return np.array(chosen, dtype=np.int64)


def _heat_solver(
    shape: Shape, edges: IntArray, graph: scipy.sparse.csr_array
) -> potpourri3d.MeshHeatMethodDistanceSolver | None:
    """Return the heat method's solver, or None where the mesh is not one it can work on.

    It needs one component without stray vertices; its tufted operators take meshes that are not manifold. Its answer
    for one source must agree with the shortest paths along edges as far as those are exact.
    """
    import potpourri3d  # loads sparse matrices, which a result that is only read does without

    num_parts, _ = vertex_components(len(shape.vertices), [edges])
    if num_parts > 1:
        return None
    try:
        solver = potpourri3d.MeshHeatMethodDistanceSolver(shape.vertices, shape.faces)
        distances = np.asarray(solver.compute_distance(0))
    except RuntimeError:
        return None
    along_edges = scipy.sparse.csgraph.dijkstra(graph, indices=0)
    is_plausible = np.isfinite(distances).all() and np.median(np.abs(distances - along_edges)) <= (
        HEAT_AGREEMENT * np.median(along_edges)
    )
    return solver if is_plausible else None
