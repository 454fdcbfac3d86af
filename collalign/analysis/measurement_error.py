"""The error of measurement: individuals that were measured again, their repeatability and their Procrustes ANOVA."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from collalign.analysis.paired_sides import INDIVIDUAL, SUPERIMPOSED, indicators, labels_of
from collalign.analysis.procrustes import generalized_procrustes, principal_components
from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED, AnovaRow, procrustes_anova
from collalign.analysis.symmetry import means_of_rows
from data_tools.arrays import FloatArray, IntArray, as_floats, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasurementError:
    """How well shapes are measured again. Arrays are read-only.

    Attributes
    ----------
    individuals : tuple of str, length n
        In alphabetical order.
    counts : ndarray of int, shape (n,)
        How often each was measured.
    spreads : ndarray, shape (n,)
        Root mean square distance of the measurements of each from their mean, with one less than their count in the
        denominator; NaN of those measured once.
    repeatability : float
        Intraclass correlation: the share of the variance of one measurement that is among individuals. Below 0 where
        individuals differ less than their measurements let expect.
    r2 : float
        Share of the sum of squares that is among individuals.
    anova : tuple of AnovaRow
        ``individual``, ``residual`` (error of measurement) and ``total``, degrees of freedom as in
        :class:`collalign.analysis.paired_sides.PairedSides`.
    """

    individuals: tuple[str, ...]
    counts: IntArray
    spreads: FloatArray
    repeatability: float
    r2: float
    anova: tuple[AnovaRow, ...]


def check_repeats(individuals: Sequence[str]) -> None:
    """Refuse individuals (N,), ``""`` where unknown, of which there are not two, or of which none is there twice.

    Raises
    ------
    InputError
        Saying how many there are.
    """
    counts = Counter(who for who in individuals if who)
    if len(counts) < 2 or max(counts.values()) < 2:
        raise InputError(
            f"individuals: {counts.total()} shapes are of {len(counts)} individuals; the error of measurement needs "
            "two individuals at least, of which some were measured twice"
        )


@one_blas_thread()
def measurement_error(
    samples: ArrayLike,
    individuals: Sequence[str],
    *,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> MeasurementError:
    """Split configurations that were measured repeatedly into individuals and the error of measurement.

    Parameters
    ----------
    samples : array_like, shape (N, k, 3)
        Complete; of opposite sides those of one have been reflected already.
    individuals : sequence of str, length N
        Whom, or what, each configuration is a measurement of; ``""`` where unknown, which does not count.
    permutations, seed : int
        As in :func:`collalign.analysis.shape_tests.procrustes_anova`.

    Raises
    ------
    InputError
        If points are missing, there are fewer than two individuals, or none was measured twice.

    References
    ----------
    Lessells and Boag, Unrepeatable repeatabilities: a common mistake, The Auk 104 (1987): also where counts differ.
    Fruciano, Measurement error in geometric morphometrics, Development Genes and Evolution 226 (2016).

    Examples
    --------
    >>> landmarks, specimens = np.load("landmarks.npy"), np.repeat(["a", "b", "c", "d", "e", "f"], 2)
    >>> collalign.statistics.measurement_error(landmarks, specimens).repeatability > 0.9
    True
    """
    points = as_floats(samples, "samples", shape=(None, None, 3))
    owners = labels_of(len(points), individuals, "individuals")
    check_repeats(individuals)
    known = np.asarray(owners != "")
    kinds, rows, counts = np.unique(owners[known], return_inverse=True, return_counts=True)
    aligned = generalized_procrustes(points[known])
    scores = principal_components(aligned).scores
    among, within, total = procrustes_anova(
        scores, {INDIVIDUAL: indicators(rows)}, permutations=permutations, seed=seed
    )
    mean_squares = among.sum_of_squares / among.df, within.sum_of_squares / within.df
    size = (len(rows) - (counts**2).sum() / len(rows)) / (len(kinds) - 1)
    variance = (mean_squares[0] - mean_squares[1]) / size
    whole = variance + mean_squares[1]
    apart = ((aligned - means_of_rows(aligned, rows, counts)[rows]) ** 2).sum(axis=(1, 2))
    squares = np.bincount(rows, weights=apart)
    per_shape = 3 * aligned.shape[1] - SUPERIMPOSED
    return MeasurementError(
        individuals=tuple(kinds.tolist()),
        counts=read_only(counts),
        spreads=read_only(
            np.where(counts > 1, np.sqrt(squares / np.maximum(counts - 1, 1)), np.nan)
        ),
        repeatability=float(variance / whole) if whole > 0 else float("nan"),
        r2=among.sum_of_squares / total.sum_of_squares
        if total.sum_of_squares > 0
        else float("nan"),
        anova=tuple(
            replace(row, df=row.df * per_shape, plain_df=row.df) for row in (among, within, total)
        ),
    )
