"""Which entries of R may be non-zero, which of its blocks are rotations, and the projection onto such matrices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from data_tools.arrays import BoolArray, FloatArray, IntArray, as_mask, read_only
from data_tools.checks import check_choice
from data_tools.errors import InputError, OptionsError


@dataclass(frozen=True, eq=False)
class RotationPattern:
    """The sparsity of the orthogonal matrix R and its blocks of determinant +1.

    Attributes
    ----------
    mask : ndarray of bool, shape (d, d)
        Entries of R that may be non-zero. Not necessarily symmetric.
    special_blocks : tuple of (start, stop)
        Index ranges whose diagonal block of R has determinant +1 (``group="SO"``); the mask is zero between such a
        block and the rest. Relaxations use the convex hull of the rotations for blocks of size 2 and 3 and only
        orthogonality for larger ones, which keeps bounds valid.
    """

    mask: BoolArray
    special_blocks: tuple[tuple[int, int], ...] = ()

    @classmethod
    def from_user(cls, pattern: PatternLike, dim: int, group: str) -> RotationPattern:
        """Read what callers may write.

        Parameters
        ----------
        pattern : None, int, sequence of int, array of bool (d, d), or RotationPattern
            ``None`` is the full matrix; an integer is the half-width of a band (0 diagonal, 1 tridiagonal, 2 the
            paper's 5-diagonal); a sequence holds the sizes of the diagonal blocks, the rotation block first;
            an array is the mask itself.
        dim : int
            d.
        group : {"SO", "O"}
            ``"SO"`` asks for determinant +1 of the first block (of all of R where there are no blocks).

        Raises
        ------
        OptionsError
            If the group is unknown, or the pattern does not fit d.
        InputError
            If the mask leaves no orthogonal matrix.
        """
        check_choice("group", group, ("SO", "O"))
        if isinstance(pattern, RotationPattern):
            if pattern.dim != dim:
                raise OptionsError(
                    f"rotation_pattern: is for dimension {pattern.dim}, the points have {dim}"
                )
            _check_sizes(pattern.special_blocks)
            return pattern
        mask, first = _mask_from_user(pattern, dim)
        special = ((0, first),) if group == "SO" else ()
        _check_sizes(special)
        filled = np.where(mask, np.random.default_rng(0).standard_normal(mask.shape), 0.0)
        if not mask.all() and np.linalg.matrix_rank(filled) < dim:
            raise InputError(
                "rotation_pattern: every matrix with these non-zero entries is singular"
            )
        return cls(read_only(mask), special)

    @property
    def dim(self) -> int:
        """Number of coordinates d."""
        return len(self.mask)

    @cached_property
    def entries(self) -> tuple[IntArray, IntArray]:
        """Rows and columns, (r,) each, of the free entries in column-major order: the order of ``[R]`` everywhere."""
        cols, rows = np.nonzero(self.mask.T)
        return rows, cols

    @property
    def num_entries(self) -> int:
        """Number r of free entries."""
        return int(self.mask.sum())

    @cached_property
    def components(self) -> tuple[IntArray, ...]:
        """Indices, shape (b,) each, of the finest diagonal blocks that hold the pattern; R is projected by block."""
        if self.mask.all():
            return (np.arange(self.dim),)
        _, labels = scipy.sparse.csgraph.connected_components(
            self.mask | self.mask.T, directed=False
        )
        return tuple(np.flatnonzero(labels == c) for c in range(labels.max() + 1))

    @property
    def is_block_diagonal(self) -> bool:
        """Whether all orthogonal matrices of the components fit the mask: false for bands, true for blocks."""
        return all(bool(self.mask[np.ix_(index, index)].all()) for index in self.components)

    @cached_property
    def rotation_block(self) -> int:
        """Size of the first block of R, the one that rotates the shape.

        It is the block of determinant +1 where there is one, the first diagonal block of two or three coordinates, or
        all of R.

        Raises
        ------
        OptionsError
            If the block of determinant +1 is not the first one.
        """
        if self.special_blocks:
            start, stop = self.special_blocks[0]
            if start != 0:
                raise OptionsError("rotation_pattern: the rotation block must come first")
            return stop
        first = len(self.components[0])
        return first if first in (2, 3) else self.dim

    def mirrored(self, rotations: FloatArray) -> BoolArray | None:
        """Return whether the rotation block of matrices (..., d, d) mirrors; None where the group never does."""
        if self.special_blocks:
            return None
        block = self.rotation_block
        return np.asarray(np.linalg.det(rotations[..., :block, :block]) < 0)

    def pack(self, matrix: FloatArray) -> FloatArray:
        """Return [R], the free entries of (..., d, d) matrices, shape (..., r)."""
        rows, cols = self.entries
        return matrix[..., rows, cols]

    def unpack(self, entries: FloatArray) -> FloatArray:
        """Return matrices (..., d, d) from their free entries (..., r)."""
        rows, cols = self.entries
        matrix = np.zeros((*entries.shape[:-1], self.dim, self.dim))
        matrix[..., rows, cols] = entries
        return matrix

    def project(self, matrices: FloatArray, mirrored: BoolArray | None = None) -> FloatArray:
        """Return the nearest orthogonal matrices, block by block, with determinant +1 where it is asked for.

        Orthogonal Procrustes (Schoenemann 1966; Kabsch 1976 for the determinant). A banded pattern has no closed
        form: its projection fills the finest block-diagonal pattern around it.

        Parameters
        ----------
        matrices : ndarray, shape (..., d, d)
            For Procrustes pass ``target[map].T @ (weights * source)``.
        mirrored : ndarray of bool, shape (...), optional
            Ask for determinant -1 of the rotation block where true, +1 elsewhere, whatever the group.

        Returns
        -------
        ndarray, shape (..., d, d)
        """
        blocks = [matrices]
        if len(self.components) > 1:
            blocks = [matrices[..., index[:, None], index] for index in self.components]
        factors = [np.linalg.svd(block) for block in blocks]
        wanted = 1.0 if mirrored is None else np.where(mirrored, -1.0, 1.0)
        for start, stop in self.special_blocks if mirrored is None else ((0, self.rotation_block),):
            within = (start <= index[0] < stop for index in self.components)
            _set_determinants(list(compress(factors, within)), wanted)
        if len(factors) == 1:
            return np.asarray(factors[0][0] @ factors[0][2])
        rotations = np.zeros(matrices.shape)
        for index, (u, _, vt) in zip(self.components, factors, strict=True):
            rotations[..., index[:, None], index] = u @ vt
        return rotations


#: What callers may give as ``rotation_pattern``.
PatternLike: TypeAlias = RotationPattern | ArrayLike | Sequence[int] | int | None


def _set_determinants(
    factors: list[tuple[FloatArray, FloatArray, FloatArray]], wanted: FloatArray | float
) -> None:
    """Give a block, by the singular vectors of its components, the wanted determinant, in place.

    Where it has the other one, the weakest direction is turned round.
    """
    signs = [np.linalg.det(u @ vt) for u, _, vt in factors]
    is_wrong = np.prod(signs, axis=0) * wanted < 0
    weakest = np.argmin([s[..., -1] for _, s, _ in factors], axis=0)
    for position, (u, _, _) in enumerate(factors):
        u[is_wrong & (weakest == position), :, -1] *= -1.0


def _mask_from_user(pattern: PatternLike, dim: int) -> tuple[BoolArray, int]:
    """Return the mask and the size of its first block (d where there are no blocks)."""
    if pattern is None:
        return np.ones((dim, dim), dtype=bool), dim
    if isinstance(pattern, int | np.integer) and not isinstance(pattern, bool):
        if pattern < 0:
            raise OptionsError(
                f"rotation_pattern: the band's half-width must be 0 or more, got {pattern}"
            )
        offsets = np.subtract.outer(np.arange(dim), np.arange(dim))
        return np.abs(offsets) <= pattern, dim
    array = np.asarray(pattern)
    if array.ndim == 1:
        sizes = [int(s) for s in array]
        if min(sizes, default=0) < 1 or sum(sizes) != dim or array.dtype.kind not in "iu":
            raise OptionsError(
                f"rotation_pattern: block sizes {array.tolist()} do not add up to dimension {dim}"
            )
        labels = np.repeat(np.arange(len(sizes)), sizes)
        return np.equal.outer(labels, labels), sizes[0]
    return as_mask(array, "rotation_pattern", shape=(dim, dim)), dim


def _check_sizes(blocks: Iterable[tuple[int, int]]) -> None:
    if any(stop - start < 2 for start, stop in blocks):
        raise OptionsError("rotation_pattern: a rotation block needs two coordinates or more")
