"""Matching symmetry: left and right of the same individuals, and their Procrustes ANOVA."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collalign.analysis.procrustes import generalized_procrustes, principal_components
from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED, AnovaRow, procrustes_anova
from collalign.analysis.symmetry import exchange_test, means_of_rows, mirror_image
from data_tools.arrays import BoolArray, FloatArray, IntArray, as_floats, read_only
from data_tools.errors import InputError
from data_tools.notes import listed
from data_tools.threads import one_blas_thread

INDIVIDUAL, SIDE, INTERACTION = "individual", "side", "individual:side"
#: Degrees of freedom that superimposition takes from the coordinates of a configuration in space.
SUPERIMPOSED = 7


@dataclass(frozen=True, kw_only=True, eq=False)
class PairedSides:
    """Left and right of individuals, superimposed at unit centroid size. Arrays are read-only.

    Attributes
    ----------
    individuals : tuple of str, length n
        Those that have both sides, in alphabetical order.
    sides : (str, str)
        In alphabetical order.
    left_out : tuple of str
        Individuals of which one side is lacking.
    symmetric : ndarray, shape (n, k, 3)
        Mean of both sides of each individual.
    asymmetric : ndarray, shape (n, k, 3)
        The first side less the second.
    directional : ndarray, shape (k, 3)
        Mean of the asymmetric components.
    asymmetry, fluctuating : ndarray, shape (n,)
        Norm of each asymmetric component, which is the distance of both sides and 0 where they are alike, and of what
        it differs by from the directional one.
    anova : tuple of AnovaRow
        ``individual``, ``side`` (directional asymmetry), ``individual:side`` (fluctuating asymmetry), with replicates
        ``residual`` (error of measurement), and ``total``. Degrees of freedom are those of landmarks, ``plain_df``
        those of configurations; semilandmarks have fewer.
    """

    individuals: tuple[str, ...]
    sides: tuple[str, str]
    left_out: tuple[str, ...]
    symmetric: FloatArray
    asymmetric: FloatArray
    directional: FloatArray
    asymmetry: FloatArray
    fluctuating: FloatArray
    anova: tuple[AnovaRow, ...]


@one_blas_thread()
def paired_sides(
    samples: ArrayLike,
    individuals: Sequence[str],
    sides: Sequence[str],
    *,
    mirrored: str | None = None,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> PairedSides:
    """Split configurations of left and right into what individuals, sides and both together explain.

    Individuals and sides are tested against their interaction, the interaction against replicates where there are
    any. Sums of squares are sequential. P of sides is by random exchange of the sides of individuals, the others by
    permuted residuals.

    Parameters
    ----------
    samples : array_like, shape (N, k, 3)
        Complete.
    individuals, sides : sequence of str, length N
        Whom each configuration belongs to, and of which of two sides it is; ``""`` where unknown, which does not
        count. Several of one individual and side are replicates.
    mirrored : str, optional
        The side that is reflected first. Without it, configurations of one side have been reflected already, as those
        of a result are.
    permutations, seed : int
        As in :func:`collalign.analysis.shape_tests.procrustes_anova`.

    Raises
    ------
    InputError
        If points are missing, there are not two sides, or fewer than two individuals have both.

    References
    ----------
    Klingenberg and McIntyre, Geometric morphometrics of developmental instability: analyzing patterns of fluctuating
    asymmetry with Procrustes methods, Evolution 52 (1998). Palmer and Strobeck, Fluctuating asymmetry: measurement,
    analysis, patterns, Annual Review of Ecology and Systematics 17 (1986).

    Examples
    --------
    >>> bones, individuals = np.load("landmarks.npy"), np.repeat(["a", "b", "c", "d", "e", "f"], 2)
    >>> found = collalign.statistics.paired_sides(bones, individuals, ["left", "right"] * 6)
    >>> found.asymmetry.shape, found.anova[1].effect
    ((6,), 'side')
    """
    points = np.array(as_floats(samples, "samples", shape=(None, None, 3)))
    owners = labels_of(len(points), individuals, "individuals")
    ways = labels_of(len(points), sides, "sides")
    chosen, left_out, both = with_both_sides(owners, ways)
    if mirrored is not None:
        if mirrored not in both:
            raise InputError(
                f"mirrored: expected one of the sides {listed(both)}, got {mirrored!r}"
            )
        turned = ways == mirrored
        points[turned] = mirror_image(points[turned], np.arange(points.shape[1]))
    aligned = generalized_procrustes(points[chosen])
    kinds, rows = np.unique(owners[chosen], return_inverse=True)
    second = np.asarray(ways[chosen] == both[1])
    counts = np.bincount(2 * rows + second, minlength=2 * len(kinds))
    means = means_of_rows(aligned, 2 * rows + second, counts)
    first, other = means[0::2], means[1::2]
    asymmetric = first - other
    directional = asymmetric.mean(axis=0)
    anova = _anova(aligned, rows, second, permutations=permutations, seed=seed)
    return PairedSides(
        individuals=tuple(kinds.tolist()),
        sides=both,
        left_out=left_out,
        symmetric=read_only(0.5 * (first + other)),
        asymmetric=read_only(asymmetric),
        directional=read_only(directional),
        asymmetry=read_only(np.linalg.norm(asymmetric, axis=(1, 2))),
        fluctuating=read_only(np.linalg.norm(asymmetric - directional, axis=(1, 2))),
        anova=_with_exchanges(anova, asymmetric, counts, permutations=permutations, seed=seed),
    )


def labels_of(num: int, values: Sequence[str], name: str) -> NDArray[np.str_]:
    """Return labels of ``num`` configurations as an array of text, shape (N,)."""
    if len(values) != num:
        raise InputError(f"{name}: {len(values)} labels for {num} shapes")
    return np.array(values, dtype=str)


def with_both_sides(
    individuals: Sequence[str] | NDArray[np.str_], sides: Sequence[str] | NDArray[np.str_]
) -> tuple[BoolArray, tuple[str, ...], tuple[str, str]]:
    """Find the individuals of which both sides are there.

    Parameters
    ----------
    individuals, sides : sequence of str, length N
        As in :func:`paired_sides`.

    Returns
    -------
    chosen : ndarray of bool, shape (N,)
        Which shapes are of these.
    left_out : tuple of str
        Individuals of which one side is lacking.
    sides : (str, str)
        In alphabetical order.

    Raises
    ------
    InputError
        If there are not two sides, or fewer than two individuals have both.
    """
    owners, ways = np.array(individuals, dtype=str), np.array(sides, dtype=str)
    known = np.asarray((owners != "") & (ways != ""))
    kinds = sorted({*ways[known].tolist()})
    if len(kinds) != 2:
        raise InputError(
            f"sides: expected two sides, got {listed(kinds) or 'none'}; name the column that says left and right"
        )
    of_each = [{*owners[known & (ways == kind)].tolist()} for kind in kinds]
    complete = of_each[0] & of_each[1]
    if len(complete) < 2:
        raise InputError(
            f"sides: {len(complete)} individuals have both {kinds[0]!r} and {kinds[1]!r}; asymmetry is compared "
            "between two at least. Is the column of individuals the right one?"
        )
    lacking = tuple(sorted((of_each[0] | of_each[1]) - complete))
    return known & np.isin(owners, [*complete]), lacking, (kinds[0], kinds[1])


def _anova(
    aligned: FloatArray, rows: IntArray, second: BoolArray, *, permutations: int, seed: int
) -> tuple[AnovaRow, ...]:
    """Return the rows of individuals, sides and interaction, with degrees of freedom of coordinates."""
    cells = 2 * rows + second
    terms = {
        INDIVIDUAL: indicators(rows),
        SIDE: indicators(second.astype(np.int64)),
        INTERACTION: indicators(cells),
    }
    against = {INDIVIDUAL: INTERACTION, SIDE: INTERACTION}
    if len(np.unique(cells)) == len(cells):  # without replicates the interaction is what remains
        del terms[INTERACTION]
        against = {}
    found = procrustes_anova(
        principal_components(aligned).scores,
        terms,
        against=against,
        permutations=permutations,
        seed=seed,
    )
    per_shape = 3 * aligned.shape[1] - SUPERIMPOSED
    return tuple(
        replace(
            row,
            effect=row.effect if against or row.effect != "residual" else INTERACTION,
            df=row.df * per_shape,
            plain_df=row.df,
        )
        for row in found
    )


def _with_exchanges(
    anova: tuple[AnovaRow, ...],
    asymmetric: FloatArray,
    counts: IntArray,
    *,
    permutations: int,
    seed: int,
) -> tuple[AnovaRow, ...]:
    """Return the rows with the exchange test of sides."""
    weights = 1.0 / (1.0 / counts[0::2] + 1.0 / counts[1::2])
    found = exchange_test(asymmetric, weights, permutations, seed)
    z, p = float(found.z[0]), float(found.p[0])
    return tuple(replace(row, z=z, p=p) if row.effect == SIDE else row for row in anova)


def indicators(rows: IntArray) -> FloatArray:
    """Return columns of a design (N, n) that say which row each configuration belongs to."""
    return (rows[:, None] == np.unique(rows)).astype(np.float64)
