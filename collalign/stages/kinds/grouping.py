"""Groups of shapes whose nearest kin is far closer than the nearest stranger, from log-odds of pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.confidence.kind_model import FEW, MOST_ALIKE, split_confidence
from data_tools.arrays import BoolArray, FloatArray, IntArray

#: Members of a group that shows, with a second one, that a folder holds several kinds. Fewer may be odd or broken.
FEWEST_OF_KIND = 3
#: Gaps tried, the largest first, until there are as many groups as were asked for.
_GAPS = np.arange(12.0, -12.5, -0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Grouping:
    """Shapes in groups.

    Attributes
    ----------
    labels : ndarray of int, shape (N,)
        Group of each shape, numbered by first member.
    gaps : ndarray, shape (K, K)
        By how much nearest kin within two groups is closer than nearest shapes across, beyond what few members ask
        for; infinite on the diagonal.
    across : ndarray, shape (K, K)
        Mean log-odds of the nearest shapes across two groups, both ways.
    """

    labels: IntArray
    gaps: FloatArray
    across: FloatArray

    @property
    def num(self) -> int:
        """How many groups there are."""
        return len(self.gaps)

    @property
    def confidence(self) -> FloatArray:
        """How likely each group is a kind of its own, shape (K,); 1 for a single one."""
        return np.array([split_confidence(gap) for gap in self.gaps.min(axis=1)])


def group_shapes(
    log_odds: FloatArray,
    least_gap: float,
    *,
    known: IntArray | None = None,
    never_apart: BoolArray | None = None,
) -> Grouping:
    """Join groups of shapes, the nearest first, unless a gap says that they are of different kinds.

    Parameters
    ----------
    log_odds : ndarray, shape (N, N)
        Of two shapes being of one kind; symmetric.
    least_gap : float
    known : ndarray of int, shape (N,), optional
        Groups that are not joined with each other, from 0; -1 for shapes that may come to any.
    never_apart : ndarray of bool, shape (N,), optional
        Shapes that are no kind by themselves, be it one or two: parts of others may be so.
    """
    state = _State(log_odds, known, never_apart)
    while (pair := state.next_pair(least_gap)) is not None:
        state.join(*pair)
    return state.result()


def group_into(log_odds: FloatArray, num: int, *, known: IntArray | None = None) -> Grouping:
    """Return as many groups as asked for; those that are the hardest to tell apart are joined.

    Parameters
    ----------
    log_odds : ndarray, shape (N, N)
    num : int
        From 1 to N.
    known : ndarray of int, shape (N,), optional
        See :func:`group_shapes`.
    """
    for gap in (*_GAPS, -np.inf):
        state = _State(log_odds, known, None, most_alike=MOST_ALIKE if gap > -np.inf else np.inf)
        while len(state.alive) > num and (pair := state.next_pair(gap)) is not None:
            state.join(*pair)
        if len(state.alive) >= num:
            break
    while len(state.alive) > num and (pair := state.next_pair(np.inf)) is not None:
        state.join(*pair)
    return state.result()


class _State:
    """Groups on their way; each is called by its first member."""

    def __init__(
        self,
        log_odds: FloatArray,
        known: IntArray | None,
        never_apart: BoolArray | None,
        *,
        most_alike: float = MOST_ALIKE,
    ) -> None:
        self._odds = log_odds.copy()
        np.fill_diagonal(self._odds, -np.inf)
        num = len(log_odds)
        self._most_alike = most_alike
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
        kin, sizes = self._kin[at], self._sizes[at]
        few = FEW / np.minimum(sizes[:, None], sizes)
        return np.asarray(np.minimum(kin[:, None], kin) - across - few)

    def next_pair(self, least_gap: float) -> tuple[int, int] | None:
        """Return the two nearest groups that nothing keeps apart; None where there are none."""
        at, across = self.alive, self.across()
        apart = (self.gaps(across) > least_gap) & (across < self._most_alike)
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
        gaps = self.gaps(across)
        np.fill_diagonal(gaps, np.inf)
        return Grouping(
            labels=labels, gaps=gaps[np.ix_(order, order)], across=across[np.ix_(order, order)]
        )
