"""A surface as points one cell apart, each with its normal and a descriptor of its neighbourhood."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray, Holds, as_floats, as_points, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Distance of the points of surfaces that may be partial, in root mean square radii of the median shape.
PART_CELL = 0.08
#: Neighbours of a point are those within so many cells.
RADIUS_CELLS = 5.0
#: Bins of each of the three angles.
NUM_BINS = 11
#: Points of a surface that are compared with another one at a pose: an even choice of at most so many.
MOST_COMPARED = 600
#: A surface needs so many points for its neighbourhoods to say anything.
FEWEST_POINTS = 30
#: Directions of a half sphere that a surface may have been seen from, and points around one that say where it ends.
NUM_DIRECTIONS, NUM_AROUND = 500, 20
#: A surface was seen from one direction if at most 3 % of its normals are steeper than this cosine, and at most this
#: share of its points lie behind others; such a share weighs so much against cosines where a direction is chosen.
STEEPEST_SEEN, MOST_HIDDEN, HIDDEN_WEIGHT = 0.15, 0.1, 3.0
#: Directions that are no worse than the best one by this are possible, too: at most so many, this cosine apart.
SIGHT_SLACK, MOST_SIGHTS, SIGHT_COSINE = 0.05, 4, 0.98


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalSurface:
    """A surface whose points lie about one cell apart; build it with :meth:`from_user`.

    Attributes
    ----------
    points : ndarray, shape (l, 3)
    normals : ndarray, shape (l, 3)
        Unit normals, all on the same side of the surface.
    histograms : ndarray of uint8, shape (l, 33)
        Square roots of the fast point feature histograms (Rusu, Blodow and Beetz, ICRA 2009) in units of 1/255.
    cell : float
        Distance of the points, in their own units.
    """

    points: Annotated[FloatArray, Holds(shape="l 3")]
    normals: Annotated[FloatArray, Holds(shape="l 3")]
    histograms: Annotated[NDArray[np.uint8], Holds(shape="l 33")]
    cell: Annotated[float, Holds(positive=True)]

    @classmethod
    @one_blas_thread()
    def from_user(cls, points: ArrayLike, normals: ArrayLike, cell: float) -> LocalSurface:
        """Check the arrays and describe every neighbourhood.

        Parameters
        ----------
        points : array_like, shape (l, 3)
        normals : array_like, shape (l, 3)
            Of unit length.
        cell : float
            Distance of the points, in their own units.

        Raises
        ------
        InputError
            If the arrays are not finite or of different lengths, or the cell is not positive.
        """
        checked = as_points(points, "points", min_points=4, dim=3)
        directions = as_floats(normals, "normals", shape=checked.shape)
        if not (cell > 0 and np.isfinite(cell)):
            raise InputError(f"cell: expected a positive length, got {cell!r}")
        roots = np.sqrt(fast_point_features(checked, directions, RADIUS_CELLS * cell))
        histograms = np.rint(255.0 * roots).astype(np.uint8)
        return cls(
            points=read_only(checked),
            normals=read_only(directions),
            histograms=read_only(histograms),
            cell=float(cell),
        )

    @cached_property
    def features(self) -> NDArray[np.float32]:
        """Unit vectors (l, 33) whose distances are Hellinger's distances of the histograms."""
        roots = self.histograms.astype(np.float32)
        return np.asarray(roots / np.maximum(np.linalg.norm(roots, axis=1, keepdims=True), 1.0))

    @cached_property
    def tree(self) -> cKDTree:
        """The points, for look-ups of nearest neighbours."""
        return cKDTree(self.points)

    @property
    def compared(self) -> slice:
        """An even choice of at most :data:`MOST_COMPARED` points."""
        return slice(None, None, -(-len(self.points) // MOST_COMPARED))

    @cached_property
    def sights(self) -> FloatArray:
        """Unit directions (s, 3) from one of which all of the surface was seen, the likeliest first; mostly none."""
        sights = lines_of_sight(self.points, self.normals, self.cell)
        return sights * np.where((self.normals @ sights.T).mean(axis=0) < 0.0, -1.0, 1.0)[:, None]

    def thinned(self, num: int) -> LocalSurface:
        """Return an even choice of at most ``num`` points, with the descriptors that they have among all."""
        step = slice(None, None, -(-len(self.points) // num))
        return replace(
            self,
            points=read_only(self.points[step]),
            normals=read_only(self.normals[step]),
            histograms=read_only(self.histograms[step]),
        )

    def mirrored(self) -> LocalSurface:
        """Return the mirror image in the plane x = 0.

        Mirroring negates the first of the three angles of a histogram, which reverses its bins.
        """
        flip = np.array([-1.0, 1.0, 1.0])
        histograms = self.histograms.copy()
        histograms[:, :NUM_BINS] = histograms[:, NUM_BINS - 1 :: -1]
        return replace(
            self,
            points=read_only(self.points * flip),
            normals=read_only(self.normals * flip),
            histograms=read_only(histograms),
        )


def lines_of_sight(points: FloatArray, normals: FloatArray, spacing: float) -> FloatArray:
    """Return unit directions (s, 3) from which all of a surface is seen, as in a depth image, the likeliest first.

    Those that the steepest normals are not steep to, and from which hardly a point is behind others. Of a direction
    and its opposite it is the one from which the surface slopes down where it ends.

    Parameters
    ----------
    points, normals : ndarray, shape (l, 3)
        Unit normals; their signs do not matter.
    spacing : float
        Distance of the points.
    """
    numbers = np.arange(NUM_DIRECTIONS) + 0.5
    heights = 1.0 - numbers / NUM_DIRECTIONS
    angles, radii = np.pi * (1.0 + np.sqrt(5.0)) * numbers, np.sqrt(1.0 - heights**2)
    directions = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)
    cosines = np.quantile(np.abs(normals @ directions.T), 0.03, axis=0)
    possible = np.flatnonzero(cosines >= STEEPEST_SEEN)
    if not len(possible):
        return np.empty((0, 3))
    directions = directions[possible]
    hidden = np.array([_share_hidden(points, normals, direction, spacing) for direction in directions])
    scores = cosines[possible] - HIDDEN_WEIGHT * hidden
    best = int(np.argmax(scores))
    if hidden[best] > MOST_HIDDEN:
        return np.empty((0, 3))
    near = directions[scores >= scores[best] - SIGHT_SLACK]
    sights = directions[[best]]
    while len(sights) < MOST_SIGHTS:
        cosines = np.abs(near @ sights.T).max(axis=1)
        if cosines.min() > SIGHT_COSINE:
            break
        sights = np.concatenate([sights, near[[int(cosines.argmin())]]])
    arms = points - points[cKDTree(points).query(points, k=min(NUM_AROUND, len(points)))[1]].mean(axis=1)
    slopes = normals * np.sign(normals @ sights[0])[:, None]
    falling = np.vdot(slopes, arms) - (slopes @ sights[0]) @ (arms @ sights[0])
    return sights * np.where(sights @ sights[0] < 0.0, -1.0, 1.0)[:, None] * (1.0 if falling >= 0 else -1.0)


def _share_hidden(points: FloatArray, normals: FloatArray, sight: FloatArray, spacing: float) -> float:
    """Return the share of points farther behind the foremost one of a pixel than their slope explains."""
    along = points @ np.linalg.svd(sight[None])[2].T
    pixels = np.floor((along[:, 1:] - along[:, 1:].min(axis=0)) / spacing).astype(np.int64)
    keys = pixels[:, 0] * (pixels[:, 1].max() + 1) + pixels[:, 1]
    depth = points @ sight
    front = np.full(keys.max() + 1, -np.inf)
    np.maximum.at(front, keys, depth)
    return float((front[keys] - depth > 2.0 * spacing / np.maximum(np.abs(normals @ sight), 0.1)).mean())


def fast_point_features(points: FloatArray, normals: FloatArray, radius: float) -> FloatArray:
    """Return the fast point feature histogram of every point, shape (l, 33); each sums to 1.

    Three angles of a Darboux frame between a point and each neighbour within the radius, in 11 bins each, and the
    neighbours' histograms weighted by inverse distance (Rusu, Blodow and Beetz, ICRA 2009, equations 1 to 3).

    Parameters
    ----------
    points, normals : ndarray, shape (l, 3)
        The normals are of unit length.
    radius : float
        In the units of the points.
    """
    num = len(points)
    near = cKDTree(points).query_pairs(radius, output_type="ndarray")
    at, other = np.concatenate([near, near[:, ::-1]]).T
    arms = points[other] - points[at]
    lengths = np.sqrt(np.einsum("pa,pa->p", arms, arms))
    apart = lengths > 0.0
    at, other, lengths = at[apart], other[apart], lengths[apart]
    arms = arms[apart] / lengths[:, None]
    own, theirs = normals[at], normals[other]
    across = np.cross(arms, own)
    across /= np.maximum(np.sqrt(np.einsum("pa,pa->p", across, across)), 1e-9)[:, None]
    third = np.cross(own, across)
    angles = (
        np.einsum("pa,pa->p", across, theirs),
        np.einsum("pa,pa->p", own, arms),
        np.arctan2(np.einsum("pa,pa->p", third, theirs), np.einsum("pa,pa->p", own, theirs)) / np.pi,
    )
    simple = np.empty((num, 3 * NUM_BINS))
    for number, values in enumerate(angles):
        bins = np.clip(((values + 1.0) * (NUM_BINS / 2.0)).astype(np.int64), 0, NUM_BINS - 1)
        counts = np.bincount(at * NUM_BINS + bins, minlength=num * NUM_BINS)
        simple[:, number * NUM_BINS : (number + 1) * NUM_BINS] = counts.reshape(num, NUM_BINS)
    simple /= np.maximum(3.0 * np.bincount(at, minlength=num), 1.0)[:, None]
    weights = coo_matrix((1.0 / lengths, (at, other)), shape=(num, num)).tocsr()
    total = np.maximum(np.asarray(weights.sum(axis=1)), np.finfo(float).tiny)
    return np.asarray(0.5 * (simple + weights @ simple / total))
