"""A surface as points one cell apart, each with its normal and a descriptor of its neighbourhood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from data_tools.arrays import FloatArray, Holds, as_floats, as_points, read_only
from data_tools.errors import InputError
from data_tools.sight import DepthImage
from data_tools.threads import one_blas_thread

#: Distance of the points of surfaces that may be partial, in root mean square radii of the median shape.
PART_CELL = 0.08
#: Neighbours of a point are those within so many cells: of a surface, and of one that shows a room or a street.
#: There, most of what is near is flat, and far from the sensor it is rough. Chosen on frames of a real and of two
#: generated rooms: of pairs that share a third or more, the best pose is right for 93, 73 and 46 % with 5 cells, and
#: for 96, 95 and 54 % with 8.
RADIUS_CELLS, SCENE_RADIUS_CELLS = 5.0, 8.0
#: Bins of each of the three angles.
NUM_BINS = 11
#: Points of a surface that are compared with another one at a pose: an even choice of at most so many.
MOST_COMPARED = 600
#: A surface needs so many points for its neighbourhoods to say anything.
FEWEST_POINTS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePlanes:
    """Points of a surface with their planes.

    Attributes
    ----------
    points : ndarray, shape (l, 3)
    normals : ndarray, shape (l, 3)
        Unit normals.
    cell : float
        A length, in the unit of the points, by which others are near or far.
    """

    points: Annotated[FloatArray, Holds(shape="l 3")]
    normals: Annotated[FloatArray, Holds(shape="l 3")]
    cell: Annotated[float, Holds(positive=True)]

    @cached_property
    def tree(self) -> scipy.spatial.cKDTree:
        """The points, for look-ups of nearest neighbours."""
        return scipy.spatial.cKDTree(self.points)

    @cached_property
    def kept(self) -> dict[float, Any]:
        """What other look-ups keep of the points, by how far they reach."""
        return {}

    def few(self, num: int = MOST_COMPARED) -> slice:
        """Return an even choice of at most ``num`` points."""
        return slice(None, None, -(-len(self.points) // num))


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalSurface(SurfacePlanes):
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
    sights : ndarray, shape (s, 3)
        Unit directions from one of which all of the surface was seen, the likeliest first; mostly none.
    places : ndarray, shape (0, 3) or (1, 3)
        The place from which all of it was seen, if that is near.
    """

    histograms: Annotated[NDArray[np.uint8], Holds(shape="l 33")]
    sights: Annotated[FloatArray, Holds(shape="s 3")]
    places: Annotated[FloatArray, Holds(shape="v 3")]

    @classmethod
    @one_blas_thread()
    def from_user(
        cls,
        points: ArrayLike,
        normals: ArrayLike,
        cell: float,
        sights: ArrayLike = (),
        *,
        places: ArrayLike = (),
        radius_cells: float = RADIUS_CELLS,
    ) -> LocalSurface:
        """Check the arrays and describe every neighbourhood.

        Parameters
        ----------
        points : array_like, shape (l, 3)
        normals : array_like, shape (l, 3)
            Of unit length.
        cell : float
            Distance of the points, in their own units.
        sights : array_like, shape (s, 3), optional
            Unit directions from one of which all of the surface was seen, as in a depth image.
        places : array_like, shape (0, 3) or (1, 3), optional
            The place from which all of it was seen, as by a camera in a room.
        radius_cells : float
            Neighbours of a point are those within so many cells.

        Raises
        ------
        InputError
            If the arrays are not finite or of different lengths, or the cell is not positive.
        """
        checked = as_points(points, "points", min_points=4, dim=3)
        directions = as_floats(normals, "normals", shape=checked.shape)
        if not (cell > 0 and np.isfinite(cell)):
            raise InputError(f"cell: expected a positive length, got {cell!r}")
        from data_tools.surface.point_features import fast_point_features

        roots = np.sqrt(fast_point_features(checked, directions, radius_cells * cell, NUM_BINS))
        histograms = np.rint(255.0 * roots).astype(np.uint8)
        return cls(
            points=read_only(checked),
            normals=read_only(directions),
            histograms=read_only(histograms),
            cell=float(cell),
            sights=read_only(np.asarray(sights, dtype=np.float64).reshape(-1, 3)),
            places=read_only(np.asarray(places, dtype=np.float64).reshape(-1, 3)),
        )

    @cached_property
    def features(self) -> NDArray[np.float32]:
        """Unit vectors (l, 33) whose distances are Hellinger's distances of the histograms."""
        roots = self.histograms.astype(np.float32)
        return np.asarray(roots / np.maximum(np.linalg.norm(roots, axis=1, keepdims=True), 1.0))

    @cached_property
    def bulge(self) -> float:
        """Mean cosine between normals and arms from the centre, weighted by their lengths.

        Positive where a surface bulges towards its normals, as a solid thing does from outside, and negative where it
        is hollow, as a room is from inside.
        """
        arms = self.points - self.points.mean(axis=0)
        lengths = np.linalg.norm(arms, axis=1).sum()
        return float(np.vdot(self.normals, arms) / max(lengths, np.finfo(float).tiny))

    @cached_property
    def depth_images(self) -> list[DepthImage]:
        """What was seen along each of the possible lines of sight, or from a place; mostly none."""
        return [
            *(DepthImage.along(sight, self.points, self.cell) for sight in self.sights),
            *(DepthImage.around(place, self.points, self.cell) for place in self.places),
        ]

    def thinned(self, num: int) -> LocalSurface:
        """Return an even choice of at most ``num`` points, with the descriptors that they have among all."""
        few = self.few(num)
        return replace(
            self,
            points=read_only(self.points[few]),
            normals=read_only(self.normals[few]),
            histograms=read_only(self.histograms[few]),
        )

    @cached_property
    def mirrored(self) -> LocalSurface:
        """The mirror image in the plane x = 0.

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
            sights=read_only(self.sights * flip),
            places=read_only(self.places * flip),
        )

    def reversed(self) -> LocalSurface:
        """Return the surface with its normals on the other side.

        That negates the second and the third of the three angles of a histogram, which reverses their bins.
        """
        histograms = self.histograms.copy()
        histograms[:, NUM_BINS : 2 * NUM_BINS] = histograms[:, 2 * NUM_BINS - 1 : NUM_BINS - 1 : -1]
        histograms[:, 2 * NUM_BINS :] = histograms[:, : 2 * NUM_BINS - 1 : -1]
        return replace(self, normals=read_only(-self.normals), histograms=read_only(histograms))

    def seen_from_behind(self) -> LocalSurface:
        """Return the surface as what is on its other side would have seen it."""
        return replace(self.reversed(), sights=read_only(-self.sights))


def shows_scene(surfaces: Sequence[LocalSurface]) -> bool:
    """Return whether most surfaces were seen from one direction each, and most of these are hollow from there.

    A room is hollow for a sensor in it, a thing on a table is not.
    """
    bulges = [one.bulge for one in surfaces if len(one.sights) or one.bulge < 0.0]
    return len(bulges) > 0.5 * len(surfaces) and bool(np.median(bulges) < 0.0)
