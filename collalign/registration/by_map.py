"""Where maps of vertices take a surface: as pieces that rotate, before closest points pull and in detail."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy

from collalign.registration.surface import TUNED
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.poses import fitting_similarity, moved_by, scales_of
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg
from data_tools.surface.laplacian import factor_symmetric, surface_operators
from data_tools.surface.shape import Shape, vertex_normals
from data_tools.surface.topology import boundary_edges
from data_tools.threads import one_blas_thread


class BentTuning(NamedTuple):
    """Numbers of a registration that starts from maps of bodies that bend; lengths in parts of their radius.

    What starts was chosen on six ants, armadillos, humans and centaurs each, and measured on six glasses.
    The fit was chosen on twenty bodies of SCAPE; the centaur was held back.
    """

    length: float = 0.1
    """What a map says of neighbours is averaged over so far."""
    loose: float = 1e3
    """So loosely unbent copies stay where the source is: an unbent surface may lie anywhere."""
    least_share: float = 0.5
    """A map with goals for less than this share of the surface starts nothing."""
    least_extent: float = 0.5
    """Nor does one that leaves less than this of the surface's extent: one without order takes all to the middle."""
    most_rotation_deg: float = 60.0
    """Nor one that rotates the whole surface by more than this against its pose: maps are right that rotate it by up
    to 16 degrees; those by 176 and more take the head for the tail."""
    map_length: float = 0.05
    """What a map says of neighbours is averaged over so far before closest points pull. Chosen on bodies."""
    point_length: float = 0.03
    """What closest points say of neighbours is averaged over so far."""
    normal_weight: float = 0.4
    """Of unit normals relative to positions: normals lay muscles and features onto each other. With a third of that,
    seven bodies err 2 % more."""


#: The numbers of a registration by maps that are in use.
BENT = BentTuning()
#: Vertices of a surface, each any number of times (p,), and the places where they should go (p, 3).
MapGoals: TypeAlias = tuple[IntArray, FloatArray]


class ArapSolver:
    """A surface at rest, its edges with cotangent weights, and how each vertex's edges rotate.

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
        off = scipy.sparse.coo_array(operators.stiffness)
        kept = (off.row != off.col) & (off.data < 0)
        ends, shape = (off.row[kept], off.col[kept]), off.shape
        self._weights = scipy.sparse.csr_array((-off.data[kept], ends), shape=shape)
        self._total = np.asarray(self._weights.sum(axis=1)).ravel()
        self._rest = rest.vertices - rest.vertices.mean(axis=0)
        self.radius = float(np.sqrt((self._rest**2).sum(axis=1).mean()))
        self.mass = operators.mass
        self._stiffness = scipy.sparse.csc_array(
            scipy.sparse.diags_array(self._total) - self._weights
        )

    def pull(
        self, goals: MapGoals, trust: FloatArray, length: float
    ) -> Callable[[FloatArray], FloatArray]:
        """Return what gives all places (v, 3) by rotated edges (v, 3).

        Goals count as far as they are trusted, each vertex by its area at most.
        """
        num, (vertices, places) = len(self._rest), goals
        count = np.maximum(np.bincount(vertices, minlength=num), 1)
        share = self.mass[vertices] * trust / (count[vertices] * length**2)
        right_side = np.zeros((num, 3))
        np.add.at(right_side, vertices, share[:, None] * places)
        total = np.bincount(vertices, weights=share, minlength=num)
        solve = factor_symmetric(
            scipy.sparse.csc_array(self._stiffness + scipy.sparse.diags_array(total))
        ).solve
        return lambda edges: np.asarray(solve(edges + right_side))

    def rotated_edges(self, moved: FloatArray) -> FloatArray:
        """Return the weighted sum of each vertex's edges at rest, rotated like those of the moved surface (v, 3)."""
        return self._turned_edges(self._rotations(moved), self._rest)

    def rotated_back(self, moved: FloatArray) -> FloatArray:
        """Return the weighted sum of each vertex's edges on the moved surface (v, 3), rotated back."""
        return self._turned_edges(np.swapaxes(self._rotations(moved), 1, 2), moved)

    def _rotations(self, moved: FloatArray) -> FloatArray:
        """Return how each vertex's edges are rotated on the moved surface (v, 3), shape (v, 3, 3)."""
        now = moved - moved.mean(axis=0)
        ends = (now[:, :, None] * self._rest[:, None, :]).reshape(-1, 9)
        sums = self._weights @ np.hstack([ends, now])
        products = sums[:, :9].reshape(-1, 3, 3) - sums[:, 9:, None] * self._rest[:, None, :]
        products += now[:, :, None] * self._edges(self._rest)[:, None, :]
        return nearest_orthogonal(products, determinant=1.0)

    def _edges(self, places: FloatArray) -> FloatArray:
        """Return the weighted sum of the edges of each vertex, shape (v, 3)."""
        return np.asarray(self._total[:, None] * places - self._weights @ places)

    def _turned_edges(self, rotations: FloatArray, places: FloatArray) -> FloatArray:
        """Return that of edges which are rotated by the mean of the rotations (v, 3, 3) at their ends."""
        turned = np.einsum("vij,vj->vi", rotations, places)
        sums = self._weights @ np.hstack([rotations.reshape(-1, 9), turned])
        there = np.einsum("vij,vj->vi", sums[:, :9].reshape(-1, 3, 3), places) - sums[:, 9:]
        here = np.einsum("vij,vj->vi", rotations, self._edges(places))
        return np.asarray(0.5 * (here + there))


#: Times that the map is evaluated where it can be trusted, and for each that places and rotations are found in turn.
_NUM_TRUSTS, _NUM_ROUNDS = 3, 5


@one_blas_thread()
def bent_by_map(target: Shape, source: Shape, goals: MapGoals) -> FloatArray | None:
    """Return the vertices of a source where a map takes them, shape (v, 3), smoothed; None where it is not believed.

    Least is ``sum_ij w_ij |x_i - x_j - R_i (p_i - p_j)|^2 + sum_i m_i t_i |x_i - g_i|^2 / l^2`` over places ``x`` and
    rotations ``R`` of the source's vertices ``p``, enlarged to the target's area: cotangent weights ``w``, areas
    ``m``, goals ``g`` in which the map is trusted by ``t``, Tukey's biweight of their distance from ``x``. Limbs
    turn, and what a map scatters is smoothed over the length ``l``, without the shrinking of a plain average.

    Not believed are maps of less than half of the surface, those that have no order, and those that turn all of it
    against the common poses: a symmetric body has a second map, which is as smooth.

    Parameters
    ----------
    target, source : Shape
        Meshes, posed.
    goals : MapGoals

    References
    ----------
    Sorkine and Alexa, As-rigid-as-possible surface modeling, SGP 2007.
    """
    size = math.sqrt(target.area / source.area)
    rest = Shape.from_arrays(size * source.vertices, source.faces, name=source.name)
    solver = ArapSolver(rest)
    if solver.mass[np.unique(goals[0])].sum() < BENT.least_share * solver.mass.sum():
        return None
    moved = laid_by_map(solver, goals, BENT.length)
    fit = fitting_similarity(moved, rest.vertices, solver.mass)[:3, :3]
    is_small = scales_of(fit) < BENT.least_extent
    is_rotated = rotation_angle_deg(nearest_orthogonal(fit), np.eye(3)) > BENT.most_rotation_deg
    return None if is_small or is_rotated else moved


def laid_by_map(
    solver: ArapSolver,
    goals: MapGoals,
    length: float,
    *,
    num_rounds: int = _NUM_ROUNDS,
    start: FloatArray | None = None,
) -> FloatArray:
    """Return the places of least energy of :func:`bent_by_map`, shape (v, 3), with ``l`` so many radii.

    The search starts where the goals alone take the surface, or from places (v, 3).
    """
    vertices, places = goals
    trust, edges = np.ones(len(vertices)), np.zeros((len(solver.mass), 3))
    if start is not None:
        edges = solver.rotated_edges(start)
    for _ in range(_NUM_TRUSTS):
        pull = solver.pull(goals, trust, length * solver.radius)
        for _ in range(num_rounds):
            moved = pull(edges)
            edges = solver.rotated_edges(moved)
        distances = np.linalg.norm(moved[vertices] - places, axis=1)
        scale = TUNED.cutoff * float(np.median(distances)) or 1.0
        trust = np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2
    return moved


@one_blas_thread()
def unbent(source: Shape, copies: Sequence[FloatArray]) -> list[FloatArray]:
    """Return copies of a source that are bent in other ways in its own posture, each (v, 3).

    The edges of a copy are rotated back as each vertex's edges are rotated, and a surface is laid through them by
    least squares: it has the copy's local lengths and the source's posture. The plain mean of bodies in several
    postures has limbs that are thin where they differ; that of unbent ones has not.

    Parameters
    ----------
    source : Shape
        A mesh.
    copies : sequence of ndarray, shape (v, 3)
    """
    solver = ArapSolver(source)
    num = len(source.vertices)
    pull = solver.pull((np.arange(num), source.vertices), np.ones(num), BENT.loose * solver.radius)
    return [pull(solver.rotated_back(copy)) for copy in copies]


#: Correspondences beyond the cutoff, or so many radii where that is more, do not count, nor do those whose normals
#: differ by more than the cosine says.
_LEAST_DISTANCE, _MIN_COSINE = 0.01, 0.5
#: Times that closest points are found, and for each that places and rotations are found in turn.
_NUM_FITS, _NUM_SWEEPS = 6, 2
#: Times that places and rotations are found in turn before closest points pull: with 5 bodies err as much.
_NUM_FIRST_ROUNDS = 2


@one_blas_thread()
def fitted_by_map(
    target: Shape, source: Shape, goals: MapGoals, *, size: float | None = None
) -> FloatArray:
    """Return the vertices of a source on a target where a map takes them, shape (v, 3), in whatever poses both are.

    The map's goals are smoothed as in :func:`collalign.registration.by_map.bent_by_map`, but over a shorter length;
    then closest points in positions and normals, both ways, take the place of the goals, and pieces of what the map
    gave stay rigid: pieces of the source would drag a surface that is stretched, as teddies are, along the target.
    What is closest to a rim may lie beyond it, and does not pull.

    Parameters
    ----------
    target, source : Shape
        Meshes, both outwards.
    goals : MapGoals
    size : float, optional
        How many times a surface is enlarged first that has goals for a part of it; what has none starts where the
        best similarity takes it. By default it is enlarged until it has the target's area.
    """
    vertices, places = goals
    enlarged = Shape.from_arrays(
        (size or math.sqrt(target.area / source.area)) * source.vertices,
        source.faces,
        name=source.name,
    )
    fit = fitting_similarity(places, enlarged.vertices[vertices], np.ones(len(vertices)))
    moved = laid_by_map(
        ArapSolver(enlarged),
        goals,
        BENT.map_length,
        num_rounds=_NUM_FIRST_ROUNDS,
        start=moved_by(fit, enlarged.vertices) if size else None,
    )
    solver = ArapSolver(Shape.from_arrays(moved, source.faces, name=source.name))
    fixed, rims = vertex_normals(target.vertices, target.faces), (rim_of(target), rim_of(source))
    for _ in range(_NUM_FITS):
        normals = vertex_normals(moved, source.faces)
        at, to, trust = _closest_points(target.vertices, fixed, moved, normals, solver.radius)
        trust[: len(moved)] *= ~rims[0][to[: len(moved)]]
        trust[len(moved) :] *= ~rims[1][at[len(moved) :]]
        pulls = at, target.vertices[to]
        pull = solver.pull(pulls, trust, BENT.point_length * solver.radius)
        for _ in range(_NUM_SWEEPS):
            moved = pull(solver.rotated_edges(moved))
    return moved


def _closest_points(
    places: FloatArray, fixed: FloatArray, moved: FloatArray, normals: FloatArray, radius: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return moved points, the target's that are closest to them or the other way, and the trust in each pair."""
    weight = BENT.normal_weight * radius
    theirs, ours = np.hstack([places, weight * fixed]), np.hstack([moved, weight * normals])
    at = np.concatenate([np.arange(len(ours)), scipy.spatial.cKDTree(ours).query(theirs)[1]])
    to = np.concatenate([scipy.spatial.cKDTree(theirs).query(ours)[1], np.arange(len(theirs))])
    distances = np.linalg.norm(places[to] - moved[at], axis=1)
    scale = TUNED.cutoff * max(float(np.median(distances)), _LEAST_DISTANCE * radius)
    trust = np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2
    trust *= (fixed[to] * normals[at]).sum(axis=1) > _MIN_COSINE
    return at, to, trust


def rim_of(shape: Shape) -> BoolArray:
    """Return which vertices of a mesh are on its boundary, shape (v,)."""
    on_rim = np.zeros(len(shape.vertices), dtype=bool)
    on_rim[boundary_edges(shape.faces).ravel()] = True
    return on_rim
