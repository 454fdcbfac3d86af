"""Surfaces that one direction or one place saw, such as depth images: from where, and what that tells of the space.

A depth image says more than where a surface is. Between the surface and what saw it, there is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import half_sphere
from data_tools.surface.shape import MAX_DEFECTS, Shape, orientation_defects
from data_tools.surface.topology import face_crosses


class SightTuning(NamedTuple):
    """Numbers by which a line of sight is found.

    Chosen between views of four models, with scans of a bunny, and whole clouds of six classes.
    """

    least_points: int = 100
    """Fewer points tell nothing: their normals and what hides them are noise."""
    most_points: int = 4000
    """Of more points an even choice, ..."""
    most_normals: int = 1000
    """... and of their normals one of so many."""
    num_directions: int = 2000
    """Directions of a half sphere that are tried, ..."""
    num_likely: int = 100
    """... and those of them from which it is looked what is hidden."""
    num_around: int = 16
    """Points around one that say how dense they are, and whether the surface ends there, and to which side."""
    flat: float = 0.03
    """The density is that of a surface where neighbours vary across it by less than this share of along it, ..."""
    middle: float = 0.4
    """... and where their mean is no farther off than this share of the farthest one."""
    steepest: float = 0.15
    """A surface was seen from one direction if its normals are steeper than this cosine ..."""
    most_steep: float = 0.03
    """... for at most this share of them, ..."""
    most_hidden: float = 0.1
    """... and at most this share of its points lie behind others."""
    slack: float = 0.02
    """Directions that are no worse than the best one by this are possible, too, ..."""
    apart: float = 0.98
    """... those that differ by this cosine."""
    most_away: float = 0.25
    """Of a mesh at most this share of the area across the line of sight faces away: in frames of rooms up to .16, in
    low models of guns, pianos and cars .39 to .5."""
    front_cells: float = 1.5
    """A point is in front of what was seen if it is so many cells nearer than all that was seen around, ..."""
    least_faced: float = 0.3
    """Normals that are steeper than this cosine belong to a surface that is seen from its edge, ..."""
    beside_pixels: int = 2
    """... and beside it if nothing was seen in so many pixels around."""
    distances: tuple[float, ...] = (0.7, 1.0, 1.5, 2.5, 4.0)
    """Distances of a sensor that are tried, in root mean square radii from the middle of what it saw. From farther
    off than the last one rays are parallel."""
    num_places: int = 400
    """Directions of a sensor that are tried, ..."""
    num_tried: int = 300
    """... by so many points, ..."""
    num_refined: int = 3
    """... and the best of these places, which are refined, ..."""
    spread: float = 0.15
    """... by residuals that count in full up to this."""
    least_even: float = 0.2
    """One place saw a surface if densities differ by no more from what that explains, as mean logarithms. Frames of
    rooms have .09 to .14."""


#: The numbers in use.
TUNED = SightTuning()
_TINY = float(np.finfo(float).tiny) ** 0.25
#: Normals that directions meet at once.
_AT_ONCE = 125


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthImage:
    """How near a surface comes to what saw it, by pixels of a cell: along parallel rays, or along those of one place.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Rows: two across the line of sight, then the line of sight, towards what saw the surface.
    place : ndarray, shape (0, 3) or (1, 3)
        Where rays meet; none if they are parallel.
    corner : ndarray, shape (2,)
        Of the first pixel: along the first two axes, or along their ratios to the third one.
    heights : ndarray, shape (h, w)
        The most along the line of sight within a pixel and its neighbours, or minus the least distance. Infinite
        where nothing was seen.
    is_beside : ndarray of bool, shape (h, w)
        Pixels around which nothing was seen.
    pixel : float
        Side of a pixel.
    cell : float
        Distance of the points.
    """

    axes: FloatArray
    place: FloatArray
    corner: FloatArray
    heights: FloatArray
    is_beside: BoolArray
    pixel: float
    cell: float

    @classmethod
    def along(cls, sight: FloatArray, points: FloatArray, cell: float) -> DepthImage:
        """Return the depth image of points (l, 3) along a unit direction (3,) towards what saw them."""
        return cls._drawn(sight, np.empty((0, 3)), points, cell, cell)

    @classmethod
    def around(cls, place: FloatArray, points: FloatArray, cell: float) -> DepthImage:
        """Return the depth image of points (l, 3) that were seen from a place (3,); a usual point has a pixel."""
        arms = place - points
        sight = arms.mean(axis=0)
        pixel = cell / float(np.median(np.linalg.norm(arms, axis=1)))
        return cls._drawn(sight / np.linalg.norm(sight), place[None], points, cell, pixel)

    @classmethod
    def _drawn(
        cls, sight: FloatArray, place: FloatArray, points: FloatArray, cell: float, pixel: float
    ) -> DepthImage:

        axes = np.concatenate([np.linalg.svd(sight[None])[2][1:], sight[None]])
        x, y, depth, is_before = _projected(points, axes, place)
        across = np.stack([x, y], axis=-1)[is_before]
        corner = across.min(axis=0) - TUNED.beside_pixels * pixel
        pixels = np.floor((across - corner) / pixel).astype(np.int64)
        heights = np.full(pixels.max(axis=0) + 1 + TUNED.beside_pixels, -np.inf)
        np.maximum.at(heights, tuple(pixels.T), depth[is_before])
        width = 2 * TUNED.beside_pixels + 1
        is_beside = np.isneginf(
            scipy.ndimage.maximum_filter(heights, size=width, mode="constant", cval=-np.inf)
        )
        was_hit = np.isfinite(heights)
        heights = scipy.ndimage.maximum_filter(heights, size=3, mode="constant", cval=-np.inf)
        is_seen = np.isfinite(heights)
        if len(place):
            # The image ends at its edge: a slanted wall goes on there, nearer than all that was seen of it. Single
            # empty pixels between points belong to the image.
            around = np.ones((3, 3), dtype=np.bool_)
            is_seen = scipy.ndimage.binary_closing(np.pad(was_hit, 1), around)[1:-1, 1:-1]
        heights[~is_seen] = np.inf
        return cls(
            axes=axes,
            place=place,
            corner=corner,
            heights=heights,
            is_beside=is_beside,
            pixel=pixel,
            cell=cell,
        )

    def conflicts(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the shares of points (p, n, 3) that are in front of what was seen and beside it, shape (p, 2).

        Points of a surface that was seen from its edge, by their normals (p, n, 3) of either sign, are not in front:
        a thin board is missed between two pixels. Beside what one place saw its image ends, which tells nothing: NaN.
        """
        x, y, depth, is_before = _projected(points, self.axes, self.place)
        if len(self.place):
            facing = (normals * (self.place[0] - points)).sum(axis=-1) / np.minimum(depth, -_TINY)
        else:
            facing = normals @ self.axes[2]
        row, column = (
            np.floor((at - first) / self.pixel)
            for at, first in zip((x, y), self.corner, strict=True)
        )
        height, width = self.heights.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width) & is_before
        pixels = np.where(inside, row * width + column, 0).astype(np.int64)
        seen = self.heights.take(pixels)
        in_front = inside & (depth > seen + TUNED.front_cells * self.cell)
        in_front &= np.abs(facing) >= TUNED.least_faced
        beside = ~inside | self.is_beside.take(pixels)
        share = np.full(len(points), np.nan) if len(self.place) else beside.mean(axis=1)
        return np.stack([in_front.mean(axis=1), share], axis=1)


def _projected(
    points: FloatArray, axes: FloatArray, place: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return where rays of points (..., 3) meet the image, how near these are, and whether they are before it."""
    if not len(place):
        x, y, depth = (points @ axis for axis in axes)
        return x, y, depth, np.ones(x.shape, dtype=np.bool_)
    x, y, depth = ((place[0] - points) @ axis for axis in axes)
    is_before, along = depth > _TINY, np.maximum(depth, _TINY)
    return x / along, y / along, -np.sqrt(x * x + y * y + depth * depth), is_before


def place_of_sight(points: FloatArray) -> FloatArray:
    """Return the place (1, 3) from which a camera saw all of a cloud; (0, 3) where there is none.

    Pixels see points of a surface the less densely the farther off it is, by the square of the distance, and the more
    it is tilted, by the cosine of that angle. The place is the one that explains densities best. There is none of
    fewer than 100 points, of clouds that were thinned to even distances, and of parallel rays.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        As they were seen.
    """
    none = np.empty((0, 3))
    if len(points) < TUNED.least_points:
        return none
    chosen = points[:: -(-len(points) // TUNED.most_points)]
    distances, near = scipy.spatial.cKDTree(points).query(
        chosen, k=min(TUNED.num_around + 1, len(points))
    )
    normals, inner = _flat_neighbourhoods(chosen, points[near], distances[:, -1])
    if len(inner) < TUNED.least_points:
        return none
    middle = chosen[inner].mean(axis=0)
    radius = float(np.sqrt(chosen[inner].var(axis=0).sum()))
    places, normals = (chosen[inner] - middle) / radius, normals[inner]
    areas = 2.0 * np.log(distances[inner, -1])
    half = half_sphere(TUNED.num_places // 2)
    tried = np.concatenate(
        [distance * way for distance in TUNED.distances for way in (half, -half)]
    )
    few = slice(None, None, -(-len(places) // TUNED.num_tried))
    costs = _uneven(tried[:, None], places[few], normals[few], areas[few])
    best = np.argsort(np.abs(costs).mean(axis=1), kind="stable")[: TUNED.num_refined]
    found = [
        scipy.optimize.least_squares(
            _uneven, start, args=(places, normals, areas), loss="soft_l1", f_scale=TUNED.spread
        )
        for start in tried[best]
    ]
    place = min(found, key=lambda one: one.cost).x
    is_seen = np.abs(_uneven(place, places, normals, areas)).mean() <= TUNED.least_even
    is_near = np.linalg.norm(place) <= TUNED.distances[-1]
    return (middle + radius * place)[None] if is_seen and is_near else none


def _uneven(
    place: FloatArray, points: FloatArray, normals: FloatArray, areas: FloatArray
) -> FloatArray:
    """Return by how much areas per point (n,), as logarithms, differ from what places (..., 3) explain."""
    arms = points - place
    distances = np.maximum(np.linalg.norm(arms, axis=-1), _TINY)
    cosines = np.abs((arms * normals).sum(axis=-1)) / distances
    found = areas + np.log(np.maximum(cosines, 0.1)) - 2.0 * np.log(distances)
    return np.asarray(found - np.median(found, axis=-1, keepdims=True))


def _flat_neighbourhoods(
    points: FloatArray, around: FloatArray, reach: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return normals (n, 3) of the points around each (n, k, 3), and which are flat and in the middle of theirs."""
    spread = around - around.mean(axis=1, keepdims=True)
    variances, axes = np.linalg.eigh(np.swapaxes(spread, 1, 2) @ spread)
    is_inner = variances[:, 0] < TUNED.flat * variances[:, 1]
    arms = np.linalg.norm(points - around.mean(axis=1), axis=1)
    is_inner &= arms < TUNED.middle * reach
    return axes[:, :, 0], np.flatnonzero(is_inner)


def lines_of_sight(points: FloatArray) -> FloatArray:
    """Return unit directions (s, 3) from which all of a cloud is seen, as in a depth image, the likeliest first.

    None of fewer than 100 points. Those that the steepest normals are not steep to, and from which hardly a point is
    behind others. Among them those that explain best how dense the points are: what looks at a surface at an angle
    sees it with fewer points, by the cosine of that angle. Of a direction and its opposite it is the one from which
    the surface slopes down where it ends.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        As they were seen: not thinned to equal distances.
    """
    if len(points) < TUNED.least_points:
        return np.empty((0, 3))
    points = points[:: -(-len(points) // TUNED.most_points)]
    tree, few = (
        scipy.spatial.cKDTree(points),
        slice(None, None, -(-len(points) // TUNED.most_normals)),
    )
    directions = half_sphere(TUNED.num_directions)
    likely = _seldom_steep(_neighbourhoods(tree, points[few])[2], directions)
    if not len(likely):
        return np.empty((0, 3))
    reach, variances, normals, arms = _neighbourhoods(tree, points)
    is_inner = variances[few, 0] < TUNED.flat * variances[few, 1]
    is_inner &= np.linalg.norm(arms[few], axis=1) < TUNED.middle * reach[few]
    inner = np.flatnonzero(is_inner)
    residuals = np.zeros(len(likely))
    if len(inner):
        cosines = np.abs(normals[few][inner] @ directions[likely].T)
        areas = np.log(np.maximum(cosines, 0.1))
        areas += 2.0 * np.log(reach[few][inner])[:, None]
        residuals = np.abs(areas - np.median(areas, axis=0)).mean(axis=0)
    order = np.argsort(residuals, kind="stable")[: TUNED.num_likely]
    likely, residuals = likely[order], residuals[order]
    spacing = float(np.median(reach)) * np.sqrt(np.pi / TUNED.num_around)
    hidden = np.array([_share_hidden(points, normals, directions[one], spacing) for one in likely])
    costs = residuals + hidden
    best = int(np.argmin(costs))
    if hidden[best] > TUNED.most_hidden:
        return np.empty((0, 3))
    possible = directions[likely[costs <= costs[best] + TUNED.slack]]
    sights = directions[likely[[best]]]
    while (cosines := np.abs(possible @ sights.T).max(axis=1)).min() <= TUNED.apart:
        sights = np.concatenate([sights, possible[[int(cosines.argmin())]]])
    slopes = normals * np.sign(normals @ sights[0])[:, None]
    falling = np.vdot(slopes, arms) - (slopes @ sights[0]) @ (arms @ sights[0])
    sights = sights * np.where(sights @ sights[0] < 0.0, -1.0, 1.0)[:, None]
    return sights if falling >= 0 else -sights


def lines_that_saw(shape: Shape) -> FloatArray:
    """Return unit directions (s, 3) from which all of a shape is seen, as :func:`lines_of_sight` has them.

    None sees both sides of a mesh. Vertices of low models are too far apart to hide each other.
    """
    sights = lines_of_sight(shape.vertices)
    if not len(sights) or not shape.is_mesh or orientation_defects(shape) > MAX_DEFECTS:
        return sights
    facing = sights[0] @ face_crosses(shape.vertices, shape.faces)
    areas = facing[facing > 0.0].sum(), -facing[facing < 0.0].sum()
    has_two_sides = min(areas) > TUNED.most_away * sum(areas)
    return sights[:0] if has_two_sides else sights


def _neighbourhoods(
    tree: scipy.spatial.cKDTree, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return how far neighbourhoods of points (n, 3) of a tree reach (n,), and their planes.

    These are variances (n, 3), ascending, normals (n, 3), and arms (n, 3) from the middle of each to its point.
    """
    distances, near = tree.query(points, k=min(TUNED.num_around + 1, tree.n))
    around = tree.data[near]
    spread = around - around.mean(axis=1, keepdims=True)
    variances, axes = np.linalg.eigh(np.swapaxes(spread, 1, 2) @ spread)
    reach = np.maximum(distances[:, -1], np.finfo(float).tiny)
    return reach, variances, axes[:, :, 0], spread[:, 0]


def _seldom_steep(normals: FloatArray, directions: FloatArray) -> IntArray:
    """Return which directions (t, 3) hardly any of the normals (n, 3) is steep to, ascending.

    Most are out after a part of the normals.
    """
    most, likely = int(TUNED.most_steep * len(normals)), np.arange(len(directions))
    num_steep = np.zeros(len(directions), dtype=np.int64)
    for first in range(0, len(normals), _AT_ONCE):
        some = normals[first : first + _AT_ONCE]
        steep = np.abs(some @ directions[likely].T) < TUNED.steepest
        num_steep[likely] += np.count_nonzero(steep, axis=0)
        likely = likely[num_steep[likely] <= most]
    return likely


def _share_hidden(
    points: FloatArray, normals: FloatArray, sight: FloatArray, spacing: float
) -> float:
    """Return the share of points farther behind the foremost one of a pixel than their slope explains."""
    along = points @ np.linalg.svd(sight[None])[2].T
    pixels = np.floor((along[:, 1:] - along[:, 1:].min(axis=0)) / spacing).astype(np.int64)
    keys = pixels[:, 0] * (pixels[:, 1].max() + 1) + pixels[:, 1]
    depth = points @ sight
    front = np.full(keys.max() + 1, -np.inf)
    np.maximum.at(front, keys, depth)
    return float(
        (front[keys] - depth > 2.0 * spacing / np.maximum(np.abs(normals @ sight), 0.1)).mean()
    )
