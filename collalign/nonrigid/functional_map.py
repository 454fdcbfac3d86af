"""Functional maps: from matched samples to all vertices, by ZoomOut in the eigenfunctions of both shapes.

A functional map takes functions on the target to functions on the source by composition with the point map:
``C_source_target`` (m, m) takes coefficients on the target to coefficients on the source, so that

    basis_target[map_target_source]  ~  basis_source @ C_source_target.

Its transpose is the R_target_source of Procrustes matching. A basis has one row per vertex and orthonormal columns of
ascending frequency; for ZoomOut the constant function comes first.

**Maps that are smooth both ways.**
ZoomOut compares points in ever more eigenfunctions, which says much where shapes are nearly isometric and little
where they are not: there the high ones have nothing to do with each other. Here each surface is embedded by its
eigenfunctions over the root of their frequency, which counts what is coarse; the embedding of either surface is
carried to the other one as a function of little Dirichlet energy, and points correspond that are near in both
embeddings at once. That is the reversible harmonic map of Ezuz, Solomon and Ben-Chen (2019), in the basis of
eigenfunctions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from collalign.nonrigid.spectral_shape import SpectralShape
from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError, OptionsError

#: Rows of a large distance matrix that are held at once.
_BLOCK_ROWS = 128
#: Distance matrices with more entries than this are large.
_SMALL_ENTRIES = 250_000
#: A fit of more entries, pairs of points by functions, gathers them in a sparse matrix. It takes longer to build than
#: fewer take: 200 samples both ways in 10 to 40 functions are fitted in a quarter to a half of the time without.
_FEW_ENTRIES = 40_000


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionalMap:
    """A functional map and the point maps that belong to it.

    Attributes
    ----------
    C_source_target : ndarray, shape (m, m)
        Coefficients on the target to coefficients on the source.
    map_target_source : ndarray of int, shape (v,)
        One row of the target's basis for each row of the source's.
    map_source_target : ndarray of int, shape (u,)
        One row of the source's basis for each row of the target's.
    """

    C_source_target: FloatArray
    map_target_source: IntArray
    map_source_target: IntArray


class TargetRows:
    """Rows (n, q) of which the nearest to others are looked for, prepared once for many looks.

    It maximises ``-|t - s|^2 / 2``, a product of rows with two more columns, in blocks that fit caches: in thirty and
    more dimensions that beats any tree. Single precision is enough for rows around the origin, because the functions
    themselves carry errors of the discretisation.
    """

    def __init__(self, target: FloatArray) -> None:
        num, dim = target.shape
        self._columns = np.ones((dim + 2, num), dtype=np.float32)
        self._columns[:dim] = target.T
        self._columns[dim] = -0.5 * np.einsum("ij,ij->i", target, target)

    def mutual(self, source: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the nearest target row of each source row (k, q), shape (k,), and the reverse, shape (n,).

        Ties go to the first.
        """
        (num, dim), columns = source.shape, self._columns
        rows = np.ones((num, dim + 2), dtype=np.float32)
        rows[:, :dim] = source
        rows[:, dim + 1] = -0.5 * np.einsum("ij,ij->i", source, source)
        num_target = columns.shape[1]
        if num_target * num <= _SMALL_ENTRIES:
            closeness = rows @ columns
            return closeness.argmax(axis=1), closeness.argmax(axis=0)
        forward = np.empty(num, dtype=np.int64)
        backward = np.zeros(num_target, dtype=np.int64)
        closest = np.full(num_target, -np.inf, dtype=np.float32)
        buffer: Any = np.empty((_BLOCK_ROWS, num_target), dtype=np.float32)
        for first in range(0, num, _BLOCK_ROWS):
            block = rows[first : first + _BLOCK_ROWS]
            closeness = np.dot(block, columns, out=buffer[: len(block)])
            forward[first : first + len(block)] = closeness.argmax(axis=1)
            best = closeness.max(axis=0)
            nearer = np.flatnonzero(best > closest)
            backward[nearer] = first + closeness[:, nearer].argmax(axis=0)
            closest[nearer] = best[nearer]
        return forward, backward


def mutual_nearest_rows(target: FloatArray, source: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the nearest target row (n, q) of each source row (k, q), shape (k,), and the reverse, shape (n,)."""
    return TargetRows(target).mutual(source)


class ZoomOut:
    """ZoomOut in both directions between the same two sets of samples, from any number of starting maps.

    Spectral upsampling (Melzi et al. 2019): fit the functional map in the first k functions, read off the point maps,
    increase k. Each fit uses the map and its inverse together (as Ren et al. 2021 do for the discrete maps), which
    keeps the alternation from sliding along the surface; descriptors, where given, count in the nearest neighbours.

    Parameters
    ----------
    basis_target, basis_source : ndarray, shapes (u, m) and (v, m)
        Functions at the samples of both shapes, the constant one first.
    sizes : sequence of int
        Numbers of functions, ascending, at most m.
    descriptors : pair of ndarray, shapes (u, t) and (v, t), optional
        Descriptors of target and source, each column of unit variance.
    descriptor_weight : float
        Root mean square weight of a descriptor relative to that of one function.
    """

    def __init__(
        self,
        basis_target: FloatArray,
        basis_source: FloatArray,
        sizes: Sequence[int],
        *,
        descriptors: tuple[FloatArray, FloatArray] | None = None,
        descriptor_weight: float = 0.3,
    ) -> None:
        if not sizes or list(sizes) != sorted(sizes) or sizes[0] < 1:
            raise OptionsError(
                f"sizes: expected ascending positive numbers of functions, got {list(sizes)}"
            )
        if min(basis_target.shape[1], basis_source.shape[1]) < sizes[-1]:
            shapes = f"{basis_target.shape} and {basis_source.shape}"
            raise InputError(f"bases of shapes {shapes} do not hold {sizes[-1]} functions each")
        if len(basis_source) + len(basis_target) < 2 * sizes[-1]:
            raise InputError(f"{len(basis_source)} samples are too few for {sizes[-1]} functions")
        none = (np.zeros((len(basis_target), 0)), np.zeros((len(basis_source), 0)))
        extra_target, extra_source = (descriptor_weight * x for x in descriptors or none)
        self._steps = [
            (
                target := np.ascontiguousarray(basis_target[:, :size]),
                np.ascontiguousarray(basis_source[:, :size]),
                TargetRows(np.hstack([target, np.sqrt(size) * extra_target])),
                np.sqrt(size) * extra_source,
            )
            for size in sizes
        ]

    def refine(
        self, map_target_source: IntArray, map_source_target: IntArray | None = None
    ) -> FunctionalMap:
        """Refine a map of the samples.

        Parameters
        ----------
        map_target_source : ndarray of int, shape (v,)
            One target sample for each source sample, -1 where it is unknown.
        map_source_target : ndarray of int, shape (u,), optional
            Its inverse, -1 where it is unknown.
        """
        forward = map_target_source
        backward = map_source_target
        if backward is None:
            backward = np.full(len(self._steps[-1][0]), -1)
        for target, source, rows, extra in self._steps:
            c = fitted_map(target, source, forward, backward)
            forward, backward = rows.mutual(np.hstack([source @ c, extra]))
        return FunctionalMap(
            C_source_target=fitted_map(target, source, forward, backward),
            map_target_source=forward,
            map_source_target=backward,
        )


def fitted_map(
    target: FloatArray,
    source: FloatArray,
    forward: IntArray,
    backward: IntArray,
    cost: FloatArray | float = 0.0,
) -> FloatArray:
    """Return the least-squares functional map ``C_source_target`` of a point map and its inverse, shape (k, m).

    Parameters
    ----------
    target, source : ndarray, shapes (u, m) and (v, k)
        Functions at the points of both shapes.
    forward, backward : ndarray of int, shapes (v,) and (u,)
        -1 where unknown.
    cost : ndarray, shape (k,), optional
        Of the square of each coefficient, relative to the mean of the squared residuals.
    """
    at = np.concatenate([np.arange(len(forward)), backward])
    to = np.concatenate([forward, np.arange(len(backward))])
    known = np.minimum(at, to) >= 0
    at, to = at[known], to[known]
    if len(at) * source.shape[1] <= _FEW_ENTRIES:
        rows = source.take(at, axis=0)
        gram, cross = rows.T @ rows, rows.T @ target.take(to, axis=0)
    else:
        counts = np.bincount(at, minlength=len(source))
        pairs = scipy.sparse.csr_array(
            (np.ones(len(at)), (at, to)), shape=(len(source), len(target))
        )
        gram, cross = source.T @ (source * counts[:, None]), source.T @ (pairs @ target)
    gram.flat[:: len(gram) + 1] += 1e-9 * np.trace(gram) + len(at) * cost
    _, fitted, is_singular = scipy.linalg.lapack.dposv(gram, cross)
    if is_singular:
        raise np.linalg.LinAlgError("no point of either shape has an image")
    return np.asarray(fitted, dtype=np.float64)


def zoomout_sizes(first: int, last: int, *, factor: float = 1.15) -> list[int]:
    """Return numbers of functions from ``first`` to ``last`` that grow by a factor, at least by one each."""
    if not 1 <= first <= last or factor < 1.0:
        raise OptionsError(
            f"zoomout_sizes: expected 1 <= first <= last and factor >= 1, got {first}, {last}, {factor}"
        )
    sizes = [first]
    while sizes[-1] < last:
        sizes.append(min(last, max(sizes[-1] + 1, round(sizes[-1] * factor))))
    return sizes


#: Weight of the Dirichlet energy of surfaces of unit area, relative to the mean squared residual. Chosen on bodies.
SMOOTHNESS = 3e-4
#: Eigenvalues of unit area below this count as that: a surface of two parts has one that is nearly 0.
LOWEST = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One side of a functional map: rows of the basis at some points, their embedding, and what roughness costs."""

    basis: FloatArray
    own: FloatArray
    frequencies: FloatArray

    @classmethod
    def of(cls, shape: SpectralShape, rows: IntArray | slice, num: int) -> Side:
        """Return the points at ``rows`` (k,) of the working surface in its ``num`` lowest functions."""
        values = np.concatenate([[0.0], shape.eigenvalues[: num - 1]])
        scale = np.concatenate([[0.0], np.maximum(values[1:], LOWEST) ** -0.5])
        functions = shape.functions[rows, : num - 1]
        basis = np.column_stack([np.ones(len(functions)), functions])
        return cls(basis=basis, own=basis * scale, frequencies=values)


class HarmonicRefiner:
    """Smooths maps between the dense samples of two shapes, prepared once for all candidates of the pair."""

    def __init__(self, target: SpectralShape, source: SpectralShape) -> None:
        self._shapes, self._size = (
            (target, source),
            min(len(target.eigenvalues), len(source.eigenvalues)) + 1,
        )
        self._target, self._source = (Side.of(one, one.dense, self._size) for one in self._shapes)

    def refine(
        self, map_target_source: IntArray, map_source_target: IntArray, smoothness: Sequence[float]
    ) -> FunctionalMap:
        """Return the map that a map and its inverse lead to.

        Parameters
        ----------
        map_target_source, map_source_target : ndarray of int, shapes (v,) and (u,)
        smoothness : sequence of float
            Weight of the Dirichlet energy in each iteration.
        """
        forward, backward = map_target_source, map_source_target
        for weight in smoothness:
            forward, backward = self._nearest(self._target, self._source, forward, backward, weight)
        return FunctionalMap(
            C_source_target=fitted_map(self._target.basis, self._source.basis, forward, backward),
            map_target_source=forward,
            map_source_target=backward,
        )

    def of_all_vertices(self, found: FunctionalMap) -> tuple[IntArray, IntArray]:
        """Return the point maps of all working vertices, of the source (w,) and back, by a map of samples."""
        target, source = (Side.of(one, slice(None), self._size) for one in self._shapes)
        return self._nearest(
            target, source, found.map_target_source, found.map_source_target, SMOOTHNESS
        )

    def _nearest(
        self, target: Side, source: Side, forward: IntArray, backward: IntArray, smoothness: float
    ) -> tuple[IntArray, IntArray]:
        """Return the nearest rows of two sides in both embeddings, fitted to point maps of the dense samples."""
        dense_target, dense_source = self._target, self._source
        rough_target = smoothness * dense_target.frequencies
        rough_source = smoothness * dense_source.frequencies
        to_source = fitted_map(
            dense_target.own, dense_source.basis, forward, backward, rough_source
        )
        to_target = fitted_map(
            dense_source.own, dense_target.basis, backward, forward, rough_target
        )
        rows_target = np.hstack([target.own, target.basis @ to_target])
        rows_source = np.hstack([source.basis @ to_source, source.own])
        return mutual_nearest_rows(rows_target, rows_source)
