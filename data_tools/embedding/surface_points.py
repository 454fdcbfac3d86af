"""A mesh or a point cloud as well-spread points with normals: one cell apart, or at places that are asked for."""

from __future__ import annotations

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray, extremes, read_only, sums_by_owner
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.local_surface import (
    FEWEST_POINTS,
    RADIUS_CELLS,
    SCENE_RADIUS_CELLS,
    LocalSurface,
)
from data_tools.options import SamplingOptions
from data_tools.partial_surface import PartialSurface
from data_tools.sight import lines_that_saw, place_of_sight
from data_tools.surface.shape import MAX_DEFECTS, Shape, orientation_defects, outward_normals
from data_tools.surface.topology import (
    boundary_edges,
    face_crosses,
    is_open_surface,
    spread_over_faces,
)

#: Points that are spread over each cell of a mesh, and the least and largest number over all.
POINTS_A_CELL, FEWEST_SPREAD, MOST_SPREAD = 16.0, 4_000, 60_000
#: Sides of a cell's face that a normal may point to: both sides of a thin wall keep points of their own.
NUM_SIDES = 6
#: An open mesh counts as inside out where the mean cosine between normals and arms from the centre, weighted by their
#: lengths, is below this. Else the side of the file's triangles is kept, as it always is of depth images:
#: rooms seen from inside have down to -.62.
INSIDE_OUT = -1 / 3
#: A point whose normals cancel is no surface: the least length of the mean of its unit normals.
LEAST_NORMAL = 0.3
#: Cells that the centroid of a cloud is computed from, in root mean square radii of its points.
CLOUD_CELL = 0.1
#: Neighbours along which the side of a cloud's normals spreads.
SIDE_NEIGHBOURS = 10
#: Larger meshes are decimated to so many triangles: their vertices are what is matched.
MOST_MATCHED_FACES = 40_000
#: Neighbours that a plane is fitted to where there are no triangles.
NORMAL_NEIGHBOURS = 30
#: A point of a cloud lies on a rim if so many neighbours leave a gap of more than this angle around it, in radians.
RIM_NEIGHBOURS, RIM_GAP = 12, 2.0


def surface_cells(shape: Shape, cell: float, *, of_scene: bool = False) -> LocalSurface | None:
    """Return the points of a shape one cell apart, with normals and descriptors; None where there are too few.

    So many points that planes are local are needed: in a table of landmarks they are fitted to what lies far apart.

    Points are spread over triangles by area; each cell of a grid along the principal axes keeps the mean of its
    points and of its normals. Where there are no triangles, or they disagree on a side, or one direction saw all of
    them (a depth image, whose triangles are as rough as its depths), normals are those of local planes. Their side is
    that of the triangles, or they point towards what saw the surface, or the side spreads from neighbour to
    neighbour and bulges point outwards (Hoppe et al., SIGGRAPH 1992).

    Parameters
    ----------
    shape : Shape
    cell : float
        In units of the shape.
    of_scene : bool
        The shape is a part of a room or a street: rough, mostly flat, and hollow where it was seen from. Its rays are
        far from parallel: they meet at a place.
    """
    is_closed = shape.is_mesh and not is_open_surface(shape.vertices, shape.faces)
    radius_cells = SCENE_RADIUS_CELLS if of_scene else RADIUS_CELLS
    no_sights = of_scene or is_closed
    sights = np.empty((0, 3)) if no_sights else lines_that_saw(shape)
    is_image = of_scene or len(sights) > 0
    has_side = shape.is_mesh and orientation_defects(shape) <= MAX_DEFECTS
    spread, triangles = shape.vertices, np.empty((0, 3))
    if shape.is_mesh:
        spread, triangles = spread_over_triangles(shape, cell, as_stored=is_image)
    if has_side and not is_image:
        points, normals = spread, triangles
    else:
        points, _ = _cell_means(spread, None, 0.5 * cell)
        if len(points) < NORMAL_NEIGHBOURS:
            return None
        far, near = _plane_neighbours(points, points)
        if np.median(far[:, -1]) > radius_cells * cell:
            return None
        planes = _normals_of_planes(points[near])
        if has_side:
            nearest = scipy.spatial.cKDTree(points).query(spread)[1]
            towards = sums_by_owner(triangles, nearest, len(points))
            normals = planes * np.where((planes * towards).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
            if len(sights):
                sights = sights * (1.0 if (normals @ sights[0]).mean() >= 0.0 else -1.0)
        elif len(sights):
            normals = planes * np.where(planes @ sights[0] < 0.0, -1.0, 1.0)[:, None]
        else:
            normals = one_sided(points, planes)
    points, normals = _cell_means(points, normals, cell)
    if len(points) < FEWEST_POINTS:
        return None
    return LocalSurface.from_user(
        points,
        normals,
        cell,
        sights,
        places=place_of_sight(shape.vertices) if of_scene else (),
        radius_cells=radius_cells,
    )


def centre_and_radius(shape: Shape) -> tuple[FloatArray, float]:
    """Return the centroid (3,) of a shape's surface and its root mean square distance from there.

    Cells of a cloud count alike, however many points they have.
    """
    if not shape.is_mesh:
        spread = float(np.sqrt(shape.vertices.var(axis=0).sum()))
        points = (
            _cell_means(shape.vertices, None, CLOUD_CELL * spread)[0]
            if spread > 0
            else shape.vertices
        )
        return points.mean(axis=0), float(np.sqrt(points.var(axis=0).sum()))
    start = shape.vertices.mean(axis=0)
    corners = (shape.vertices - start)[shape.faces]
    weights = np.sqrt((face_crosses(shape.vertices - start, shape.faces) ** 2).sum(axis=0))
    weights /= max(float(weights.sum()), np.finfo(float).tiny)
    sums = corners.sum(axis=1)
    mean = weights @ sums / 3.0
    # The mean square over a triangle is (|a|^2 + |b|^2 + |c|^2 + |a + b + c|^2) / 12.
    squares = ((corners**2).sum(axis=(1, 2)) + (sums**2).sum(axis=1)) / 12.0
    return start + mean, float(np.sqrt(max(weights @ squares - mean @ mean, 0.0)))


def spread_over_triangles(
    shape: Shape, cell: float, *, as_stored: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return points on the triangles of a mesh, evenly by area, and the triangles' outward normals, each (n, 3).

    Some 16 points a cell of the side ``cell``, in units of the shape. Outside of an open mesh is what its file says,
    unless it is clearly inside out. With ``as_stored`` it is always what the file says.
    """
    crosses = face_crosses(shape.vertices, shape.faces).T
    areas = np.linalg.norm(crosses, axis=1)
    total = float(areas.sum())
    num = int(np.clip(POINTS_A_CELL * 0.5 * total / cell**2, FEWEST_SPREAD, MOST_SPREAD))
    points, faces = spread_over_faces(shape.vertices, shape.faces, num)
    normals = (crosses / np.maximum(areas, np.finfo(float).tiny)[:, None])[faces]
    if as_stored:
        return points, normals
    arms = points - points.mean(axis=0)
    outwards = np.vdot(normals, arms) / max(
        np.linalg.norm(arms, axis=1).sum(), np.finfo(float).tiny
    )
    is_turned = outwards < 0.0 and (
        outwards < INSIDE_OUT or not is_open_surface(shape.vertices, shape.faces)
    )
    return points, -normals if is_turned else normals


def _cell_means(
    points: FloatArray, normals: FloatArray | None, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Return the mean point and unit normal of every cell of a grid along the principal axes, each (l, 3).

    Without normals, zeros. With them, points whose normals point to different sides keep cells of their own.
    """
    centre = points.mean(axis=0)
    axes = np.linalg.eigh((points - centre).T @ (points - centre))[1]
    cells = np.floor((points - centre) @ axes / cell).astype(np.int64)
    low, high = extremes(cells)
    cells -= low
    sizes = high - low + 1
    keys = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
    if normals is not None:
        along = normals @ axes
        largest = np.abs(along).argmax(axis=1)
        keys = keys * NUM_SIDES + 2 * largest + (along[np.arange(len(along)), largest] > 0)
    _, which, counts = np.unique(keys, return_inverse=True, return_counts=True)
    means = sums_by_owner(points - centre, which, len(counts)) / counts[:, None] + centre
    if normals is None:
        return means, np.zeros_like(means)
    directions = sums_by_owner(normals, which, len(counts)) / counts[:, None]
    lengths = np.linalg.norm(directions, axis=1)
    kept = lengths > LEAST_NORMAL
    return means[kept], directions[kept] / lengths[kept, None]


def spread_points(shape: Shape, num: int) -> PartialSurface:
    """Return at most ``num`` Euclidean farthest points of a mesh or point cloud, in its own coordinates."""
    small = WorkingSurface(shape, SamplingOptions(max_faces=MOST_MATCHED_FACES)).shape
    chosen = farthest_points(
        small, min(num, len(np.unique(small.vertices, axis=0))), metric="euclidean"
    )
    points = small.vertices[chosen]
    normals = outward_normals(small, max_defects=MAX_DEFECTS)
    oriented = len(normals) > 0
    directions = (
        normals[chosen] if oriented else one_sided(points, plane_normals(small.vertices, points))
    )
    on_rim = _mesh_rim(small, points) if small.is_mesh else cloud_rim(points, directions)
    return PartialSurface(
        points=read_only(points),
        normals=read_only(directions),
        on_rim=read_only(on_rim),
        oriented=oriented,
    )


def _mesh_rim(mesh: Shape, points: FloatArray) -> BoolArray:
    """Return which points are near the mesh's boundary."""
    rim = np.unique(boundary_edges(mesh.faces))
    if not len(rim):
        return np.zeros(len(points), dtype=np.bool_)
    spacing = np.median(scipy.spatial.cKDTree(points).query(points, k=2)[0][:, 1])
    return np.asarray(scipy.spatial.cKDTree(mesh.vertices[rim]).query(points)[0] < spacing)


def cloud_rim(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Return which points (n, 3) of a cloud lie on a rim: their neighbours, along the normal, leave a wide gap.

    Copies of a point are no neighbours of it. A point whose normal is zero takes that of its neighbours' plane.
    """
    places = np.unique(points, axis=0)
    num = min(RIM_NEIGHBOURS + 1, len(places))
    arms = places[scipy.spatial.cKDTree(places).query(points, k=num)[1][:, 1:]] - points[:, None]
    lengths = np.linalg.norm(normals, axis=1)
    if not lengths.all():
        without = lengths == 0.0
        normals = normals.copy()
        normals[without] = plane_normals(places, points[without])
    across = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(normals, across)
    angles = np.arctan2(np.einsum("lka,la->lk", arms, other), np.einsum("lka,la->lk", arms, across))
    angles = np.sort(angles, axis=1)
    gaps = np.diff(angles, axis=1, append=angles[:, :1] + 2.0 * np.pi)
    return np.asarray(gaps.max(axis=1) > RIM_GAP)


def plane_normals(cloud: FloatArray, places: FloatArray) -> FloatArray:
    """Return unit normals (q, 3), of either sign, of the planes through a cloud around each place (q, 3)."""
    return _normals_of_planes(cloud[_plane_neighbours(cloud, places)[1]])


def _plane_neighbours(cloud: FloatArray, places: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return distance and index, (q, k) each, of the points that a plane around each place is fitted to."""
    far, near = scipy.spatial.cKDTree(cloud).query(places, k=min(NORMAL_NEIGHBOURS, len(cloud)))
    return far, near


def _normals_of_planes(points: FloatArray) -> FloatArray:
    """Return unit normals (q, 3), of either sign, of the planes through points (q, k, 3)."""
    moments = points - points.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.swapaxes(moments, 1, 2) @ moments)[1][:, :, 0])


def one_sided(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return normals (l, 3) on one side of each connected piece of a cloud, its bulges outwards.

    The side spreads from neighbour to neighbour (Hoppe et al., SIGGRAPH 1992).
    """
    num = len(points)
    near = scipy.spatial.cKDTree(points).query(points, k=min(SIDE_NEIGHBOURS + 1, num))[1][:, 1:]
    rows, columns = np.repeat(np.arange(num), near.shape[1]), near.ravel()
    costs = 1.001 - np.abs(np.einsum("la,la->l", normals[rows], normals[columns]))
    tree = scipy.sparse.csgraph.minimum_spanning_tree(
        scipy.sparse.coo_matrix((costs, (rows, columns)), shape=(num, num)).tocsr()
    )
    oriented, arms = normals.copy(), points - points.mean(axis=0)
    _, pieces = scipy.sparse.csgraph.connected_components(tree, directed=False)
    for first in np.unique(pieces, return_index=True)[1]:
        order, before = scipy.sparse.csgraph.breadth_first_order(tree, first, directed=False)
        for at in order[1:]:
            if oriented[at] @ oriented[before[at]] < 0:
                oriented[at] = -oriented[at]
        if np.vdot(oriented[order], arms[order]) < 0:
            oriented[order] = -oriented[order]
    return oriented
