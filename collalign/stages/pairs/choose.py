"""Chooses the pairs: at once, or in rounds that add pairs where synchronization is uncertain."""

from __future__ import annotations

import numpy as np

from collalign.options import MAX_ROUNDS, AlignOptions, AlignSession
from collalign.products.pair import FormerPairs, Pair
from collalign.products.shapes import Constraints, Excluded, Shapes
from collalign.stages.own_knowledge import with_own
from collalign.stages.pairs.match import match_pairs
from collalign.stages.pairs.select import (
    adaptive_pairs,
    extend_pairs,
    identity_hashes,
    select_pairs,
)
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, IntArray

#: Collections up to this size match all their pairs with ``pairs="auto"``.
MAX_ALL_PAIRS = 40


def choose_pairs(
    session: AlignSession,
    shapes: Shapes,
    descriptors: FloatArray,
    constraints: Constraints,
    former: FormerPairs | None = None,
) -> IntArray:
    """Return the pairs that ``options.pairs`` asks for, target and source of each, shape (E, 2).

    Parameters
    ----------
    session : Session
    shapes : Shapes
    descriptors : ndarray, shape (N, m)
    constraints : Constraints
        Pairs with proposed poses are matched, those of no weight are not.
    former : FormerPairs, optional
        What an earlier run matched: only pairs with a new shape come on top.
    """
    strategy = _strategy(len(shapes.names), session.options)
    hashes = identity_hashes(shapes.keys, session.options.seed)
    if former is None or not former.num_shapes:
        edges = select_pairs(strategy, hashes, descriptors)
    else:
        edges = _merged(
            former.edges, extend_pairs(former.num_shapes, strategy, hashes, descriptors)
        )
    return _merged(edges, np.array([*constraints.candidates], dtype=np.int64).reshape(-1, 2))


def match_chosen(
    session: AlignSession, shapes: Shapes, edges: IntArray, constraints: Constraints
) -> tuple[list[Pair], list[Excluded]]:
    """Match pairs (E, 2) as :func:`match_pairs` does, with what the caller knows of them."""
    counts = [constraints.weights.get((i, j), 1.0) > 0 for i, j in edges.tolist()]
    pairs, failed = match_pairs(session, shapes, edges[counts])
    return with_own(session, shapes, pairs, constraints), failed


def grow_pairs(
    session: AlignSession,
    shapes: Shapes,
    descriptors: FloatArray,
    edges: IntArray,
    pairs: list[Pair],
    failed: list[Excluded],
    constraints: Constraints,
) -> tuple[list[Pair], list[Excluded], SynchronizationResult | None]:
    """Match further pairs, in rounds, where the synchronization of those before is uncertain.

    Parameters
    ----------
    session : Session
        With ``options.pairs`` other than "adaptive" (or "auto" of many shapes) nothing is added.
    shapes, descriptors, edges
        The shapes, and the pairs that were to be matched so far.
    pairs, failed
        What became of them.
    constraints : Constraints

    Returns
    -------
    pairs, failed
        What became of all pairs.
    solution : SynchronizationResult or None
        Of exactly these pairs, without fixed shapes; None where the last round was not synchronized any more.
    """
    num = len(shapes.names)
    hashes = identity_hashes(shapes.keys, session.options.seed)
    for _ in range(MAX_ROUNDS if _strategy(num, session.options) == "adaptive" else 0):
        solution = synchronize_pairs(session.options, num, pairs)
        added = adaptive_pairs(edges, solution.confidence, solution.parts, hashes, descriptors)
        if not len(added):
            return pairs, failed, solution
        edges = _merged(edges, added)
        pairs, failed = match_chosen(session, shapes, edges, constraints)
    return pairs, failed, None


def planned_edges(num_shapes: int, options: AlignOptions) -> IntArray:
    """Return about the pairs that a run would match first, before any shape has been read."""
    hashes = identity_hashes(map(str, range(num_shapes)), options.seed)
    return select_pairs(_strategy(num_shapes, options), hashes, None)


def _strategy(num_shapes: int, options: AlignOptions) -> str:
    if options.pairs == "auto":
        return "all" if num_shapes <= MAX_ALL_PAIRS else "adaptive"
    return options.pairs


def _merged(edges: IntArray, added: IntArray) -> IntArray:
    return np.unique(np.concatenate([edges, added]), axis=0)
