"""Maps refined while the surfaces are laid onto each other, from coarse to fine.

The inside of a surface hardly tells the sides of a thin limb apart, and a pose of the whole says nothing of limbs
that bend. So either surface is laid onto the other one by the map known so far: in ever more of its eigenfunctions
its coordinates become those of the points that the map takes it to, while what these functions do not resolve turns
with the pose. Points correspond that are near in the embeddings of both, in space, and by their normals there. This
is the product of spectrum and space of Smooth Shells (Eisenberger, Lahner and Cremers 2020), with little Dirichlet
energy in place of cells that stay rigid.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from collalign.nonrigid.functional_map import fitted_map, mutual_nearest_rows, zoomout_sizes
from collalign.nonrigid.harmonic import SMOOTHNESS, Side
from collalign.nonrigid.map_tuning import TUNED
from collalign.nonrigid.spectral_shape import SpectralShape
from data_tools.arrays import FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.normals import vertex_normals


class ShellRefiner:
    """Refines maps between the dense samples of two meshes, prepared once for all candidates of the pair."""

    def __init__(self, target: SpectralShape, source: SpectralShape) -> None:
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
            on_target, of_source = _compared(self._target, self._source, size, (there, back), chirality)
            on_source, of_target = _compared(self._source, self._target, size, (back, there), chirality)
            there, back = mutual_nearest_rows(np.hstack([on_target, of_target]), np.hstack([of_source, on_source]))
        return there, back


class _Skin:
    """The triangles around the dense samples of a surface of unit area, and the functions that move them."""

    def __init__(self, spectral: SpectralShape) -> None:
        is_dense = np.zeros(len(spectral.vertices), dtype=bool)
        is_dense[spectral.dense] = True
        used, faces = np.unique(spectral.faces[is_dense[spectral.faces].any(axis=1)], return_inverse=True)
        self.places = (spectral.vertices[used] - spectral.mass @ spectral.vertices) / spectral.area**0.5
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
    pairs = np.vstack([fixed.samples[maps[0]], fixed.samples]), np.vstack([moving.samples, moving.samples[maps[1]]])
    centred = [one - one.mean(axis=0) for one in pairs]
    rotation = nearest_orthogonal(centred[0].T @ centred[1], determinant=chirality)
    laid = moving.unresolved(size) @ rotation.T + moving.basis[:, :size] @ carried[:, size:]
    weight = float(np.sqrt((to.own**2).sum(axis=1).mean()))
    return (
        np.hstack([to.own, weight * fixed.unmoved]),
        np.hstack([of.basis @ carried[:, :size], weight * moving.in_space(laid, chirality)]),
    )
