"""Finds the kinds of a collection: by what no pose changes, then by pairs of shapes that decide between kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from collalign.confidence.kind_model import LEAST_FREE_SPLIT, kin_log_odds, part_log_odds
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.choose_pairs import normalised, shape_descriptor
from collalign.stages.incomplete.parts import match_pairs_in_part
from collalign.stages.incomplete.posed_points import prepare_points
from collalign.stages.incomplete.scans import were_seen
from collalign.stages.kinds.grouping import (
    FEWEST_OF_KIND,
    Grouping,
    group_into,
    group_shapes,
)
from collalign.stages.kinds.pose_free import are_described, kind_descriptors
from collalign.stages.match_pairs import pairs_that_match
from collalign.stages.steps import with_decided_group
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import OptionsError
from data_tools.notes import listed

#: Shapes, the nearest before any are matched, that each is matched with.
NUM_NEAR = 6
#: Kinds, the nearest, that each is compared with, and pairs of shapes between two of them.
NUM_NEAR_KINDS, NUM_ACROSS = 3, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundKinds:
    """The kinds of a collection.

    Attributes
    ----------
    labels : ndarray of int, shape (N,)
        Kind of each shape, numbered by first member.
    confidence : ndarray, shape (K,)
        How likely each is a kind of its own.
    log_odds : ndarray, shape (N, N)
        Of two shapes being of one kind.
    """

    labels: IntArray
    confidence: FloatArray
    log_odds: FloatArray

    @property
    def num(self) -> int:
        """How many kinds there are."""
        return len(self.confidence)


def find_kinds(
    session: AlignSession, shapes: Shapes, *, num: int = 0, known: IntArray | None = None
) -> FoundKinds | None:
    """Return the kinds of a collection; None where it is of one kind, or nothing tells.

    Pairs are matched only where kinds are likely. Mirror images are of one kind: before two kinds are told apart, the
    nearest of their pairs are matched with reflections as well, unless ``options.group`` forbids these. Images of one
    side each, such as depth images, show different parts of things: overlaps tell which belong together. Shapes of
    few points have the kind of the most similar one.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    num : int
        How many kinds there are; 0 where that is to be found.
    known : ndarray of int, shape (N,), optional
        Kinds of shapes of an earlier run, from 0; -1 for new ones.

    Raises
    ------
    OptionsError
        If more kinds are asked for than there are shapes, or shapes of enough points.
    """
    if num > len(shapes.names):
        raise OptionsError(
            f"clusters: expected at most {len(shapes.names)}, one a shape, got {num}"
        )
    if not num and known is None and were_seen(shapes):
        return None
    described = are_described(shapes.samples)
    told = np.flatnonzero(described)
    if len(told) < max(num, 2):
        if num:
            poor = [shapes.names[i] for i in np.flatnonzero(~described).tolist()]
            raise OptionsError(
                f"clusters: {num} kinds cannot be told apart, because these have too few points: {listed(poor)}; "
                "say the kinds with --kinds-by"
            )
        return None
    if len(told) < len(shapes.names):
        found_told = find_kinds(
            session,
            shapes.some(told.tolist()),
            num=num,
            known=None if known is None else known[told],
        )
        return None if found_told is None else _with_others(found_told, told, shapes, known)
    distances = kind_descriptors(shapes.samples).distances()
    free = kin_log_odds(*distances)
    if not num:
        first = group_shapes(free, known=known, least_split=LEAST_FREE_SPLIT)
        if first.num == 1:
            return None
    log_odds = np.minimum(free, 0.0)
    evidence = _Evidence(
        distances=distances, log_odds=log_odds, are_parts=np.zeros(len(free), dtype=np.bool_)
    )
    edges = likely_kin(free, NUM_NEAR)
    evidence.add(least_mismatches(session, shapes, edges, session.options.group))
    found = evidence.groups(num, known)
    if found.num > 1:
        edges = _across(found, log_odds)
        second_group = "SO" if session.options.group == "SO" else "O"
        evidence.add(least_mismatches(session, shapes, edges, second_group))
        evidence.add_parts(least_as_parts(session, shapes, edges, second_group))
        found = evidence.groups(num, known)
    was_mixed = known is not None and known.max() > 0
    if found.num == 1 or not (num or was_mixed or _is_mixed(found)):
        return None
    return FoundKinds(labels=found.labels, confidence=found.confidence, log_odds=log_odds)


def _with_others(
    found: FoundKinds, told: IntArray, shapes: Shapes, known: IntArray | None
) -> FoundKinds:
    """Return kinds of all shapes from those that some (n,) have: others are of the kind of the most similar one.

    Those of a known kind stay with its shapes.
    """
    descriptors = np.stack([shape_descriptor(one) for one in shapes.samples])
    distances = scipy.spatial.distance.cdist(descriptors, descriptors[told])
    if known is not None:
        is_own = (known[:, None] == known[told]) & (known[:, None] >= 0)
        distances[~is_own & is_own.any(axis=1, keepdims=True)] = np.inf
    labels = found.labels[distances.argmin(axis=1)]
    labels[told] = found.labels
    order = np.argsort(np.unique(labels, return_index=True)[1])
    return FoundKinds(
        labels=np.argsort(order)[labels],
        confidence=found.confidence[order],
        log_odds=_among_all(found.log_odds, told, len(labels)),
    )


def alikeness(shapes: Shapes) -> FloatArray:
    """Return how alike any two shapes are by what no pose changes, shape (N, N); of those of few points least."""
    told = np.flatnonzero(are_described(shapes.samples))
    num = len(shapes.names)
    if not len(told):
        return np.zeros((num, num))
    of_told = kind_descriptors([shapes.samples[i] for i in told]).distances()
    return _among_all(kin_log_odds(*of_told), told, num)


def _among_all(log_odds: FloatArray, told: IntArray, num: int) -> FloatArray:
    """Return log-odds of some shapes (n, n) among those of all, shape (num, num), which are the least of these."""
    every = np.full((num, num), log_odds.min())
    every[np.ix_(told, told)] = log_odds
    return every


def _is_mixed(found: Grouping) -> bool:
    """Return whether groups show that a folder holds several kinds; single odd shapes do not."""
    return int((np.bincount(found.labels) >= FEWEST_OF_KIND).sum()) > 1


def likely_kin(log_odds: FloatArray, num: int) -> list[tuple[int, int]]:
    """Return the pairs of each shape with those that are the likeliest kin of it, by log-odds (N, N)."""
    found = log_odds.copy()
    np.fill_diagonal(found, -np.inf)
    near = np.argsort(-found, axis=1, kind="stable")[:, : min(num, len(found) - 1)]
    return [(i, j) for i, own in enumerate(near.tolist()) for j in own]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Evidence:
    """What is known of pairs: distances of their descriptors, and the log-odds that matching may change in place.

    ``are_parts`` (N,) are the open shapes that are likely parts of a closed one.
    """

    distances: tuple[FloatArray, FloatArray]
    log_odds: FloatArray
    are_parts: BoolArray

    def groups(self, num: int, known: IntArray | None) -> Grouping:
        """Return as many groups as asked for, or with 0 those that are likely of different kinds."""
        if num:
            return group_into(self.log_odds, num, known=known)
        return group_shapes(self.log_odds, known=known, never_apart=self.are_parts)

    def add(self, mismatches: Mapping[tuple[int, int], float]) -> None:
        """Take in what matching says of pairs; of several matches of one pair the last one counts."""
        for (i, j), least in mismatches.items():
            shells, descriptors = (one[i, j] for one in self.distances)
            known = kin_log_odds(shells, descriptors, np.array(least))
            self.log_odds[i, j] = self.log_odds[j, i] = float(known)

    def add_parts(self, energies: Mapping[tuple[int, int], float]) -> None:
        """Take in what matching says of pairs one of which may be a part of the other, where it says more."""
        for (i, j), least in energies.items():
            known = float(part_log_odds(np.array(least)))
            self.log_odds[i, j] = self.log_odds[j, i] = max(known, self.log_odds[i, j])
            self.are_parts[j] |= known > 0.0


def least_mismatches(
    session: AlignSession, shapes: Shapes, edges: Sequence[tuple[int, int]], group: str
) -> dict[tuple[int, int], float]:
    """Return the least mismatch of pairs that could be matched.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    edges : sequence of (int, int)
        Positions of the shapes of each pair.
    group : {"auto", "SO", "O"}
        Whether mirror images are matched as well.

    Returns
    -------
    dict of (int, int) to float
        By the positions of the shapes, in ascending order.
    """
    decided = with_decided_group(session, group)
    pairs = pairs_that_match(decided, shapes, normalised(np.array(edges)))
    return {
        (min(one.target, one.source), max(one.target, one.source)): float(np.nanmin(one.mismatches))
        for one in pairs
        if not np.isnan(one.mismatches).all()
    }


def least_as_parts(
    session: AlignSession, shapes: Shapes, edges: Sequence[tuple[int, int]], group: str
) -> dict[tuple[int, int], float]:
    """Return the least energies of those pairs of a closed and an open surface that overlap in part, in this order.

    Objects that are assembled of components have borders everywhere: of these no pair is matched. Parameters are
    those of :func:`least_mismatches`.
    """
    rims = [one.rim for one in shapes.samples]
    ordered = [pair if rims[pair[0]] == "closed" else pair[::-1] for pair in edges]
    mixed = [(i, j) for i, j in ordered if (rims[i], rims[j]) == ("closed", "open")]
    if not mixed or shapes.are_assembled:
        return {}
    decided = with_decided_group(session, group)
    surfaces = prepare_points(decided, shapes, sorted({i for pair in mixed for i in pair}))
    found = match_pairs_in_part(decided, shapes, surfaces, mixed)
    return {pair: float(poses.energies.min()) for pair, poses in found.items()}


def _across(found: Grouping, log_odds: FloatArray) -> list[tuple[int, int]]:
    """Return the nearest pairs of shapes between each group and those nearest to it."""
    chosen = set[tuple[int, int]]()
    for group in range(found.num):
        rivals = np.argsort(-found.across[group], kind="stable")[
            : min(NUM_NEAR_KINDS, found.num - 1)
        ]
        for rival in rivals.tolist():
            one, other = (np.flatnonzero(found.labels == of) for of in (group, rival))
            table = log_odds[np.ix_(one, other)]
            order = np.argsort(-table, axis=None, kind="stable")[:NUM_ACROSS]
            for at in order.tolist():
                i, j = int(one[at // len(other)]), int(other[at % len(other)])
                chosen.add((min(i, j), max(i, j)))
    return sorted(chosen)
