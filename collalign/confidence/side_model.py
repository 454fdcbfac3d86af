"""Whether a collection mixes left and right specimens, from two kinds of evidence.

*Fits*: pairs are matched as they are and mirrored. The logarithm of mirrored to plain energy of a pair says how much
better the plain pose is. If left and right specimens are mixed, the shapes fall into two sides so that pairs within a
side prefer the plain and pairs between sides the mirrored pose. But a bilateral body that bends prefers mirror images
of others as clearly: where it bends to the other side.

*Surfaces*: the chirality of each surface by itself (:mod:`data_tools.embedding.chirality`), which no pose enters and
which bending hardly changes. Two bilateral bodies have a score near 0 in any posture, two specimens of opposite sides
a negative one. It is too noisy to name the side of each molar, but tells whether the sides that fits find are real,
and names the sides of strongly chiral shapes by itself.

``python -m experiments calibrate sides`` tries other thresholds of fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from collalign.synchronization.spectral import synchronize_signs
from data_tools.arrays import BoolArray, FloatArray, IntArray, as_indices, read_only
from data_tools.errors import InputError
from data_tools.surface.topology import vertex_components

#: Fewer shapes than this are mirrored by their surfaces alone, not by fits: any few pairs agree with some two sides.
MIN_SHAPES_FOR_SIDES = 6
#: Sides that fits find are real where their median preference over all pairs, times their agreement by surfaces, is
#: at least this, and at most this share of the preferences contradicts them.
LEAST_CONFIRMED, MOST_CONTRADICTED = 1.1e-4, 0.04
#: Sides that are not confirmed stay open where fits suspect them and surfaces agree with them at least by the
#: first, or where the sides that surfaces support best agree at least by the second.
LEAST_OPEN, LEAST_OPEN_ALONE = 1.85e-4, 6e-4
#: Two sides of one kind fit each other, one of them mirrored or not, up to so many times as badly as each side fits
#: itself.
MOST_BETWEEN = 2.0
#: Surfaces name the sides alone where the support of every shape is at least the first. They are in doubt where one
#: place of 15 % of the area tells the second share of them, in the median shape.
LEAST_ALONE, LARGEST_PLACE = 1e-3, 0.47
#: Sides that fits find likely: least median preference between them, most contradicted, least balance; half of the
#: first, over few pairs, makes it worth to match more.
LIKELY_BETWEEN, LIKELY_CONTRADICTED, LIKELY_BALANCE = 0.085, 0.1, 0.8
#: Least sum of a shape's preferences by that of their sizes at which its side is sure, where sides are not clear.
LEAST_OWN = 0.6
#: Shapes whose own mirror images cost so much less on them than the shapes that they are most like have no side that
#: matters: a mirror image is the same pose. Median of the mean logarithms of both ratios, of gaps and of mismatches;
#: what is added to these.
BILATERAL, LEAST_MISMATCH = -0.5, 0.05
#: So many pairs settle the matter at once if both medians are that large.
MANY_PAIRS, LEAST_OBVIOUS = 100, 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Sides:
    """Two sides and how clearly fits of pairs show them.

    A preference is the log of the ratio of energies, positive where it agrees with the sides.

    Attributes
    ----------
    mirrored : ndarray of bool, shape (N,)
        The smaller side of each connected part; the side without its first shape where both are equal.
    unsure : ndarray of bool, shape (N,)
        Shapes whose own pairs contradict each other about their side.
    num_pairs : int
        Pairs that could be compared.
    num_between : int
        Those between the sides.
    median_all, median_between : float
        Median preference of all pairs and of those between the sides; NaN without pairs.
    contradicted : float
        Share of the preferences, by size, that contradict the sides.
    balance : float
        Sum of the preferences between the sides by the sum of their sizes, in [-1, 1]; NaN without pairs.
    """

    mirrored: BoolArray
    unsure: BoolArray
    num_pairs: int
    num_between: int
    median_all: float
    median_between: float
    contradicted: float
    balance: float

    @property
    def are_suspected(self) -> bool:
        """Whether both sides may be there: worth more pairs."""
        return bool(
            self.num_between > 0 and min(self.median_all, self.median_between) >= LIKELY_BETWEEN / 2
        )

    @property
    def are_likely(self) -> bool:
        """Whether both sides are as likely there as not; a few shapes say as much as many."""
        return bool(
            self.are_suspected
            and self.median_between >= LIKELY_BETWEEN
            and self.contradicted <= LIKELY_CONTRADICTED
            and self.balance >= LIKELY_BALANCE
        )

    @property
    def are_obvious(self) -> bool:
        """Whether more pairs could not change the verdict that both sides are likely."""
        return bool(
            self.are_likely
            and self.num_pairs >= MANY_PAIRS
            and min(self.median_all, self.median_between) >= LEAST_OBVIOUS
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceSides:
    """What the chirality of surfaces says of two sides.

    Attributes
    ----------
    mirrored : ndarray of bool, shape (N,)
        The smaller side.
    support : ndarray, shape (N,)
        Mean over the other shapes of the score, negated for those of the other side; NaN where the surface has none.
    across : float
        Mean negated score over the pairs between the sides; NaN without any.
    """

    mirrored: BoolArray
    support: FloatArray
    across: float

    @property
    def are_known(self) -> bool:
        """Whether enough surfaces have an outer side to tell."""
        return bool(np.isfinite(self.across))

    @property
    def agreement(self) -> float:
        """How far the surfaces confirm these sides: over all pairs and over those between them, the smaller one."""
        return min(float(np.nanmean(self.support)), self.across) if self.are_known else np.nan

    @property
    def are_clear(self) -> bool:
        """Whether the surfaces name both sides without any other evidence."""
        return bool(self.are_known and self.support.min() >= LEAST_ALONE)


def lie_in_one_place(shares: FloatArray) -> bool:
    """Whether one place of each surface tells its side: an injury does as well, on either side of one body.

    Parameters
    ----------
    shares : ndarray, shape (N,)
        From :func:`data_tools.embedding.chirality.place_shares`.
    """
    return bool(np.nanmedian(shares) >= LARGEST_PLACE)


def surface_sides(scores: FloatArray, mirrored: BoolArray | None = None) -> SurfaceSides:
    """Judge two sides by the chirality of surfaces, by default the sides that these support best.

    Parameters
    ----------
    scores : ndarray, shape (N, N)
        From :func:`data_tools.embedding.chirality.chirality_scores`; NaN where unknown.
    mirrored : ndarray of bool, shape (N,), optional
    """
    num = len(scores)
    if mirrored is None:
        pairs = np.stack(np.triu_indices(num, 1), axis=1)
        of_pairs = np.nan_to_num(scores[pairs[:, 0], pairs[:, 1]])
        mirrored = _best_sides(
            pairs, of_pairs / max(np.abs(of_pairs).max(initial=0.0), np.finfo(float).tiny), num
        )
    between = mirrored[:, None] != mirrored
    agreement = np.where(between, -scores, scores)
    known = np.isfinite(agreement)
    support = np.where(known, agreement, 0.0).sum(axis=1) / np.where(
        known.any(axis=1), known.sum(axis=1), np.nan
    )
    across = agreement[between & known]
    return SurfaceSides(
        mirrored=read_only(mirrored.copy()),
        support=read_only(support),
        across=float(across.mean()) if len(across) else np.nan,
    )


def are_mixed(fits: Sides, surfaces: SurfaceSides) -> bool:
    """Whether both sides are there: fits find them clearly, and surfaces confirm them.

    Parameters
    ----------
    fits : Sides
    surfaces : SurfaceSides
        Of the same sides.
    """
    return bool(
        len(fits.mirrored) >= MIN_SHAPES_FOR_SIDES
        and fits.are_likely
        and fits.contradicted <= MOST_CONTRADICTED
        and fits.median_all * surfaces.agreement >= LEAST_CONFIRMED
    )


def are_open(fits: Sides, surfaces: SurfaceSides) -> bool:
    """Whether sides that are not confirmed may be real. Few shapes, or surfaces without an outer side, never tell.

    Parameters
    ----------
    fits : Sides
    surfaces : SurfaceSides
        Of the same sides.
    """
    if len(fits.mirrored) < MIN_SHAPES_FOR_SIDES or not surfaces.are_known:
        return fits.are_likely
    return fits.are_suspected and surfaces.agreement >= LEAST_OPEN


def look_like_posture(fits: Sides, surfaces: SurfaceSides) -> bool:
    """Whether fits find sides that are none: the surfaces do not turn the other way.

    Parameters
    ----------
    fits : Sides
    surfaces : SurfaceSides
        Of the same sides.
    """
    return fits.are_likely and not are_open(fits, surfaces)


def are_one_kind(mirrored: BoolArray, edges: IntArray, energies: FloatArray) -> bool:
    """Whether pairs between two sides fit about as well as pairs within them: shapes of two kinds do not.

    Parameters
    ----------
    mirrored : ndarray of bool, shape (N,)
    edges : ndarray of int, shape (E, 2)
    energies : ndarray, shape (E, 2)
        Least energy of each pair as it is, and with one shape mirrored.
    """
    least = energies.min(axis=1)
    between = mirrored[edges[:, 0]] != mirrored[edges[:, 1]]
    if between.all() or not between.any():
        return bool(between.any())
    return bool(np.median(least[between]) <= MOST_BETWEEN * np.median(least[~between]))


def undecided_sides(
    fits: Sides, surfaces: SurfaceSides, alone: SurfaceSides, *, one_kind: bool = True
) -> BoolArray:
    """Return which shapes may be mirror images of the others although nothing is mirrored, shape (N,).

    Parameters
    ----------
    fits : Sides
        Not confirmed.
    surfaces : SurfaceSides
        Of the same sides.
    alone : SurfaceSides
        The sides that surfaces support best.
    one_kind : bool
        Whether these are sides of one kind of shapes (:func:`are_one_kind`): two kinds are no sides.
    """
    is_open = are_open(fits, surfaces)
    is_seen = alone.agreement >= LEAST_OPEN_ALONE or (is_open and surfaces.agreement >= LEAST_OPEN)
    return ((fits.mirrored | fits.unsure) & is_open) | (alone.mirrored & is_seen & one_kind)


def are_bilateral(mirrored: FloatArray, others: FloatArray) -> bool:
    """Whether most of some shapes are nearly their own mirror images, compared with how they differ from others.

    Parameters
    ----------
    mirrored : ndarray, shape (n, 2)
        Gap and mismatch of each shape with its own mirror image; a mismatch that is not known is NaN.
    others : ndarray, shape (n, 2)
        The same with the shapes that it is most like, mirrored or not.
    """
    added = [0.0, LEAST_MISMATCH]
    ratios = np.log(np.maximum(mirrored + added, np.finfo(float).tiny)) - np.log(
        np.maximum(others + added, np.finfo(float).tiny)
    )
    ratios[:, 1] = np.where(np.isnan(ratios[:, 1]), ratios[:, 0], ratios[:, 1])
    return bool(np.median(ratios.mean(axis=1)) < BILATERAL)


def find_sides(edges: ArrayLike, energies: ArrayLike, num_shapes: int) -> Sides:
    """Find the two sides that agree best with the pairs.

    Parameters
    ----------
    edges : array_like of int, shape (E, 2)
    energies : array_like, shape (E, 2)
        Least energy of each pair as it is, and with one shape mirrored; pairs with NaN are left out.
    num_shapes : int

    Raises
    ------
    InputError
        If the arrays do not fit.
    """
    pairs = as_indices(edges, "edges", upper=num_shapes, shape=(None, 2))
    both = np.asarray(energies, dtype=np.float64)
    if both.shape != (len(pairs), 2):
        raise InputError(f"energies: expected shape ({len(pairs)}, 2), got {both.shape}")
    known = np.isfinite(both).all(axis=1)
    pairs, preference = pairs[known], preferences(both[known])
    if not len(pairs):
        return _summary(np.zeros(num_shapes, dtype=np.bool_), pairs, preference)
    return _summary(_best_sides(pairs, preference, num_shapes), pairs, preference)


def preferences(energies: FloatArray) -> FloatArray:
    """Return the log of mirrored to plain energies (E, 2) of pairs, shape (E,), within a factor of e^5."""
    least = energies.max(axis=1, keepdims=True) * np.exp(-5.0) + np.finfo(float).tiny
    plain, mirrored = np.log(np.maximum(energies, least)).T
    return np.asarray(mirrored - plain)


def _best_sides(pairs: IntArray, evidence: FloatArray, num_shapes: int) -> BoolArray:
    """Return the smaller of the two sides that agree best with pairs' evidence, positive for the same side."""
    # A pair without any evidence keeps its edge, so that the graph stays connected.
    weights = np.maximum(np.abs(evidence), 1e-6)
    signs = np.where(evidence >= 0, 1.0, -1.0)
    return _smaller_sides(synchronize_signs(pairs, signs, weights, num_shapes), pairs)


def _smaller_sides(mirrored: BoolArray, pairs: IntArray) -> BoolArray:
    """Return the sides, turned round in each connected part so that the smaller one is mirrored."""
    part = vertex_components(len(mirrored), [pairs])[1]
    return np.asarray(
        mirrored ^ (2 * np.bincount(part, weights=mirrored) > np.bincount(part))[part]
    )


def _summary(mirrored: BoolArray, pairs: IntArray, preference: FloatArray) -> Sides:
    between = mirrored[pairs[:, 0]] != mirrored[pairs[:, 1]]
    agreement = np.where(between, -preference, preference)
    across, total = agreement[between], np.abs(preference).sum()
    for_side, all_own = (
        np.bincount(pairs.ravel(), weights=np.repeat(sizes, 2), minlength=len(mirrored))
        for sizes in (agreement, np.abs(preference))
    )
    return Sides(
        mirrored=read_only(mirrored.copy()),
        unsure=read_only(for_side < LEAST_OWN * all_own),
        num_pairs=len(pairs),
        num_between=int(between.sum()),
        median_all=float(np.median(agreement)) if len(pairs) else np.nan,
        median_between=float(np.median(across)) if len(across) else np.nan,
        contradicted=float(np.maximum(-agreement, 0.0).sum() / total) if total else 0.0,
        balance=float(across.sum() / np.abs(across).sum()) if np.abs(across).sum() else np.nan,
    )
