"""Superimposed shapes against size and groups: Procrustes ANOVA, pairs of groups and disparity, by permutation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Random permutations, and the seed of their generator.
NUM_PERMUTATIONS, SEED = 999, 0
#: A column adds nothing to those before it if less than this part of it is new.
_NOTHING = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class Effects:
    """Numbers that are the larger, the stronger an effect is, beside what permutations make of them.

    As found, shape (t,); standard deviates of their logarithms among permutations (effect sizes); shares of
    permutations that give as much, the one found counted among them.
    """

    values: FloatArray
    z: FloatArray
    p: FloatArray

    @classmethod
    def of(cls, permuted: FloatArray) -> Effects:
        """Compare the first row, as found, with all rows, shape (m + 1, t)."""
        logs = np.log(np.maximum(permuted, np.finfo(float).tiny))
        spread = logs.std(axis=0)
        z = np.where(spread > 0, logs[0] - logs.mean(axis=0), np.nan) / np.where(spread > 0, spread, 1.0)
        p = np.where(np.isnan(permuted[0]), np.nan, (permuted >= permuted[0] * (1 - 1e-12)).mean(axis=0))
        return cls(values=permuted[0], z=z, p=p)

    @property
    def holm(self) -> FloatArray:
        """The p adjusted to the number of tests by Holm's method, shape (t,)."""
        order = np.argsort(self.p, kind="stable")
        raised = np.maximum.accumulate(self.p[order] * np.arange(len(order), 0, -1))
        adjusted = np.empty(len(order))
        adjusted[order] = np.minimum(raised, 1.0)
        return adjusted


@dataclass(frozen=True, kw_only=True, eq=False)
class AnovaRow:
    """A row of a Procrustes ANOVA, at unit centroid size.

    F is the mean square over that of the effect it is tested against; effect size and P are by permutation. NaN where
    the effect is not tested so.
    """

    effect: str
    df: int
    sum_of_squares: float
    f: float = float("nan")
    z: float = float("nan")
    p: float = float("nan")


@one_blas_thread()
def procrustes_anova(shapes: FloatArray, terms: Mapping[str, FloatArray]) -> tuple[AnovaRow, ...]:
    """Split the variation of shapes into what each term explains beyond the terms before it.

    Sums of squares are of Procrustes distances to what a linear model predicts (Goodall), in sequence (type I). The
    residuals of the model without a term are permuted among the shapes; the statistic is F.

    Parameters
    ----------
    shapes : ndarray, shape (N, m)
        Superimposed shapes of unit centroid size, or their scores on all principal components.
    terms : mapping of str to ndarray, shape (N, c)
        Columns of the design without the constant.

    Returns
    -------
    tuple of AnovaRow
        One per term, ``residual``, ``total``.

    References
    ----------
    Goodall, Procrustes methods in the statistical analysis of shape, JRSS B 53 (1991). Anderson, A new method for
    non-parametric multivariate analysis of variance, Austral Ecology 26 (2001). Collyer and Adams, RRPP: an R package
    for fitting linear models to high-dimensional data using residual randomization, MEE 9 (2018).
    """
    values, orders = _prepared(shapes)
    fit, ends = np.full((len(values), 1), len(values) ** -0.5), [1]
    for columns in terms.values():
        new, sizes, _ = np.linalg.svd(columns - fit @ (fit.T @ columns), full_matrices=False)
        fit = np.hstack([fit, new[:, sizes > _NOTHING * np.linalg.norm(columns)]])
        ends.append(fit.shape[1])
    left = len(values) - ends[-1]
    if left < 1:
        raise InputError(f"terms: {ends[-1]} columns leave nothing to compare in {len(values)} shapes")
    rows = []
    for name, low, high in zip(terms, ends[:-1], ends[1:], strict=True):
        rest = values - fit[:, :low] @ (fit[:, :low].T @ values)
        explained = np.array([((fit.T @ rest[order]) ** 2).sum(axis=1) for order in orders])
        squares, residual = explained[:, low:high].sum(axis=1), (rest**2).sum() - explained.sum(axis=1)
        ratios = squares * left / np.maximum(residual * (high - low), np.finfo(float).tiny)
        found = Effects.of(ratios[:, None] if high > low else np.full((1, 1), np.nan))
        f, z, p = (float(one[0]) for one in (found.values, found.z, found.p))
        rows.append(AnovaRow(effect=name, df=high - low, sum_of_squares=float(squares[0]), f=f, z=z, p=p))
    total = float((values**2).sum())
    rest_squares = total - sum(row.sum_of_squares for row in rows)
    rows.append(AnovaRow(effect="residual", df=left, sum_of_squares=rest_squares))
    return (*rows, AnovaRow(effect="total", df=len(values) - 1, sum_of_squares=total))


@one_blas_thread()
def compare_groups(shapes: FloatArray, labels: Sequence[str]) -> tuple[dict[str, float], Effects, Effects]:
    """Compare the means and the disparities of every two groups.

    Shapes are permuted among all groups for the means, distances to the own group's mean for the disparities.

    Parameters
    ----------
    shapes : ndarray, shape (N, m)
    labels : sequence of str, length N
        Of two groups or more, each of two shapes or more.

    Returns
    -------
    disparities : dict of str to float
        Of every group, in alphabetical order: squared distances to the mean, summed, by one less than its members.
    distances, differences : Effects
        Distance of the means and difference of the disparities of the first and second group, first and third, ...

    References
    ----------
    Zelditch, Swiderski and Sheets, Geometric Morphometrics for Biologists (2012), chapter 10. Collyer and Adams 2018.
    """
    values, orders = _prepared(shapes)
    groups, rows, counts = np.unique(np.array(labels, dtype=str), return_inverse=True, return_counts=True)
    if len(groups) < 2 or counts.min() < 2:
        raise InputError("labels: expected two groups or more of two shapes or more")
    average = (rows == np.arange(len(groups))[:, None]) / counts[:, None]
    squares = ((values - (average @ values)[rows]) ** 2).sum(axis=1) * (counts / (counts - 1))[rows]
    disparities = squares[orders] @ average.T
    one, other = np.triu_indices(len(groups), 1)
    distances = Effects.of(np.array([pdist(average @ values[order]) for order in orders]))
    differences = Effects.of(np.abs(disparities[:, one] - disparities[:, other]))
    return dict(zip(groups.tolist(), disparities[0].tolist(), strict=True)), distances, differences


def _prepared(shapes: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return centred shapes, and orders of them: that found, then random ones, which no order of files decides."""
    values = shapes - shapes.mean(axis=0)
    ranked = np.argsort((values**2).sum(axis=1), kind="stable")
    orders = np.tile(np.arange(len(values)), (NUM_PERMUTATIONS + 1, 1))
    orders[1:, ranked] = ranked[np.random.default_rng(SEED).permuted(orders[1:], axis=1)]
    return values, orders
