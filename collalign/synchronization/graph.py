"""The graph of pairs: checked edges with their candidate rotations, its components and its spanning trees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypedDict

import networkx
import numpy as np
import scipy
from numpy.typing import ArrayLike

from data_tools.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_indices,
    as_rotations,
    as_weights,
    one_line,
    read_only,
)
from data_tools.errors import InputError, OptionsError
from pairwise.rotation_pattern import PatternLike, RotationPattern


class GraphArguments(TypedDict, total=False):
    """What makes a graph in addition to the pairs: the other arguments of :meth:`PairGraph.from_user`."""

    energies: ArrayLike | None
    weights: ArrayLike | None
    group: str
    num_shapes: int | None
    rotation_pattern: PatternLike


@dataclass(frozen=True, kw_only=True, eq=False)
class PairGraph:
    """Shapes joined by measured relative rotations, several candidates per pair. Build it with :meth:`from_user`.

    Attributes
    ----------
    num_shapes : int
        N.
    edges : ndarray of int, shape (E, 2)
        Shapes i, j of each pair; each unordered pair once, no loops.
    candidates : ndarray, shape (E, m, d, d)
        ``R_i_j``, taking j's coordinates to i's.
    present : ndarray of bool, shape (E, m)
        False where a pair has fewer than m candidates.
    energies : ndarray, shape (E, m), or None
        Energy of each candidate; meaningless where it is not present.
    log_odds : ndarray, shape (E, m), or None
        How plausible each candidate is, up to a constant of the pair, where more than energies says so.
    weights : ndarray, shape (E,)
        How much the caller trusts each pair.
    pattern : RotationPattern
        Blocks of the rotations, and which of them have determinant +1.
    fixed : ndarray of bool, shape (E,)
        Edges that state a constraint and are never reweighted.
    """

    num_shapes: int
    edges: IntArray
    candidates: FloatArray
    present: BoolArray
    energies: FloatArray | None
    weights: FloatArray
    pattern: RotationPattern
    fixed: BoolArray
    log_odds: FloatArray | None = None

    __repr__ = one_line

    @classmethod
    def from_user(
        cls,
        edges: ArrayLike,
        rotations: ArrayLike,
        *,
        energies: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        group: str = "SO",
        num_shapes: int | None = None,
        rotation_pattern: PatternLike = None,
    ) -> PairGraph:
        """Check what the caller gave and build the graph.

        Parameters
        ----------
        edges : array_like of int, shape (E, 2)
        rotations : array_like, shape (E, d, d) or (E, m, d, d)
        energies : array_like, shape (E,) or (E, m), optional
            Not negative; ``inf`` marks a candidate that is not there.
        weights : array_like, shape (E,), optional
        group : {"SO", "O"}
        num_shapes : int, optional
            One more than the largest index in ``edges`` where it is not given.
        rotation_pattern : optional
            See :meth:`pairwise.rotation_pattern.RotationPattern.from_user`.

        Raises
        ------
        InputError
            If indices are out of range, a pair joins a shape to itself or appears twice, a matrix is not in the
            group, or shapes do not agree.
        OptionsError
            If the group or the pattern is impossible.
        """
        pairs = checked_edges(edges, num_shapes)
        total = int(num_shapes) if num_shapes is not None else int(pairs.max(initial=-1)) + 1
        if total < 1:
            raise InputError(
                "edges: there are no shapes; give num_shapes for a collection without pairs"
            )
        stack = np.asarray(rotations)
        if (
            stack.ndim not in (3, 4)
            or len(stack) != len(pairs)
            or (stack.ndim == 4 and stack.shape[1] == 0)
        ):
            raise InputError(
                f"rotations: expected shape ({len(pairs)}, d, d) or ({len(pairs)}, m, d, d), got {stack.shape}"
            )
        stack = stack[:, None] if stack.ndim == 3 else stack
        costs, present = checked_energies(energies, stack.shape[:2])
        stack = np.where(present[..., None, None], stack, np.eye(stack.shape[-1]))
        pattern = RotationPattern.from_user(rotation_pattern, stack.shape[-1], group)
        checked = as_rotations(stack, "rotations")
        check_pattern(checked, "rotations", pattern)
        return cls(
            num_shapes=total,
            edges=read_only(pairs),
            candidates=read_only(checked),
            present=read_only(present),
            energies=costs if costs is None else read_only(costs),
            weights=read_only(as_weights(weights, "weights", num=len(pairs)))
            if len(pairs)
            else np.ones(0),
            pattern=pattern,
            fixed=read_only(np.zeros(len(pairs), dtype=bool)),
        )

    @classmethod
    def of_candidates(
        cls,
        edges: IntArray,
        candidates: Sequence[tuple[FloatArray, FloatArray]],
        *,
        num_shapes: int,
        pattern: RotationPattern,
        log_odds: Sequence[FloatArray] | None = None,
        weights: FloatArray | None = None,
    ) -> PairGraph:
        """Build the graph of pairs that are known to be right: each with as many candidates as it has.

        Parameters
        ----------
        edges : ndarray of int, shape (E, 2)
        candidates : sequence of (rotations, energies)
            Of each pair, shapes (m_e, d, d) and (m_e,), at least one.
        num_shapes : int
        pattern : RotationPattern
        log_odds : sequence of ndarray, optional
            Of each pair's candidates; minus infinity leaves one out.
        weights : ndarray, shape (E,), optional
            Positive; all equal by default.
        """
        most = max((len(energies) for _, energies in candidates), default=1)
        dim = pattern.mask.shape[0]
        stack = np.tile(np.eye(dim), (len(edges), most, 1, 1))
        costs = np.full((len(edges), most), np.inf)
        for e, (rotations, energies) in enumerate(candidates):
            stack[e, : len(energies)] = rotations
            costs[e, : len(energies)] = energies
        odds = None
        if log_odds is not None:
            odds = np.full(costs.shape, -np.inf)
            for e, values in enumerate(log_odds):
                odds[e, : len(values)] = values
            costs = np.where(np.isfinite(odds), costs, np.inf)
        return cls(
            num_shapes=num_shapes,
            edges=read_only(edges.reshape(-1, 2)),
            candidates=read_only(stack),
            present=read_only(np.isfinite(costs)),
            energies=read_only(costs),
            weights=read_only(np.ones(len(edges)) if weights is None else weights),
            pattern=pattern,
            fixed=read_only(np.zeros(len(edges), dtype=bool)),
            log_odds=odds if odds is None else read_only(odds),
        )

    @property
    def dim(self) -> int:
        """Number of coordinates d."""
        return self.candidates.shape[-1]

    @property
    def num_edges(self) -> int:
        """Number of pairs E."""
        return len(self.edges)

    @cached_property
    def best_choice(self) -> IntArray:
        """The most plausible candidate of each pair (E,), or of lowest energy, or the first present one."""
        if self.log_odds is not None:
            return np.argmax(np.where(self.present, self.log_odds, -np.inf), axis=1)
        if self.energies is None:
            return np.argmax(self.present, axis=1)
        return np.argmin(np.where(self.present, self.energies, np.inf), axis=1)

    @cached_property
    def is_complete(self) -> bool:
        """Whether every two shapes form a pair and all pairs weigh the same."""
        full = self.num_edges == self.num_shapes * (self.num_shapes - 1) // 2
        return full and bool(np.ptp(self.weights) == 0 if self.num_edges else True)

    def chosen(self, choice: IntArray) -> FloatArray:
        """Return the chosen candidates, shape (E, d, d)."""
        return self.candidates[np.arange(self.num_edges), choice]

    def connected_components(self) -> tuple[IntArray, ...]:
        """Return the shapes of each component, sorted, shape (c,) each; pairs of zero weight join nothing."""
        graph = networkx.Graph()
        graph.add_nodes_from(range(self.num_shapes))
        graph.add_edges_from(self.edges[self.weights > 0].tolist())
        found = [
            np.array(sorted(members), dtype=np.int64)
            for members in networkx.connected_components(graph)
        ]
        return tuple(sorted(found, key=lambda members: int(members[0])))

    def subgraph(self, members: IntArray) -> tuple[PairGraph, IntArray]:
        """Return the graph of some shapes (n,), renumbered, and the indices of the pairs it keeps, shape (e,)."""
        position = np.full(self.num_shapes, -1, dtype=np.int64)
        position[members] = np.arange(len(members))
        local = position[self.edges]
        kept = np.flatnonzero((local >= 0).all(axis=1))
        part = replace(
            self,
            num_shapes=len(members),
            edges=local[kept],
            candidates=self.candidates[kept],
            present=self.present[kept],
            energies=None if self.energies is None else self.energies[kept],
            log_odds=None if self.log_odds is None else self.log_odds[kept],
            weights=self.weights[kept],
            fixed=self.fixed[kept],
        )
        return part, kept

    def with_constraints(self, fixed: Mapping[int, FloatArray]) -> PairGraph:
        """Return the graph with fixed edges that state the relative rotations of the fixed shapes.

        Parameters
        ----------
        fixed : mapping of int to ndarray (d, d)
            ``R_common_i`` of each fixed shape. Fixed edges join the first of them to each other one; a measured pair
            of the same shapes becomes the fixed edge, in its place, the others are appended.
        """
        shapes = sorted(fixed)
        first = shapes[0] if shapes else 0
        row = {frozenset(pair): e for e, pair in enumerate(self.edges.tolist())}
        fresh = [(first, other) for other in shapes[1:] if frozenset((first, other)) not in row]
        grown = self._with_empty_edges(np.array(fresh, dtype=np.int64).reshape(-1, 2))
        candidates, present, is_fixed = (
            grown.candidates.copy(),
            grown.present.copy(),
            grown.fixed.copy(),
        )
        energies = None if grown.energies is None else grown.energies.copy()
        log_odds = None if grown.log_odds is None else grown.log_odds.copy()
        for other in shapes[1:]:
            pair = frozenset((first, other))
            edge = row[pair] if pair in row else self.num_edges + fresh.index((first, other))
            i, j = grown.edges[edge]
            candidates[edge] = fixed[int(i)].T @ fixed[int(j)]
            present[edge] = np.arange(present.shape[1]) == 0
            is_fixed[edge] = True
            if energies is not None:
                energies[edge] = np.where(present[edge], 0.0, np.inf)
            if log_odds is not None:
                log_odds[edge] = np.where(present[edge], 0.0, -np.inf)
        return replace(
            grown,
            candidates=candidates,
            present=present,
            energies=energies,
            log_odds=log_odds,
            fixed=is_fixed,
        )

    def _with_empty_edges(self, pairs: IntArray) -> PairGraph:
        """Return the graph with edges appended whose candidates are not set yet."""
        count, m = len(pairs), self.candidates.shape[1]
        empty = np.zeros((count, m, self.dim, self.dim))
        weight = float(self.weights.max(initial=0.0)) or 1.0
        return replace(
            self,
            edges=np.concatenate([self.edges, pairs]),
            candidates=np.concatenate([self.candidates, empty]),
            present=np.concatenate([self.present, np.zeros((count, m), dtype=bool)]),
            energies=None
            if self.energies is None
            else np.concatenate([self.energies, np.zeros((count, m))]),
            log_odds=None
            if self.log_odds is None
            else np.concatenate([self.log_odds, np.zeros((count, m))]),
            weights=np.concatenate([self.weights, np.full(count, weight)]),
            fixed=np.concatenate([self.fixed, np.zeros(count, dtype=bool)]),
        )


def block_matrix(graph: PairGraph, blocks: FloatArray, index: IntArray) -> scipy.sparse.csr_matrix:
    """Return the symmetric block matrix of weighted rotations, shape (N b, N b), without its diagonal.

    Parameters
    ----------
    graph : PairGraph
    blocks : ndarray, shape (E, d, d)
        The block at (i, j) of each pair; its transpose goes to (j, i).
    index : ndarray of int, shape (b,)
        Coordinates kept.
    """
    size, total = len(index), graph.num_shapes * len(index)
    part = blocks[:, index[:, None], index]
    within = np.arange(size)
    rows = graph.edges[:, 0, None, None] * size + within[:, None]
    cols = graph.edges[:, 1, None, None] * size + within
    rows, cols = np.broadcast_arrays(rows, cols)
    upper = scipy.sparse.coo_matrix(
        (part.ravel(), (rows.ravel(), cols.ravel())), shape=(total, total)
    )
    return (upper + upper.T).tocsr()


def degrees(graph: PairGraph, weights: FloatArray) -> FloatArray:
    """Return the sum of the weights at each shape, shape (N,)."""
    ends = graph.edges.ravel()
    total = np.bincount(ends, weights=np.repeat(weights, 2), minlength=graph.num_shapes)
    return np.asarray(total, dtype=np.float64)


#: Entries outside the pattern that count as zero.
PATTERN_TOL = 1e-6


def checked_edges(edges: ArrayLike, num_shapes: int | None) -> IntArray:
    """Check pairs of shapes and return them as (E, 2) integers.

    Raises
    ------
    InputError
        If an index is out of range, a pair joins a shape to itself, or appears twice.
    OptionsError
        If there are fewer shapes than one.
    """
    if num_shapes is not None and num_shapes < 1:
        raise OptionsError(f"num_shapes: expected 1 or more, got {num_shapes}")
    upper = num_shapes if num_shapes is not None else np.iinfo(np.int64).max
    raw = np.asarray(edges)
    pairs = as_indices(
        raw.reshape(0, 2) if raw.size == 0 else raw, "edges", upper=upper, shape=(None, 2)
    )
    loops = np.flatnonzero(pairs[:, 0] == pairs[:, 1])
    if len(loops):
        raise InputError(f"edges: row {loops[0]} joins shape {pairs[loops[0], 0]} to itself")
    unordered, count = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
    if (count > 1).any():
        twice = unordered[np.argmax(count > 1)].tolist()
        raise InputError(
            f"edges: the pair {twice} appears more than once; several rotations of a pair are its candidates"
        )
    return pairs


def checked_energies(
    energies: ArrayLike | None, shape: tuple[int, int]
) -> tuple[FloatArray | None, BoolArray]:
    """Check energies of candidates; return them as (E, m), and which candidates there are, for ``shape`` (E, m).

    Raises
    ------
    InputError
        If one is negative or NaN, their number is another, or a pair has no candidate.
    """
    if energies is None:
        return None, np.ones(shape, dtype=bool)
    costs = np.array(energies, dtype=np.float64)
    if costs.shape == shape[:1] and shape[1] == 1:
        costs = costs[:, None]
    if costs.shape != shape:
        raise InputError(f"energies: expected shape {shape}, got {costs.shape}")
    if np.isnan(costs).any() or (costs < 0).any():
        raise InputError(
            "energies: expected numbers >= 0 (inf for a candidate that is not there), got NaN or less"
        )
    present = np.isfinite(costs)
    empty = np.flatnonzero(~present.any(axis=1))
    if len(empty):
        raise InputError(
            f"energies: pair {empty[0]} has no candidate of finite energy; leave the pair out"
        )
    return costs, present


def check_pattern(rotations: FloatArray, name: str, pattern: RotationPattern) -> None:
    """Check that matrices (..., d, d) fit a pattern.

    Raises
    ------
    InputError
        If an entry outside the pattern is not zero, or a block that must be a rotation is a reflection.
    """
    outside = float(np.abs(rotations[..., ~pattern.mask]).max(initial=0.0))
    if outside > PATTERN_TOL:
        raise InputError(f"{name}: entries outside rotation_pattern reach {outside:.2g}")
    for start, stop in pattern.special_blocks:
        if rotations.size and np.linalg.det(rotations[..., start:stop, start:stop]).min() < 0:
            raise InputError(f"{name}: contains a reflection (determinant -1) but group is 'SO'")
