"""Superimposed shapes against size, covariates and groups: Procrustes ANOVA, pairs of groups, disparity, slopes.

Every P is by permutation: of the residuals of the model without what is tested (Collyer and Adams 2018).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from data_tools.checks import check_choice
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Random permutations, and the seed of their generator, where nothing else is asked for.
NUM_PERMUTATIONS, SEED = 999, 0
#: Each term beyond those before it, or beyond all others that do not contain it.
SEQUENTIAL, MARGINAL = "I", "II"
SUMS_OF_SQUARES = (SEQUENTIAL, MARGINAL)
#: A column adds nothing to those before it if less than this part of it is new.
_NO_COLUMN = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class Effects:
    """Numbers that are the larger, the stronger an effect is, with what permutations make of them.

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
        z = np.where(spread > 0, logs[0] - logs.mean(axis=0), np.nan) / np.where(
            spread > 0, spread, 1.0
        )
        p = np.where(
            np.isnan(permuted[0]), np.nan, (permuted >= permuted[0] * (1 - 1e-12)).mean(axis=0)
        )
        return cls(values=permuted[0], z=z, p=p)

    @property
    def holm(self) -> FloatArray:
        """The p adjusted to the number of tests by Holm's method, shape (t,)."""
        return holm(self.p)


def holm(p: FloatArray) -> FloatArray:
    """Return p, shape (t,), adjusted to the number of tests by Holm's method, shape (t,)."""
    order = np.argsort(p, kind="stable")
    raised = np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1))
    adjusted = np.empty(len(order))
    adjusted[order] = np.minimum(raised, 1.0)
    return adjusted


@dataclass(frozen=True, kw_only=True, eq=False)
class AnovaRow:
    """A row of a Procrustes ANOVA, at unit centroid size.

    F is the mean square over that of the effect it is tested against; effect size and P are by permutation. NaN where
    the effect is not tested so. ``plain_df`` counts configurations where ``df`` counts their coordinates.
    """

    effect: str
    df: int
    sum_of_squares: float
    f: float = float("nan")
    z: float = float("nan")
    p: float = float("nan")
    plain_df: int | None = None


@one_blas_thread()
def procrustes_anova(
    shapes: FloatArray,
    terms: Mapping[str, FloatArray],
    *,
    sums: str = SEQUENTIAL,
    against: Mapping[str, str] = MappingProxyType({}),
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> tuple[AnovaRow, ...]:
    """Split the variation of shapes into what each term of a linear model explains.

    Sums of squares are of Procrustes distances to what the model predicts (Goodall). The residuals of the model
    without a term are permuted among the shapes. F is over the residual mean square of the whole model, or over that
    of another term.

    Parameters
    ----------
    shapes : ndarray, shape (N, m)
        Superimposed shapes of unit centroid size, or their scores on all principal components.
    terms : mapping of str to ndarray, shape (N, c)
        Columns of the design without the constant. A term ``a:b`` contains the terms ``a`` and ``b``.
    sums : {"I", "II"}
        Sums of squares: sequential, each term beyond those before it (I), or marginal, each beyond all others that do
        not contain it (II). Those of type II do not add up to the total where terms overlap.
    against : mapping of str to str
        Terms whose F is over the mean square of another term, for instance of an interaction with a random one.
    permutations, seed : int
        How many random permutations, and the seed of their generator.

    Returns
    -------
    tuple of AnovaRow
        One per term, ``residual``, ``total``.

    Raises
    ------
    InputError
        If the terms leave nothing to compare.

    References
    ----------
    Goodall, Procrustes methods in the statistical analysis of shape, JRSS B 53 (1991). Anderson, A new method for
    non-parametric multivariate analysis of variance, Austral Ecology 26 (2001). Collyer and Adams, RRPP: an R package
    for fitting linear models to high-dimensional data using residual randomization, MEE 9 (2018).

    Examples
    --------
    >>> aligned = collalign.statistics.generalized_procrustes(np.load("landmarks.npy"))
    >>> age = np.arange(12.0)[:, None]
    >>> rows = collalign.statistics.procrustes_anova(aligned.reshape(12, -1), {"age": age})
    >>> [(row.effect, row.df) for row in rows]
    [('age', 1), ('residual', 10), ('total', 11)]
    """
    check_choice("sums", sums, SUMS_OF_SQUARES)
    values, orders = with_orders(shapes, permutations, seed)
    whole = _basis(terms.values(), len(values))
    left = len(values) - whole.shape[1]
    if left < 1:
        raise InputError(
            f"terms: {whole.shape[1]} columns leave nothing to compare in {len(values)} shapes"
        )
    spaces = {}
    for name in terms:
        before = [terms[other] for other in _reduced(name, [*terms], sums)]
        low, high = (_basis(columns, len(values)) for columns in (before, [*before, terms[name]]))
        spaces[name] = low, high[:, low.shape[1] :]
    rows = []
    for name, (low, own) in spaces.items():
        rest = values - low @ (low.T @ values)
        squares = _squares(own, rest, orders)
        if name in against:
            error = spaces[against[name]][1]
            below, df_below = _squares(error, rest, orders), error.shape[1]
        else:
            below, df_below = (rest**2).sum() - _squares(whole, rest, orders), left
        df = own.shape[1]
        ratios = squares * df_below / np.maximum(below * df, np.finfo(float).tiny)
        found = Effects.of(ratios[:, None] if df else np.full((1, 1), np.nan))
        f, z, p = (float(one[0]) for one in (found.values, found.z, found.p))
        rows.append(AnovaRow(effect=name, df=df, sum_of_squares=float(squares[0]), f=f, z=z, p=p))
    total = float((values**2).sum())
    remaining = total - float(((whole.T @ values) ** 2).sum())
    rows.append(AnovaRow(effect="residual", df=left, sum_of_squares=remaining))
    return (*rows, AnovaRow(effect="total", df=len(values) - 1, sum_of_squares=total))


@one_blas_thread()
def compare_groups(
    shapes: FloatArray,
    labels: Sequence[str],
    *,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> tuple[dict[str, float], Effects, Effects]:
    """Compare the means and the disparities of every two groups.

    Shapes are permuted among all groups for the means, distances to the own group's mean for the disparities.

    Parameters
    ----------
    shapes : ndarray, shape (N, m)
    labels : sequence of str, length N
        Of two groups or more, each of two shapes or more.
    permutations, seed : int
        As in :func:`procrustes_anova`.

    Returns
    -------
    disparities : dict of str to float
        Of every group, in alphabetical order: squared distances to the mean, summed, by one less than its members.
    distances, differences : Effects
        Distance of the means and difference of the disparities of the first and second group, first and third, ...

    Raises
    ------
    InputError
        If there are fewer than two groups, or a group has one shape.

    References
    ----------
    Zelditch, Swiderski and Sheets, Geometric Morphometrics for Biologists (2012), chapter 10. Collyer and Adams 2018.
    """
    values, orders = with_orders(shapes, permutations, seed)
    groups, rows, counts = _groups(labels)
    average = (rows == np.arange(len(groups))[:, None]) / counts[:, None]
    squares = ((values - (average @ values)[rows]) ** 2).sum(axis=1) * (counts / (counts - 1))[rows]
    disparities = squares[orders] @ average.T
    one, other = np.triu_indices(len(groups), 1)
    distances = Effects.of(
        np.array([scipy.spatial.distance.pdist(average @ values[order]) for order in orders])
    )
    differences = Effects.of(np.abs(disparities[:, one] - disparities[:, other]))
    return dict(zip(groups, disparities[0].tolist(), strict=True)), distances, differences


@one_blas_thread()
def compare_held(
    shapes: FloatArray,
    labels: Sequence[str],
    held: FloatArray,
    *,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> Effects:
    """Compare the means of every two groups at the same values of what is held constant, for instance size.

    The means are those that a linear model with common slopes predicts at the mean of ``held`` (least-squares
    means). The residuals of the model without groups are permuted.

    Parameters
    ----------
    shapes : ndarray, shape (N, m)
    labels : sequence of str, length N
        Of two groups or more, each of two shapes or more.
    held : ndarray, shape (N, c)
        Columns that are held constant.
    permutations, seed : int
        As in :func:`procrustes_anova`.

    Returns
    -------
    Effects
        Distance of the adjusted means of the first and second group, first and third, ...

    Raises
    ------
    InputError
        If there are fewer than two groups, a group has one shape, or nothing is left to compare.
    """
    groups, rows, _ = _groups(labels)
    indicators = (rows[:, None] == np.arange(len(groups))).astype(np.float64)
    design = np.hstack([indicators, held - held.mean(axis=0)])
    return _of_coefficients(
        shapes,
        design,
        held,
        lambda found: scipy.spatial.distance.pdist(found[: len(groups)]),
        permutations=permutations,
        seed=seed,
    )


@one_blas_thread()
def compare_slopes(
    shapes: FloatArray,
    labels: Sequence[str],
    along: FloatArray,
    *,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> tuple[Effects, FloatArray]:
    """Compare how shape changes with a covariate, for instance log size, in every two groups.

    The residuals of the model with common slopes are permuted.

    Parameters
    ----------
    shapes : ndarray, shape (N, m)
    labels : sequence of str, length N
        Of two groups or more.
    along : ndarray, shape (N,)
        The covariate.
    permutations, seed : int
        As in :func:`procrustes_anova`.

    Returns
    -------
    differences : Effects
        Length of the difference of both slopes: Procrustes distance per unit of the covariate.
    angles_deg : ndarray, shape (t,)
        Between both slopes.

    Raises
    ------
    InputError
        If there are fewer than two groups, a group has one shape, or the covariate is the same in all of a group.
    """
    groups, rows, _ = _groups(labels)
    indicators = (rows[:, None] == np.arange(len(groups))).astype(np.float64)
    design = np.hstack([indicators, indicators * along[:, None]])
    common = np.hstack([indicators[:, 1:], along[:, None]])
    num = len(groups)
    differences = _of_coefficients(
        shapes,
        design,
        common,
        lambda found: scipy.spatial.distance.pdist(found[num:]),
        permutations=permutations,
        seed=seed,
    )
    slopes = np.linalg.lstsq(design, shapes - shapes.mean(axis=0), rcond=None)[0][num:]
    lengths = np.linalg.norm(slopes, axis=1)
    cosines = [
        slopes[a] @ slopes[b] / max(lengths[a] * lengths[b], 1e-300)
        for a, b in combinations(range(num), 2)
    ]
    return differences, np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))


def _of_coefficients(
    shapes: FloatArray,
    design: FloatArray,
    reduced: FloatArray,
    statistic: Callable[[FloatArray], FloatArray],
    *,
    permutations: int,
    seed: int,
) -> Effects:
    """Return a statistic of the coefficients (c, m) of a design; the residuals of a reduced one are permuted."""
    values, orders = with_orders(shapes, permutations, seed)
    if np.linalg.matrix_rank(design) < design.shape[1] or len(values) <= design.shape[1]:
        raise InputError(
            f"labels: {len(values)} shapes do not tell {design.shape[1]} columns of the model apart; "
            "give more shapes, or fewer groups or covariates"
        )
    low, solve = _basis([reduced], len(values)), np.linalg.pinv(design)
    fitted = low @ (low.T @ values)
    rest = values - fitted
    return Effects.of(np.array([statistic(solve @ (fitted + rest[order])) for order in orders]))


def _groups(labels: Sequence[str]) -> tuple[list[str], IntArray, IntArray]:
    """Return the names of the groups, the group of each shape and the counts; two groups of two shapes or more."""
    groups, rows, counts = np.unique(
        np.array(labels, dtype=str), return_inverse=True, return_counts=True
    )
    if len(groups) < 2 or counts.min() < 2:
        raise InputError("labels: expected two groups or more of two shapes or more")
    return groups.tolist(), rows, counts


def _reduced(term: str, terms: Sequence[str], sums: str) -> list[str]:
    """Return the terms that a term is tested beyond."""
    if sums == SEQUENTIAL:
        return list(terms[: terms.index(term)])
    own = {*term.split(":")}
    return [other for other in terms if other != term and not own <= {*other.split(":")}]


def _squares(basis: FloatArray, values: FloatArray, orders: IntArray) -> FloatArray:
    """Return the sum of squares of values (N, m), in each order, along orthonormal columns (N, c)."""
    return np.array([((basis.T @ values[order]) ** 2).sum() for order in orders])


def _basis(terms: Iterable[FloatArray], num: int) -> FloatArray:
    """Return orthonormal columns (num, c): the constant, then what each term adds to those before it."""
    fit = np.full((num, 1), num**-0.5)
    for columns in terms:
        new, sizes, _ = np.linalg.svd(columns - fit @ (fit.T @ columns), full_matrices=False)
        fit = np.hstack([fit, new[:, sizes > _NO_COLUMN * np.linalg.norm(columns)]])
    return fit


def with_orders(shapes: FloatArray, permutations: int, seed: int) -> tuple[FloatArray, IntArray]:
    """Return centred shapes, and orders of them: that found, then random ones, which no order of files decides."""
    values = shapes - shapes.mean(axis=0)
    ranked = np.argsort((values**2).sum(axis=1), kind="stable")
    orders = np.tile(np.arange(len(values)), (permutations + 1, 1))
    orders[1:, ranked] = ranked[np.random.default_rng(seed).permuted(orders[1:], axis=1)]
    return values, orders
