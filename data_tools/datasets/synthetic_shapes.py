"""Generated shapes: blobs, open tooth-like crowns, chairs and limbed figures."""

from __future__ import annotations

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import spread_directions
from data_tools.surface.shape import Shape

#: Polar angle where a crown ends, in radians.
CROWN_RIM = 1.9


def sphere_mesh(num_vertices: int) -> tuple[FloatArray, IntArray]:
    """Return a unit sphere of vertices (num, 3) and triangles (t, 3), counterclockwise from outside."""
    vertices = spread_directions(num_vertices)
    hull = scipy.spatial.ConvexHull(vertices)
    faces = hull.simplices.astype(np.int64)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces[np.lexsort(faces.T[::-1])]


def blob(rng: np.random.Generator, *, num_vertices: int = 1500, name: str = "blob") -> Shape:
    """Return a star-shaped sphere with twelve random bumps and dents: no symmetry, no limbs."""
    directions, faces = sphere_mesh(num_vertices)
    axes = np.array([1.0, rng.uniform(0.7, 0.9), rng.uniform(0.5, 0.65)])
    radii = 1.0 + 0.35 * smooth_field(directions, rng, num_bumps=12, width=0.45)
    return Shape.from_arrays(directions * np.maximum(radii, 0.3)[:, None] * axes, faces, name=name)


def crown(rng: np.random.Generator | None = None, *, num_vertices: int = 1500) -> Shape:
    """Return an open surface like a molar's crown: a cup turned over, with four unequal cusps around a basin.

    Parameters
    ----------
    rng : numpy.random.Generator, optional
        Varies the cusps; without it, always the same crown.
    num_vertices : int
        About so many are left after the sphere's lower part is cut off.
    """
    share = (1.0 - np.cos(CROWN_RIM)) / 2.0
    directions, faces = sphere_mesh(round(num_vertices / share))
    above = directions[:, 2] >= np.cos(CROWN_RIM)
    faces = faces[above[faces].all(axis=1)]
    used = np.unique(faces)
    directions, faces = directions[used], np.searchsorted(used, faces)
    azimuths = np.array([0.6, 2.3, 3.7, 5.4])
    heights = np.array([0.55, 0.42, 0.3, 0.48])
    if rng is not None:
        azimuths = azimuths + rng.normal(0.0, 0.12, 4)
        heights = heights + rng.normal(0.0, 0.05, 4)
    polar = 0.75
    cusps = np.column_stack(
        [
            np.sin(polar) * np.cos(azimuths),
            np.sin(polar) * np.sin(azimuths),
            np.full(4, np.cos(polar)),
        ]
    )
    squared = ((directions[:, None] - cusps) ** 2).sum(axis=2)
    basin = 0.25 * np.exp(-((1.0 - directions[:, 2]) ** 2) / 0.02)
    radii = 1.0 + np.exp(-squared / 0.08) @ heights - basin
    return Shape.from_arrays(directions * radii[:, None] * [1.0, 0.75, 0.8], faces, name="crown")


def chair(
    rng: np.random.Generator | None = None, *, resolution: int = 2, name: str = "chair"
) -> Shape:
    """Return a chair: seat, back and four legs, with one mirror symmetry; ``rng`` varies its proportions.

    All chairs of one resolution have corresponding vertices; about 1000 at resolution 2, four times that at 4.
    """
    factors = np.ones(4) if rng is None else rng.uniform(0.75, 1.3, 4)
    grid = np.zeros((7, 6, 12), dtype=bool)
    grid[:, :, 4:6] = True
    grid[:, 5:, 6:] = True
    for x in (slice(0, 2), slice(5, 7)):
        for y in (slice(0, 2), slice(4, 6)):
            grid[x, y, :4] = True
    vertices, faces = voxel_surface(grid, resolution=resolution)
    z = vertices[:, 2]
    vertices[:, 2] = (
        factors[0] * np.minimum(z, 4) + np.clip(z - 4, 0, 2) + factors[1] * np.maximum(z - 6, 0)
    )
    vertices[:, :2] *= factors[2:]
    return Shape.from_arrays(vertices, faces, name=name)


def figure(*, resolution: int = 2, name: str = "figure") -> Shape:
    """Return a figure of a trunk, a head, two arms and two legs of unequal lengths: something to be bent."""
    grid = np.zeros((19, 2, 19), dtype=bool)
    grid[8:11, :, 7:14] = True
    grid[8:10, :, 14:17] = True
    grid[2:8, :, 11:13] = True
    grid[11:19, :, 11:13] = True
    grid[7:9, :, 0:7] = True
    grid[10:12, :, 1:8] = True
    vertices, faces = voxel_surface(grid, resolution=resolution)
    return Shape.from_arrays(vertices, faces, name=name)


def voxel_surface(
    grid: BoolArray, *, resolution: int = 2, smoothing: int = 6
) -> tuple[FloatArray, IntArray]:
    """Return the smoothed boundary of a set of unit cubes as a closed triangle mesh.

    Parameters
    ----------
    grid : ndarray of bool, shape (x, y, z)
        The cubes; no two may touch in an edge or corner only.
    resolution : int
        Each cube is first cut into ``resolution`` cubed ones.
    smoothing : int
        Rounds of Laplacian smoothing, half a step each.
    """
    fine = np.pad(grid.repeat(resolution, 0).repeat(resolution, 1).repeat(resolution, 2), 1)
    quads = np.concatenate([_walls(fine, axis, side) for axis in range(3) for side in (0, 1)])
    corners, index = np.unique(quads.reshape(-1, 3), axis=0, return_inverse=True)
    quad = index.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]).astype(np.int64)
    vertices = (corners - 1.0) / resolution
    sides = np.unique(
        np.sort(np.concatenate([quad[:, [i, (i + 1) % 4]] for i in range(4)]), axis=1), axis=0
    )
    degree = np.bincount(sides.ravel(), minlength=len(vertices))[:, None]
    for _ in range(smoothing):
        total = np.zeros_like(vertices)
        np.add.at(total, sides[:, 0], vertices[sides[:, 1]])
        np.add.at(total, sides[:, 1], vertices[sides[:, 0]])
        vertices = 0.5 * vertices + 0.5 * total / degree
    return vertices, faces


def smooth_field(
    points: FloatArray, rng: np.random.Generator, *, num_bumps: int, width: float
) -> FloatArray:
    """Return a sum of Gaussian bumps of random heights in [-1, 1] at random ones of the points, shape (v,).

    ``width`` is their standard deviation in units of the points.
    """
    centres = points[rng.choice(len(points), num_bumps, replace=False)]
    heights = rng.uniform(-1.0, 1.0, num_bumps)
    squared = ((points[:, None, :] - centres) ** 2).sum(axis=2)
    return np.exp(-squared / (2.0 * width**2)) @ heights


def _walls(fine: BoolArray, axis: int, side: int) -> IntArray:
    """Return the squares between a cube and emptiness on one side of one axis, shape (q, 4, 3), outward."""
    empty = np.roll(~fine, -1 if side else 1, axis=axis)
    cubes = np.argwhere(fine & empty)
    u, v = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
    base = cubes + side * np.eye(3, dtype=np.int64)[axis]
    square = np.stack([base, base + u, base + u + v, base + v], axis=1)
    return square if side else square[:, ::-1]
