"""Whether a collection mixes left and right specimens, from pairs matched as they are and mirrored.

The logarithm of mirrored to plain energy of a pair says how much better the plain pose is. If left and right
specimens are mixed, the shapes fall into two sides so that pairs within a side prefer the plain and pairs between
sides the mirrored pose, all clearly. Nearly bilateral shapes prefer one or the other a little, at random: two sides
can be found that agree with most of that as well, the more so the fewer pairs there are, but the preferences
are weak (chairs, insects) or contradict each other around cycles (bodies and toys in asymmetric poses).

The thresholds were set on molars of both sides, of one side, and with single mirrored specimens, and on chairs,
glasses, ants, teddies, human bodies and skull landmarks, in random subsets of 6 to 116 shapes, and on generated
crowns; ``python -m experiments calibrate sides`` tries others on subsets of 24 shapes of most of these: 97 % of the
subsets of molars are judged rightly and no other shape is mirrored. Nor is one of 400 subsets of birds, fish, planes
and mouse skulls, which were looked at as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from collalign.synchronization.solvers.signs import synchronize_signs
from data_tools.arrays import BoolArray, FloatArray, IntArray, as_indices, read_only
from data_tools.errors import InputError

#: Fewer shapes than this are never mirrored: any few pairs agree with some two sides.
MIN_SHAPES = 6
#: Least median preference for the sides' verdict, over all pairs and over those between the sides; and what is added,
#: divided by the number of these pairs. With the second by all pairs one of eight skulls of landmarks was mirrored.
LEAST_ALL, LEAST_BETWEEN = (0.08, 1.6), (0.07, 0.8)
#: Most share of all preferences that may contradict the sides, least balance of those between the sides.
MOST_CONTRADICTED, LEAST_BALANCE = 0.04, 0.7
#: Sides that are not clear, but as likely as not: least median between them, most contradicted, least balance. Of
#: generated crowns that fell short of certainty these were there in 8 of 9 draws of both sides and in 6 of 12 with
#: one mirrored crown, and in no subset of chairs, fish, ants, skulls or crowns of one side; bodies in asymmetric
#: poses pass, but their maps say more than mirrored energies do.
LIKELY_BETWEEN, LIKELY_CONTRADICTED, LIKELY_BALANCE = 0.085, 0.1, 0.8
#: Least sum of a shape's preferences by that of their sizes at which its side is sure, where sides are not clear.
LEAST_OWN = 0.6
#: Least medians at which a few pairs make it worth to match more.
LEAST_SUSPICION = (0.06, 0.05)
#: Log-odds, divided by two, that a pair's preference is right, per unit of its preference.
TRUST = 4.0
#: So many pairs settle the matter at once if both medians are that large.
MANY_PAIRS, LEAST_OBVIOUS = 100, 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Sides:
    """Two sides and how clearly the pairs speak for them.

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
        least_all, least_between = LEAST_SUSPICION
        return bool(self.num_between > 0 and self.median_all >= least_all and self.median_between >= least_between)

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
        """Whether more pairs could not change the verdict that both sides are there."""
        return bool(
            self.are_clear
            and self.num_pairs >= MANY_PAIRS
            and min(self.median_all, self.median_between) >= LEAST_OBVIOUS
        )

    @property
    def are_clear(self) -> bool:
        """Whether both sides are there beyond doubt."""
        if len(self.mirrored) < MIN_SHAPES or not self.num_between:
            return False
        return bool(
            self.median_all >= LEAST_ALL[0] + LEAST_ALL[1] / self.num_pairs
            and self.median_between >= LEAST_BETWEEN[0] + LEAST_BETWEEN[1] / self.num_between
            and self.contradicted <= MOST_CONTRADICTED
            and self.balance >= LEAST_BALANCE
        )


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
        return _judged(np.zeros(num_shapes, dtype=np.bool_), pairs, preference)
    signs = np.where(preference >= 0, 1.0, -1.0)
    # A pair without any preference keeps its edge, so that the graph stays connected.
    weights = np.maximum(TRUST * np.abs(preference), 1e-6)
    mirrored = synchronize_signs(pairs, signs, weights, num_shapes)
    return _judged(_smaller_sides(mirrored, pairs), pairs, preference)


def preferences(energies: FloatArray) -> FloatArray:
    """Return the log of mirrored to plain energy of each pair, limited to a factor of e^5 for equal shapes."""
    least = energies.max(axis=1, keepdims=True) * np.exp(-5.0) + np.finfo(float).tiny
    plain, mirrored = np.log(np.maximum(energies, least)).T
    return np.asarray(mirrored - plain)


def _smaller_sides(mirrored: BoolArray, pairs: IntArray) -> BoolArray:
    """Return the sides, turned round in each connected part so that the smaller one is mirrored."""
    num = len(mirrored)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(num, num))
    _, part = connected_components(graph, directed=False)
    return np.asarray(mirrored ^ (2 * np.bincount(part, weights=mirrored) > np.bincount(part))[part])


def _judged(mirrored: BoolArray, pairs: IntArray, preference: FloatArray) -> Sides:
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
