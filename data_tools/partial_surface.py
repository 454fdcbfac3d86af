"""A surface as points with normals, and a grid that answers which of them is nearest to any place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from data_tools.arrays import (
    BoolArray,
    FloatArray,
    Holds,
    IntArray,
    as_floats,
    as_points,
    read_only,
)
from data_tools.errors import InputError
from data_tools.local_surface import LocalSurface
from data_tools.poses import moved_by, scales_of

#: Cells of the grid along the longest side of its box, and by how many radii that reaches beyond the points: places
#: beyond it have no nearest point.
GRID_CELLS, GRID_MARGIN = 40, 0.35

#: Points that a whole surface is read at.
MOST_POINTS = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialSurface:
    """Points of a surface of which parts may be missing; build it with :meth:`from_user`.

    Attributes
    ----------
    points : ndarray, shape (l, 3)
        In the order of farthest point sampling, so that the first ones cover the surface as well.
    normals : ndarray, shape (l, 3)
        Outward unit normals; zeros where the shape has none.
    on_rim : ndarray of bool, shape (l,)
        Points at a boundary of the surface: what lies beyond it is unknown. Of a mesh, those no farther from its
        boundary than points lie apart; of a point cloud, those whose neighbours leave a wide gap around them.
    oriented : bool
        Whether the normals' signs are known; else those of each connected piece agree, a guess.
    """

    points: Annotated[FloatArray, Holds(shape="l 3")]
    normals: Annotated[FloatArray, Holds(shape="l 3")]
    on_rim: Annotated[BoolArray, Holds(shape="l")]
    oriented: bool

    @classmethod
    def from_user(
        cls,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        on_rim: ArrayLike | None = None,
        *,
        oriented: bool = True,
    ) -> PartialSurface:
        """Check points (n, 3), normals (n, 3), outwards if ``oriented``, and which are on a rim (n,).

        Raises
        ------
        InputError
            If they are not finite, of different lengths, or all points lie in one place.
        """
        checked = as_points(points, "points", min_points=4, dim=3)
        if not np.ptp(checked, axis=0).any():
            raise InputError("points: all lie in one place")
        num = len(checked)
        directions = (
            np.zeros((num, 3)) if normals is None else as_floats(normals, "normals", shape=(num, 3))
        )
        rim = np.zeros(num, dtype=bool) if on_rim is None else np.asarray(on_rim)
        if rim.shape != (num,) or rim.dtype != bool:
            raise InputError(
                f"on_rim: expected {num} booleans, got {rim.dtype} of shape {rim.shape}"
            )
        return cls(
            points=read_only(checked),
            normals=read_only(directions),
            on_rim=read_only(rim),
            oriented=oriented,
        )

    def moved(self, transform: FloatArray) -> PartialSurface:
        """Return the surface after a similarity, shape (4, 4). What takes long to compute moves with it."""
        scale = float(scales_of(transform))
        turned = self.normals @ transform[:3, :3].T / scale
        moved = replace(
            self, points=read_only(moved_by(transform, self.points)), normals=read_only(turned)
        )
        nearest, to_cells = self._grid
        vars(moved).update(
            gaps=scale * self.gaps, _grid=(nearest, to_cells @ np.linalg.inv(transform))
        )
        return moved

    @cached_property
    def centre(self) -> FloatArray:
        """The mean of the points, shape (3,)."""
        return read_only(self.points.mean(axis=0))

    @cached_property
    def radius(self) -> float:
        """Root mean square distance of the points from the centre."""
        return float(np.sqrt(((self.points - self.centre) ** 2).sum(axis=1).mean()))

    @cached_property
    def _grid(self) -> tuple[NDArray[np.int32], FloatArray]:
        """The point nearest to each cell (a, b, c), -1 where none is near; places to cells, (4, 4)."""
        reach = GRID_MARGIN * self.radius
        corner, top = self.points.min(axis=0) - reach, self.points.max(axis=0) + reach
        cell = float((top - corner).max() / GRID_CELLS)
        sides = np.maximum(np.ceil((top - corner) / cell).astype(int), 1)
        places = np.stack(
            np.meshgrid(*(np.arange(n) for n in sides), indexing="ij"), axis=-1
        ).reshape(-1, 3)
        found = scipy.spatial.cKDTree(self.points).query(
            corner + (places + 0.5) * cell, distance_upper_bound=reach + cell
        )[1]
        found = np.where(found < len(self.points), found, -1)
        to_cells = np.diag([1.0, 1.0, 1.0, cell]) / cell
        to_cells[:3, 3] = -corner / cell
        return found.astype(np.int32).reshape(sides), to_cells

    def nearest(self, places: FloatArray) -> IntArray:
        """Return about the nearest point to each place (q, 3), its cell's centre's, -1 where none is in reach."""
        grid, to_cells = self._grid
        cells = np.floor(moved_by(to_cells, places)).astype(np.int64)
        inside = ((cells >= 0) & (cells < grid.shape)).all(axis=-1)
        cells[~inside] = 0
        found = grid[cells[..., 0], cells[..., 1], cells[..., 2]]
        return np.where(inside, found, -1).astype(np.int64)

    @cached_property
    def gaps(self) -> FloatArray:
        """How far each point, in the order of farthest point sampling, is from those before it, shape (l - 1,)."""
        distances = scipy.spatial.distance.cdist(self.points[1:], self.points)
        return np.asarray(np.where(np.tri(*distances.shape) > 0, distances, np.inf).min(axis=1))

    def described(self, cell: float, scale: float = 1.0) -> LocalSurface:
        """Return the neighbourhoods of the surface, scaled by a factor, of points that lie one cell apart or more."""
        num = 1 + int((scale * self.gaps >= cell).sum())
        return LocalSurface.from_user(scale * self.points[:num], self.normals[:num], cell)
