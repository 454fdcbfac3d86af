"""Closest points on a triangle mesh or a point cloud, exactly, carried along when it moves; places beyond its rim."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import BoolArray, FloatArray, IntArray

#: Triangles that each query looks at first, by the distance of their centroids.
_NUM_FIRST = 8
#: Points whose longer lists are in memory at a time.
_BLOCK = 1000
#: A place lies beyond a surface if the nearest one on the surface is on its rim and farther than the first of these,
#: or farther than the second wherever it is; in root mean square radii of the surface.
BEYOND_RIM, FAR = 0.05, 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Places on a surface.

    Attributes
    ----------
    corners : ndarray of int, shape (q, 3)
        Vertices of the triangle that each place lies on; three times the same vertex on a cloud.
    weights : ndarray, shape (q, 3)
        Barycentric coordinates: not negative, each row sums to one.
    """

    corners: IntArray
    weights: FloatArray

    @property
    def nearest(self) -> IntArray:
        """The corner of the largest weight, shape (q,)."""
        return np.asarray(self.corners[np.arange(len(self.corners)), self.weights.argmax(axis=1)])

    def on(self, vertices: FloatArray) -> FloatArray:
        """Return the places on the same mesh with its vertices elsewhere, shape (q, 3)."""
        return np.asarray(np.einsum("qc,qcd->qd", self.weights, vertices[self.corners]))


class SurfaceLocator:
    """Finds closest points of one surface.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud, of which the closest point is a vertex.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self.vertices = vertices
        self.faces = (
            faces if len(faces) else np.repeat(np.arange(len(vertices))[:, None], 3, axis=1)
        )

    @cached_property
    def _sizes(self) -> list[tuple[IntArray, cKDTree, float]]:
        """Triangles of like size: which, the tree of their centroids, and how far their corners reach from these."""
        corners = self.vertices[self.faces]
        centroids = corners.mean(axis=1)
        reach = np.sqrt(((corners - centroids[:, None]) ** 2).sum(axis=2).max(axis=1))
        octave = np.floor(np.log2(np.maximum(reach, 1e-3 * max(float(reach.max()), 1e-300))))
        groups = [np.flatnonzero(octave == value) for value in np.unique(octave)]
        groups.sort(key=len, reverse=True)
        return [(group, cKDTree(centroids[group]), float(reach[group].max())) for group in groups]

    def closest(self, points: FloatArray) -> SurfacePoints:
        """Return the closest place to each of the points (q, 3).

        Among triangles of like size, those of the nearest centroids come first. Where one outside that list could
        still be nearer (its centroid within the distance found plus the triangles' reach), all such are looked at.
        """
        best = _Best(len(points))
        every = np.arange(len(points))
        for group, centroids, reach in self._sizes:
            num = min(_NUM_FIRST, len(group))
            far, nearest = (
                found.reshape(len(points), num) for found in centroids.query(points, k=num)
            )
            self._compare(points, np.repeat(every, num), group[nearest].ravel(), best)
            left = (
                np.flatnonzero(far[:, -1] < best.distances + reach)
                if num < len(group)
                else every[:0]
            )
            for rows in np.array_split(left, len(left) // _BLOCK + 1):
                listed = centroids.query_ball_point(
                    points[rows], best.distances[rows] + reach, return_sorted=True
                )
                counts = np.array([len(one) for one in listed], dtype=np.int64)
                flat = np.concatenate([np.asarray(one, dtype=np.int64) for one in [*listed, []]])
                self._compare(points, np.repeat(rows, counts), group[flat], best)
        return SurfacePoints(corners=self.faces[best.faces], weights=best.weights)

    def _compare(self, points: FloatArray, rows: IntArray, faces: IntArray, best: _Best) -> None:
        """Look at one triangle per entry, for the point of that row; rows are sorted."""
        corners = self.vertices[self.faces[faces]]
        weights = closest_on_triangles(points[rows], corners)
        offsets = np.einsum("ec,ecd->ed", weights, corners) - points[rows]
        best.update(rows, faces, weights, np.sqrt((offsets**2).sum(axis=1)))


class _Best:
    """The nearest triangle found so far for every point."""

    def __init__(self, num: int) -> None:
        self.faces = np.zeros(num, dtype=np.int64)
        self.weights = np.zeros((num, 3))
        self.distances = np.full(num, np.inf)

    def update(
        self, rows: IntArray, faces: IntArray, weights: FloatArray, distances: FloatArray
    ) -> None:
        """Keep what is nearer; of equals the triangle that comes first."""
        order = np.lexsort((faces, distances, rows))
        first = order[np.unique(rows[order], return_index=True)[1]]
        nearer = first[distances[first] < self.distances[rows[first]]]
        at = rows[nearer]
        self.faces[at], self.weights[at], self.distances[at] = (
            faces[nearer],
            weights[nearer],
            distances[nearer],
        )


def closest_on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return barycentric coordinates of the closest point of each triangle, shape (..., 3).

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        Broadcasts against the triangles.
    corners : ndarray, shape (..., 3, 3)
        Corners are rows. A triangle of no area is taken as its edges.

    References
    ----------
    Ericson, Real-Time Collision Detection (2005), section 5.1.5: the seven Voronoi regions of a triangle.
    """
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    ab, ac = b - a, c - a
    from_a, from_b, from_c = ((_dot(ab, points - p), _dot(ac, points - p)) for p in (a, b, c))
    (d1, d2), (d3, d4), (d5, d6) = from_a, from_b, from_c
    on_ab, on_ac, on_bc = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    regions = [
        (d1 <= 0) & (d2 <= 0),
        (d3 >= 0) & (d4 <= d3),
        (d6 >= 0) & (d5 <= d6),
        (on_ab <= 0) & (d1 >= 0) & (d3 <= 0),
        (on_ac <= 0) & (d2 >= 0) & (d6 <= 0),
        (on_bc <= 0) & (d4 >= d3) & (d5 >= d6),
    ]
    along_ab, along_ac = _ratio(d1, d1 - d3), _ratio(d2, d2 - d6)
    along_bc = _ratio(d4 - d3, (d4 - d3) + (d5 - d6))
    area = on_ab + on_ac + on_bc
    zero, one = np.zeros_like(area), np.ones_like(area)
    second = np.select(
        regions, [zero, one, zero, along_ab, zero, 1 - along_bc], _ratio(on_ac, area)
    )
    third = np.select(regions, [zero, zero, one, zero, along_ac, along_bc], _ratio(on_ab, area))
    weights = np.clip(np.stack([1 - second - third, second, third], axis=-1), 0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))


def lies_beyond(distances: FloatArray, on_rim: BoolArray, radius: float) -> BoolArray:
    """Return which places lie where a surface has nothing, by what is nearest to them.

    Parameters
    ----------
    distances : ndarray, shape (q,)
        From each place to the nearest one of the surface.
    on_rim : ndarray of bool, shape (q,)
        Whether that is on the surface's rim.
    radius : float
        Root mean square radius of the surface.
    """
    return np.asarray(distances > radius * np.where(on_rim, BEYOND_RIM, FAR))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=-1))


def _ratio(part: FloatArray, whole: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):  # in regions that are not chosen
        return np.asarray(part / np.where(whole == 0, 1.0, whole))
