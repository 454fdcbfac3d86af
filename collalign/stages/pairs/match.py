"""The pair stage: every chosen pair of shapes is matched once, and its distinct poses are kept in the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.keys import fingerprint, pair_seed
from collalign.engine.store.records import Record
from collalign.options import AlignOptions, AlignSession
from collalign.products.matching_input import pair_problem
from collalign.products.pair import Pair
from collalign.products.shapes import Excluded, Shapes
from collalign.stages.stored_types import pair_from_record, poses_to_record, samples_from_record
from collalign.stages.surface_gap import surface_gaps
from data_tools.arrays import IntArray
from data_tools.errors import CollectionError
from pairwise.matching import match_problem
from pairwise.options import MatchOptions

#: Failed pairs that an error names.
_MOST_NAMED = 10
#: Changes whenever the same two shapes and options would give other poses.
PAIR_VERSION = "pair-5"


@dataclass(frozen=True, kw_only=True)
class PairTask:
    """What a worker needs to match one pair; the samples come from the shared table."""

    target_key: str
    source_key: str
    group: str
    options: MatchOptions


def match_pair(task: PairTask, shared: SharedTable) -> Record:
    """Match one pair; runs inside a worker.

    Returns
    -------
    dict
        ``rotations`` (m, d, d), ``maps`` (m, k), ``energies`` (m,), 0 where only rounding errors are left, ``gaps``
        (m,), ``lower_bound``, ``status``.
    """
    target, source = (shared.made(key, samples_from_record) for key in (task.target_key, task.source_key))
    problem = pair_problem(target, source, task.group)
    record = poses_to_record(match_problem(problem, task.options))
    energies = np.where(record["energies"] <= problem.rounding_energy, 0.0, record["energies"])
    return record | {"energies": energies, "gaps": surface_gaps(target, source, record["rotations"])}


def match_pairs(session: AlignSession, shapes: Shapes, edges: IntArray) -> tuple[list[Pair], list[Excluded]]:
    """Match every pair whose result the store does not hold yet.

    Parameters
    ----------
    session : Session
        Its group is decided, "SO" or "O".
    shapes : Shapes
    edges : ndarray of int, shape (E, 2)
        Target and source of each pair.

    Returns
    -------
    pairs : list of Pair
        In the order of ``edges``, failed ones left out.
    failed : list of Excluded

    Raises
    ------
    InputError
        With ``options.strict``, at the first pair that fails.
    CollectionError
        If no pair is left.
    """
    options = session.options
    # Files of equal content give equal keys, so a key may stand for several pairs.
    keyed = [(pair_key(shapes.keys[i], shapes.keys[j], options), i, j) for i, j in edges.tolist()]
    with session.shared_table("shapes", shapes.keys) as table:
        failures = session.compute(
            "pairs",
            match_pair,
            {key: (shapes.label(i, j), _task(shapes, i, j, options)) for key, i, j in keyed},
            time_limit_s=session.run.pair_time_limit_s,
            strict=options.strict,
            shared=table,
        )
    pairs = [
        pair_from_record(session.store.require("pairs", key), shapes.label(i, j), i, j)
        for key, i, j in keyed
        if key not in failures
    ]
    failed = [Excluded(file=shapes.label(i, j), reason=failures[k].reason) for k, i, j in keyed if k in failures]
    if not pairs:
        reasons = "".join(f"\n  {item.file}: {item.reason}" for item in failed[:_MOST_NAMED])
        raise CollectionError(f"not one of {len(edges)} pairs could be matched{reasons}")
    return pairs, failed


def num_reused_pairs(session: AlignSession, shapes: Shapes, pairs: Sequence[Pair]) -> int:
    """Return how many of the pairs the store held before this run."""
    keys = (pair_key(shapes.keys[p.target], shapes.keys[p.source], session.options) for p in pairs)
    return session.num_reused("pairs", keys)


def pair_key(target_key: str, source_key: str, options: AlignOptions) -> str:
    """Return the key of a pair's record in the store, from the keys of its shapes; the group is "SO" or "O"."""
    settings = {"group": options.group, "matching": options.matching, "seed": options.seed}
    return fingerprint(PAIR_VERSION, settings, target_key, source_key)


def _task(shapes: Shapes, i: int, j: int, options: AlignOptions) -> PairTask:
    seed = pair_seed(options.seed, shapes.keys[i], shapes.keys[j])
    return PairTask(
        target_key=shapes.keys[i],
        source_key=shapes.keys[j],
        group=options.group,
        options=options.matching.seeded(seed),
    )
