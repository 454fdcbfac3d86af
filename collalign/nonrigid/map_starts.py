"""Where searches for maps start: signs of the lowest eigenfunctions, matched tips, and smooth shells.

**Signs.**
Each start is a map of the source's samples into the target's samples, together with the Procrustes energy in the
lowest functions; refinement and judgement come later.

**Shells.**
The inside of a surface hardly tells the sides of a thin limb apart, and a pose of the whole says nothing of limbs
that bend. So either surface is laid onto the other one by the map known so far: in ever more of its eigenfunctions
its coordinates become those of the points that the map takes it to, while what these functions do not resolve turns
with the pose. Points correspond that are near in the embeddings of both, in space, and by their normals there. This
is the product of spectrum and space of Smooth Shells (Eisenberger, Lahner and Cremers 2020), with little Dirichlet
energy in place of cells that stay rigid.
"""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np

from collalign.nonrigid.functional_map import (
    SMOOTHNESS,
    Side,
    fitted_map,
    mutual_nearest_rows,
    zoomout_sizes,
)
from collalign.nonrigid.map_options import TUNED
from collalign.nonrigid.spectral_shape import SpectralShape, orientation_form
from collalign.nonrigid.tips import tip_matches
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.shape import vertex_normals
from pairwise.local_search import LocalMinima, MatchingCosts, minimise, procrustes
from pairwise.problem import Problem, num_left_over


def embedded_problem(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    dim: int,
) -> Problem:
    """Return the Procrustes matching problem of samples in ``dim`` functions, where ``allowed`` (n, k)."""
    return Problem.from_user(
        target.functions[target.samples, :dim],
        source.functions[source_samples, :dim],
        group="O",
        allowed=allowed,
    )


def sign_starts(
    target: SpectralShape, source: SpectralShape, source_samples: IntArray, allowed: BoolArray
) -> LocalMinima:
    """Return local minima in 17 functions that the signs of the lowest 8 lead to, best energy first.

    ``source_samples`` are vertices, shape (k,), and ``allowed`` says which of the target they may match, (n, k).

    Eigenfunctions of near-isometric shapes agree up to sign where their eigenvalues are simple; a full R in the
    larger spaces repairs those that are not.
    """
    problem = embedded_problem(target, source, source_samples, allowed, TUNED.num_signs)
    signs = np.array(list(product((1.0, -1.0), repeat=TUNED.num_signs)))
    reflections = signs[:, :, None] * np.eye(TUNED.num_signs)
    maps = np.unique(MatchingCosts(problem).assign(reflections), axis=0)
    return descend_maps(target, source, source_samples, allowed, maps, "signs")


def descend_maps(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    maps: IntArray,
    origin: str,
    *,
    sizes: tuple[int, ...] = TUNED.descent_sizes,
) -> LocalMinima:
    """Improve maps of the samples by local minimisation in more and more functions.

    Parameters
    ----------
    target, source : SpectralShape
    source_samples : ndarray of int, shape (k,)
        Rows of the source's working surface.
    allowed : ndarray of bool, shape (n, k)
        Which samples of the target each of these may go to.
    maps : ndarray of int, shape (m, k)
        Where to start.
    origin : str
        What the starts are called.
    sizes : tuple of int
        Numbers of functions, one round each.
    """
    for dim in sizes:
        problem = embedded_problem(target, source, source_samples, allowed, dim)
        minima = minimise(problem, procrustes(problem, maps), max_iterations=20, origins=origin)
        maps = minima.maps[: TUNED.num_kept]
    return minima


def candidate_mask(gaps: FloatArray, share: float) -> BoolArray:
    """Return which target samples each source sample may match, shape (n, k): the share nearest by descriptor.

    Maron et al. 2016, section 6.1. A mask that leaves no injective map is widened, by half its share at a time, until
    it has one.

    Parameters
    ----------
    gaps : ndarray, shape (n, k)
        How much the descriptors differ.
    share : float
    """
    ranks = gaps.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    allowed = ranks < max(1, round(share * len(gaps)))
    while num_left_over(allowed):
        share = min(1.0, 1.5 * share)
        allowed |= ranks < round(share * len(gaps))
    return allowed


def wave_gaps(target: SpectralShape, source: SpectralShape, source_samples: IntArray) -> FloatArray:
    """Return how much the wave kernel signatures of samples differ, the mean of their logarithms, shape (n, k)."""
    differences = target.waves[target.samples][:, None, :] - source.waves[source_samples]
    return np.abs(differences).mean(axis=2)


def tip_starts(
    target: SpectralShape, source: SpectralShape, num: int, *, mirrored: bool
) -> list[tuple[IntArray, IntArray]]:
    """Return maps of the first ``num`` dense samples, there and back, that matched tips ask for (:mod:`.tips`).

    With ``mirrored`` each match starts a map of either orientation, without it one that keeps left and right.
    """
    matches = tip_matches(target.tips, source.tips)
    if not matches:
        return []
    of_target, of_source = _TipRows(target, num), _TipRows(source, num)
    return [
        mutual_nearest_rows(of_target.rows(to), of_source.rows(of, sign))
        for to, of in matches
        for sign in ((1.0, -1.0) if mirrored else (1.0,))
    ]


class _TipRows:
    """How close the first dense samples of a mesh are to its tips, and on which side of the limbs they are."""

    def __init__(self, spectral: SpectralShape, num: int) -> None:
        closeness, samples = spectral.tips.closeness, spectral.dense[:num]
        self._closeness = closeness[samples]
        self._sides = orientation_form(spectral.working_shape, closeness)[samples]

    def rows(self, tips: IntArray, sign: float = 1.0) -> FloatArray:
        """Return what is compared of the samples where these tips are matched, shape (num, c)."""
        a, b = np.triu_indices(len(tips), 1)
        sides = sign * self._sides[:, tips[a], tips[b]]
        return np.hstack(
            [_shares(self._closeness[:, tips]), TUNED.tip_side_weight * _shares(sides)]
        )


def _shares(values: FloatArray) -> FloatArray:
    """Return values (n, m) such that the absolute ones of each row sum to one."""
    total = np.abs(values).sum(axis=1, keepdims=True)
    return np.asarray(values / np.where(total > 0, total, 1.0))


class ShellRefiner:
    """Refines maps between the dense samples of two meshes, prepared once for all candidates of the pair.

    Parameters
    ----------
    target, source : SpectralShape
        With triangles.
    """

    def __init__(self, target: SpectralShape, source: SpectralShape) -> None:
        self.target, self.source = target, source
        self._target, self._source = _Skin(target), _Skin(source)
        last = min(len(target.eigenvalues), len(source.eigenvalues)) + 1
        self._sizes = zoomout_sizes(min(TUNED.num_shell, last), last, factor=1.5)

    def refine(
        self, map_target_source: IntArray, map_source_target: IntArray, *, chirality: float = 1.0
    ) -> tuple[IntArray, IntArray]:
        """Return the point maps of the samples, there and back, that such maps lead to.

        Parameters
        ----------
        map_target_source, map_source_target : ndarray of int, shapes (v,) and (u,)
        chirality : float
            Determinant of the pose at which the surfaces are compared; -1 for maps that swap left and right.
        """
        there, back = map_target_source, map_source_target
        for size in self._sizes:
            on_target, of_source = _compared(
                self._target, self._source, size, (there, back), chirality
            )
            on_source, of_target = _compared(
                self._source, self._target, size, (back, there), chirality
            )
            rows_target, rows_source = (
                np.hstack([on_target, of_target]),
                np.hstack([of_source, on_source]),
            )
            there, back = mutual_nearest_rows(rows_target, rows_source)
        return there, back


class _Skin:
    """The triangles around the dense samples of a surface of unit area, and the functions that move them."""

    def __init__(self, spectral: SpectralShape) -> None:
        is_dense = np.zeros(len(spectral.vertices), dtype=bool)
        is_dense[spectral.dense] = True
        around = spectral.faces[is_dense[spectral.faces].any(axis=1)]
        used, faces = np.unique(around, return_inverse=True)
        centre = spectral.mass @ spectral.vertices
        self.places = (spectral.vertices[used] - centre) / spectral.area**0.5
        self.faces, self.dense = faces.reshape(-1, 3), np.searchsorted(used, spectral.dense)
        self.basis, self.samples = spectral.basis[used], self.places[self.dense]
        self.side = cache(lambda size: Side.of(spectral, spectral.dense, size))
        self.unresolved, self.unmoved = cache(self._unresolved), self.in_space(self.places)

    def _unresolved(self, size: int) -> FloatArray:
        """Return what so many functions do not resolve of the places, shape (v, 3)."""
        side, every = self.side(size), np.arange(len(self.samples))
        low = fitted_map(self.samples, side.basis, every, every, SMOOTHNESS * side.frequencies)
        return self.places - self.basis[:, :size] @ low

    def in_space(self, places: FloatArray, chirality: float = 1.0) -> FloatArray:
        """Return what is compared of the samples where the vertices are at ``places``, shape (s, 6)."""
        normals = chirality * vertex_normals(places, self.faces)[self.dense]
        return np.hstack([TUNED.shell_position * places[self.dense], TUNED.shell_normal * normals])


def _compared(
    fixed: _Skin, moving: _Skin, size: int, maps: tuple[IntArray, IntArray], chirality: float
) -> tuple[FloatArray, FloatArray]:
    """Return the rows of the samples of a surface and of another one that is laid onto it by maps there and back."""
    to, of = fixed.side(size), moving.side(size)
    goals = np.hstack([to.own, fixed.samples])
    carried = fitted_map(goals, of.basis, *maps, SMOOTHNESS * of.frequencies)
    on_fixed = np.vstack([fixed.samples[maps[0]], fixed.samples])
    on_moving = np.vstack([moving.samples, moving.samples[maps[1]]])
    products = (on_fixed - on_fixed.mean(axis=0)).T @ (on_moving - on_moving.mean(axis=0))
    rotation = nearest_orthogonal(products, determinant=chirality)
    laid = moving.unresolved(size) @ rotation.T + moving.basis[:, :size] @ carried[:, size:]
    weight = float(np.sqrt((to.own**2).sum(axis=1).mean()))
    return (
        np.hstack([to.own, weight * fixed.unmoved]),
        np.hstack([of.basis @ carried[:, :size], weight * moving.in_space(laid, chirality)]),
    )
