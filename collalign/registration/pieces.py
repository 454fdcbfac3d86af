"""A surface as pieces that turn: what as-rigid-as-possible deformations need of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from data_tools.arrays import FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.laplacian import surface_operators
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class MapGoals:
    """Where vertices of a surface should go.

    Attributes
    ----------
    vertices : ndarray of int, shape (p,)
        Each any number of times.
    places : ndarray, shape (p, 3)
    """

    vertices: IntArray
    places: FloatArray


class _Pull:
    """The linear system that places solve, given turned edges."""

    def __init__(self, system: csc_array, asked: FloatArray) -> None:
        self._solve, self._asked = splu(system).solve, asked

    def places(self, edges: FloatArray) -> FloatArray:
        return np.asarray(self._solve(edges + self._asked))


class RigidPieces:
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

    def pull(self, goals: MapGoals, trust: FloatArray, length: float) -> _Pull:
        """Return the system in which goals count as far as they are trusted, each vertex by its area at most."""
        num = len(self._rest)
        count = np.maximum(np.bincount(goals.vertices, minlength=num), 1)
        share = self.mass[goals.vertices] * trust / (count[goals.vertices] * length**2)
        asked = np.zeros((num, 3))
        np.add.at(asked, goals.vertices, share[:, None] * goals.places)
        total = np.bincount(goals.vertices, weights=share, minlength=num)
        return _Pull(csc_array(self._stiffness + diags_array(total)), asked)

    def turned_edges(self, moved: FloatArray) -> FloatArray:
        """Return the weighted sum of each vertex's edges at rest, turned as those of the moved surface are."""
        rest, _, turns = self._edges(moved)
        return np.asarray(self._sum @ (self._weights[:, None] * np.einsum("eij,ej->ei", turns, rest)))

    def turned_back(self, moved: FloatArray) -> FloatArray:
        """Return the weighted sum of each vertex's edges on the moved surface, turned back."""
        _, now, turns = self._edges(moved)
        return np.asarray(self._sum @ (self._weights[:, None] * np.einsum("eji,ej->ei", turns, now)))

    def _edges(self, moved: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Edges at rest and now, (e, 3), and the mean of the rotations at their ends, (e, 3, 3)."""
        rest = self._rest[self._at] - self._rest[self._to]
        now = moved[self._at] - moved[self._to]
        products = self._sum @ (self._weights[:, None, None] * now[:, :, None] * rest[:, None, :]).reshape(-1, 9)
        turns = nearest_orthogonal(products.reshape(-1, 3, 3), determinant=1.0)
        return rest, now, 0.5 * (turns[self._at] + turns[self._to])
