"""A surface as pieces that turn: what as-rigid-as-possible deformations need of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from data_tools.arrays import FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.laplacian import surface_operators
from data_tools.surface.shape import Shape

#: Vertices of a surface, each any number of times (p,), and the places where they should go (p, 3).
MapGoals: TypeAlias = tuple[IntArray, FloatArray]


class ArapSolver:
    """A surface at rest, its edges with cotangent weights, and how each vertex's edges turn.

    Parameters
    ----------
    rest : Shape
        A mesh.

    References
    ----------
    Sorkine and Alexa, As-rigid-as-possible surface modeling, SGP 2007.
    """

    def __init__(self, rest: Shape) -> None:
        operators = surface_operators(rest)
        stiffness = coo_array(operators.stiffness)
        off = (stiffness.row != stiffness.col) & (stiffness.data < 0)
        self._at, self._to, self._weights = stiffness.row[off], stiffness.col[off], -stiffness.data[off]
        centred = rest.vertices - rest.vertices.mean(axis=0)
        self.radius = float(np.sqrt((centred**2).sum(axis=1).mean()))
        self._rest, self.mass = rest.vertices, operators.mass
        num, edges = len(rest.vertices), np.arange(int(off.sum()))
        self._sum = csr_array((np.ones(len(edges)), (self._at, edges)), shape=(num, len(edges)))
        weights = csc_array((self._weights, (self._at, self._to)), shape=(num, num))
        self._stiffness = diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights

    def pull(self, goals: MapGoals, trust: FloatArray, length: float) -> Callable[[FloatArray], FloatArray]:
        """Return what gives all places (v, 3) by turned edges (v, 3).

        Goals count as far as they are trusted, each vertex by its area at most.
        """
        num, (vertices, places) = len(self._rest), goals
        count = np.maximum(np.bincount(vertices, minlength=num), 1)
        share = self.mass[vertices] * trust / (count[vertices] * length**2)
        asked = np.zeros((num, 3))
        np.add.at(asked, vertices, share[:, None] * places)
        total = np.bincount(vertices, weights=share, minlength=num)
        solve = splu(csc_array(self._stiffness + diags_array(total))).solve
        return lambda edges: np.asarray(solve(edges + asked))

    def rotated_edges(self, moved: FloatArray) -> FloatArray:
        """Return the weighted sum of each vertex's edges at rest, rotated like those of the moved surface (v, 3)."""
        rest, _, turns = self._edges(moved)
        return np.asarray(self._sum @ (self._weights[:, None] * np.einsum("eij,ej->ei", turns, rest)))

    def rotated_back(self, moved: FloatArray) -> FloatArray:
        """Return the weighted sum of each vertex's edges on the moved surface (v, 3), rotated back."""
        _, now, turns = self._edges(moved)
        return np.asarray(self._sum @ (self._weights[:, None] * np.einsum("eji,ej->ei", turns, now)))

    def _edges(self, moved: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return edges at rest and now, (e, 3), and the mean of the rotations at their ends, (e, 3, 3)."""
        rest = self._rest[self._at] - self._rest[self._to]
        now = moved[self._at] - moved[self._to]
        products = self._sum @ (self._weights[:, None, None] * now[:, :, None] * rest[:, None, :]).reshape(-1, 9)
        turns = nearest_orthogonal(products.reshape(-1, 3, 3), determinant=1.0)
        return rest, now, 0.5 * (turns[self._at] + turns[self._to])
