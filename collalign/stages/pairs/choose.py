"""Chooses the pairs and matches them: at once, or in rounds that add pairs where synchronization is uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from collalign.collection import Excluded
from collalign.engine.stage import ProgressFactory
from collalign.engine.store.store import Store
from collalign.options import AlignOptions, RunOptions
from collalign.stages.chirality.pilot import GroupChoice, choose_group
from collalign.stages.pairs.descriptor import shape_descriptor
from collalign.stages.pairs.match import MatchedPair, match_pairs, pair_key, synchronize_pairs
from collalign.stages.pairs.select import adaptive_pairs, extend_pairs, select_pairs
from collalign.stages.shapes import PreparedShapes
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples

#: Collections up to this size match all their pairs with ``pairs="auto"``.
MAX_ALL_PAIRS = 40
#: How often pairs are added where synchronization is uncertain.
MAX_ROUNDS = 3
#: Said of specimens of the other side that are added to a collection without mirror images.
KEPT_UNMIRRORED = (
    "Added shapes look like mirror images, but the collection was aligned without mirror images and keeps that; to "
    "mirror them, align all shapes again."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPairs:
    """The pairs that were matched, those that failed, and how many came out of the store.

    ``choice`` is the group that they were matched with, "SO" or "O", with a note where the shapes decided.
    """

    pairs: list[MatchedPair]
    failed: list[Excluded]
    num_reused: int
    choice: GroupChoice


@dataclass(frozen=True, kw_only=True, eq=False)
class FormerPairs:
    """The pairs that an earlier run matched among the first ``num_shapes`` shapes, and with which group."""

    num_shapes: int
    edges: IntArray
    group: str


def choose_and_match(
    shapes: PreparedShapes,
    samples: Sequence[Samples],
    options: AlignOptions,
    run: RunOptions,
    store: Store,
    *,
    former: FormerPairs | None = None,
    any_mirrored: bool = False,
    progress: ProgressFactory | None = None,
) -> MatchedPairs:
    """Match the pairs that ``options.pairs`` asks for, with the group that was asked for or that the shapes call for.

    Parameters
    ----------
    shapes : PreparedShapes
    samples : sequence of Samples
    options : AlignOptions
    run : RunOptions
    store : Store
    former : FormerPairs, optional
        What an earlier run matched: only pairs with a new shape come on top, and its group stays.
    any_mirrored : bool
        Whether a pose set by hand mirrors its shape.
    progress : callable, optional
    """
    num = len(samples)
    strategy = _strategy(num, options)
    descriptors = np.stack([shape_descriptor(item) for item in samples])
    known: dict[str, Any] = {"descriptors": descriptors, "identities": shapes.keys, "seed": options.seed}
    if former is None:
        edges = select_pairs(num, strategy=strategy, num_landmarks=options.landmarks, **known)
    else:
        new = extend_pairs(former.num_shapes, num - former.num_shapes, strategy=strategy, **known)
        edges = _merged(former.edges, new)
    before = store.keys("pairs")
    choice = _choice(shapes, samples, edges, descriptors, options, run, store, former, any_mirrored, progress)
    options = replace(options, group=choice.group)
    pairs, failed = match_pairs(shapes, edges, options, run, store, progress=progress)
    for _ in range(MAX_ROUNDS if strategy == "adaptive" else 0):
        solution = synchronize_pairs(pairs, num, options)
        added = adaptive_pairs(
            num,
            edges,
            solution.confidence,
            groups=solution.groups,
            **known,
        )
        if not len(added):
            break
        edges = _merged(edges, added)
        pairs, failed = match_pairs(shapes, edges, options, run, store, progress=progress)
    reused = [1 for i, j in edges.tolist() if pair_key(shapes.keys[i], shapes.keys[j], options) in before]
    return MatchedPairs(pairs=pairs, failed=failed, num_reused=len(reused), choice=choice)


def planned_edges(num_shapes: int, options: AlignOptions) -> IntArray:
    """Return about the pairs that a run would match first, before any shape has been read."""
    return select_pairs(num_shapes, strategy=_strategy(num_shapes, options), seed=options.seed)


def _choice(
    shapes: PreparedShapes,
    samples: Sequence[Samples],
    edges: IntArray,
    descriptors: FloatArray,
    options: AlignOptions,
    run: RunOptions,
    store: Store,
    former: FormerPairs | None,
    any_mirrored: bool,
    progress: ProgressFactory | None,
) -> GroupChoice:
    """Return the group asked for, or with "auto" that of the earlier run, of the fixed poses, or of the shapes."""
    if options.group != "auto":
        return GroupChoice(group=options.group, note="")
    if former is not None and former.group == "O":
        return GroupChoice(group="O", note="Shapes may be mirrored, as in the collection that shapes were added to.")
    if any_mirrored:
        return GroupChoice(group="O", note="Shapes may be mirrored, because a pose set by hand is.")
    choice = choose_group(shapes, samples, edges, descriptors, options, run, store, progress=progress)
    if former is None or choice.group == "SO":
        return choice
    return GroupChoice(group="SO", note=f"{KEPT_UNMIRRORED} The evidence: {choice.note}")


def _strategy(num_shapes: int, options: AlignOptions) -> str:
    if options.pairs == "auto":
        return "all" if num_shapes <= MAX_ALL_PAIRS else "adaptive"
    return options.pairs


def _merged(edges: IntArray, added: IntArray) -> IntArray:
    return np.unique(np.concatenate([edges, added]), axis=0)
