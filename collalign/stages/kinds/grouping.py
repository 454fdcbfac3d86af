"""Groups of shapes whose nearest kin is far closer than the nearest stranger, from log-odds of pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from collalign.confidence.kind_model import FEW, MOST_KIN, split_log_odds
from data_tools.arrays import BoolArray, FloatArray, IntArray

#: Members of a group that shows, with a second one, that a folder holds several kinds. Fewer may be odd or broken.
FEWEST_OF_KIND = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Grouping:
    """Shapes in groups.

    Attributes
    ----------
    labels : ndarray of int, shape (N,)
        Group of each shape, numbered by first member.
    splits : ndarray, shape (K, K)
        Log-odds that two groups are of different kinds; infinite on the diagonal. They grow by how much nearest kin
        within both groups is closer than nearest shapes across, beyond what few members ask for, and fall by how
        alike these are.
    across : ndarray, shape (K, K)
        Mean log-odds of the nearest shapes across two groups, both ways, to be of one kind.
    """

    labels: IntArray
    splits: FloatArray
    across: FloatArray

    @property
    def num(self) -> int:
        """How many groups there are."""
        return len(self.splits)

    @property
    def confidence(self) -> FloatArray:
        """How likely each group is a kind of its own, shape (K,); 1 for a single one."""
        return np.asarray(scipy.special.expit(self.splits.min(axis=1)))


def group_shapes(
    log_odds: FloatArray,
    *,
    known: IntArray | None = None,
    never_apart: BoolArray | None = None,
    least_split: float = 0.0,
) -> Grouping:
    """Join groups of shapes, the nearest first, unless they are likely of different kinds.

    Parameters
    ----------
    log_odds : ndarray, shape (N, N)
        Of two shapes being of one kind; symmetric.
    known : ndarray of int, shape (N,), optional
        Groups that are not joined with each other, from 0; -1 for shapes that may come to any.
    never_apart : ndarray of bool, shape (N,), optional
        Shapes that are no kind by themselves, be it one or two: parts of others may be so.
    least_split : float
        Log-odds above which two groups stay apart.
    """
    state = Groups(log_odds, known, never_apart)
    while (pair := state.next_pair(least_split)) is not None:
        state.join(*pair)
    return state.result()


def group_into(log_odds: FloatArray, num: int, *, known: IntArray | None = None) -> Grouping:
    """Return as many groups as asked for: likely kinds are joined only where there are too many.

    Parameters
    ----------
    log_odds : ndarray, shape (N, N)
    num : int
        From 1 to N.
    known : ndarray of int, shape (N,), optional
        See :func:`group_shapes`.
    """
    state = Groups(log_odds, known)
    for least_split in (0.0, np.inf):
        while len(state.alive) > num and (pair := state.next_pair(least_split)) is not None:
            state.join(*pair)
    return state.result()


class Groups:
    """Groups of shapes that are joined one by one; each is called by its first member.

    Parameters
    ----------
    log_odds : ndarray, shape (N, N)
    known, never_apart : ndarray, shape (N,), optional
        See :func:`group_shapes`.
    """

    def __init__(
        self,
        log_odds: FloatArray,
        known: IntArray | None = None,
        never_apart: BoolArray | None = None,
    ) -> None:
        self._odds = log_odds.copy()
        np.fill_diagonal(self._odds, -np.inf)
        num = len(log_odds)
        self._known = np.full(num, -1) if known is None else known.copy()
        self._parts = np.zeros(num, dtype=bool) if never_apart is None else never_apart.copy()
        self.members = {i: [i] for i in range(num)}
        self._nearest = self._odds.copy()  # of each shape to each group
        self._sums = self._nearest.copy()  # of these over the members of a group
        typical = float(np.median(self._odds.max(axis=1))) if num > 1 else 0.0
        self._kin = np.full(num, typical)
        self._sizes = np.ones(num)
        for label in np.unique(self._known[self._known >= 0]):
            first, *others = np.flatnonzero(self._known == label).tolist()
            for other in others:
                self.join(first, other)

    @property
    def alive(self) -> IntArray:
        """The groups, by first member."""
        return np.array(sorted(self.members), dtype=np.int64)

    def across(self) -> FloatArray:
        """Return the mean log-odds of nearest shapes of any two groups, both ways, shape (K, K)."""
        at = self.alive
        means = self._sums[np.ix_(at, at)] / self._sizes[at, None]
        found = 0.5 * (means + means.T)
        np.fill_diagonal(found, -np.inf)
        return np.asarray(found)

    def gaps(self, across: FloatArray) -> FloatArray:
        """Return by how much kin within two groups is closer, beyond what few members ask for, shape (K, K)."""
        at = self.alive
        kin, sizes = np.minimum(self._kin[at], MOST_KIN), self._sizes[at]
        few = FEW / np.minimum(sizes[:, None], sizes)
        return np.asarray(np.minimum(kin[:, None], kin) - across - few)

    def splits(self, across: FloatArray) -> FloatArray:
        """Return the log-odds that two groups are of different kinds, shape (K, K)."""
        return split_log_odds(self.gaps(across), across)

    def next_pair(self, least_split: float) -> tuple[int, int] | None:
        """Return the two nearest groups that nothing keeps apart; None where there are none."""
        at, across = self.alive, self.across()
        apart = self.splits(across) > least_split
        weak = self._parts[at] & (self._sizes[at] < FEWEST_OF_KIND)
        apart &= ~(weak[:, None] | weak)
        labels = self._known[at]
        apart |= (labels[:, None] != labels) & (labels[:, None] >= 0) & (labels >= 0)
        free = np.where(apart, -np.inf, across)
        best = int(np.argmax(free))
        if len(at) < 2 or not np.isfinite(free.flat[best]):
            return None
        one, other = sorted(divmod(best, len(at)))
        return int(at[one]), int(at[other])

    def join(self, one: int, other: int) -> None:
        """Join two groups, given by their first members."""
        self.members[one] += self.members.pop(other)
        self._nearest[:, one] = np.maximum(self._nearest[:, one], self._nearest[:, other])
        self._sums[one] += self._sums[other]
        for group in (self.alive).tolist():
            self._sums[group, one] = self._nearest[self.members[group], one].sum()
        inside = self.members[one]
        self._kin[one] = self._odds[np.ix_(inside, inside)].max(axis=1).mean()
        self._sizes[one] += self._sizes[other]
        self._known[one] = max(self._known[one], self._known[other])
        self._parts[one] &= self._parts[other]

    def result(self) -> Grouping:
        """Return the groups as they are now."""
        labels, at = np.empty(len(self._odds), dtype=np.int64), self.alive
        firsts = sorted((min(self.members[group]), k) for k, group in enumerate(at.tolist()))
        order = [k for _, k in firsts]
        for number, k in enumerate(order):
            labels[self.members[int(at[k])]] = number
        across = self.across()
        splits = self.splits(across)
        np.fill_diagonal(splits, np.inf)
        return Grouping(
            labels=labels, splits=splits[np.ix_(order, order)], across=across[np.ix_(order, order)]
        )
