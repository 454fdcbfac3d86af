"""Two-block partial least squares: how two sets of coordinates of the same shapes go together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED, Effects, with_orders
from data_tools.arrays import FloatArray, as_floats, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Directions of which a block has less than this part of its largest one, or of all its values, are rounding errors.
_NO_VARIATION, _ROUNDING = 1e-10, 1e-13


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoBlockPLS:
    """Pairs of axes of two blocks along which these covary most. Arrays are read-only.

    Attributes
    ----------
    r : float
        Correlation of the scores on the first pair of axes (r-PLS).
    z, p : float
        Effect size of r, and the share of permutations that give as much.
    covariances, correlations : ndarray, shape (c,)
        Of the scores on each pair of axes, the largest covariance first.
    shares : ndarray, shape (c,)
        Of the squared covariances of all pairs of coordinates.
    axes : (ndarray, ndarray), shapes (m1, c) and (m2, c)
        Of both blocks, orthonormal; the largest entry of each in the first block is positive.
    scores : (ndarray, ndarray), shapes (N, c)
    """

    r: float
    z: float
    p: float
    covariances: FloatArray
    correlations: FloatArray
    shares: FloatArray
    axes: tuple[FloatArray, FloatArray]
    scores: tuple[FloatArray, FloatArray]


@one_blas_thread()
def two_block_pls(
    first: ArrayLike,
    second: ArrayLike,
    *,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> TwoBlockPLS:
    """Find the axes of two blocks along which they covary most, and test whether they covary at all.

    The axes are the singular vectors of the matrix of covariances of both blocks. Shapes of the second block are
    permuted among those of the first.

    Parameters
    ----------
    first, second : array_like, shapes (N, m1) and (N, m2)
        Of the same shapes: coordinates that were superimposed, or other variables, at least one each.
    permutations, seed : int
        As in :func:`collalign.analysis.shape_tests.procrustes_anova`.

    Raises
    ------
    InputError
        If values are missing, there are fewer than three shapes, or a block is the same in all of them.

    References
    ----------
    Rohlf and Corti, Use of two-block partial least-squares to study covariation in shape, Systematic Biology 49
    (2000). Adams and Collyer, On the comparison of the strength of morphological integration across morphometric
    datasets, Evolution 70 (2016): the effect size.

    Examples
    --------
    >>> aligned = collalign.statistics.generalized_procrustes(np.load("landmarks.npy"))
    >>> face, base = aligned[:, :4].reshape(12, -1), aligned[:, 4:].reshape(12, -1)
    >>> 0.0 < collalign.statistics.two_block_pls(face, base).r <= 1.0
    True
    """
    blocks = [
        as_floats(block, name, shape=(None, None))
        for block, name in ((first, "first"), (second, "second"))
    ]
    if len(blocks[0]) != len(blocks[1]) or len(blocks[0]) < 3:
        raise InputError(
            f"first, second: expected both blocks of the same three shapes or more, got {len(blocks[0])} and "
            f"{len(blocks[1])}"
        )
    (one, from_one), (other, from_other) = (
        _reduced(block, name) for block, name in zip(blocks, ("first", "second"), strict=True)
    )
    values, orders = with_orders(other, permutations, seed)
    found = Effects.of(np.array([[_first_correlation(one, values[order])] for order in orders]))
    left, singular, right = np.linalg.svd(one.T @ other / (len(one) - 1), full_matrices=False)
    axes = from_one @ left, from_other @ right.T
    largest = np.abs(axes[0]).argmax(axis=0)
    flip = np.where(axes[0][largest, np.arange(len(singular))] < 0, -1.0, 1.0)
    scores = one @ left * flip, other @ right.T * flip
    lengths = np.linalg.norm(scores[0], axis=0) * np.linalg.norm(scores[1], axis=0)
    squares = singular**2
    return TwoBlockPLS(
        r=float(found.values[0]),
        z=float(found.z[0]),
        p=float(found.p[0]),
        covariances=read_only(singular),
        correlations=read_only(
            (scores[0] * scores[1]).sum(axis=0) / np.maximum(lengths, np.finfo(float).tiny)
        ),
        shares=read_only(squares / max(float(squares.sum()), np.finfo(float).tiny)),
        axes=(read_only(axes[0] * flip), read_only(axes[1] * flip)),
        scores=(read_only(scores[0]), read_only(scores[1])),
    )


def _reduced(block: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
    """Return centred coordinates (N, c) on the principal axes of a block, and these axes (m, c).

    There are fewer of these than of coordinates, and covariances are the same.
    """
    left, sizes, axes = np.linalg.svd(block - block.mean(axis=0), full_matrices=False)
    kept = sizes > max(_NO_VARIATION * sizes[0], _ROUNDING * float(np.linalg.norm(block)))
    if not kept.any():
        raise InputError(f"{name}: is the same in all shapes, so nothing can go together with it")
    return left[:, kept] * sizes[kept], axes[kept].T


def _first_correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of two centred blocks along the axes with the largest covariance."""
    left, _, right = np.linalg.svd(one.T @ other, full_matrices=False)
    a, b = one @ left[:, 0], other @ right[0]
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), np.finfo(float).tiny))
