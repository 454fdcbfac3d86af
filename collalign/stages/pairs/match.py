"""The pair stage: every chosen pair of shapes is matched once, and its distinct poses are kept in the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.collection import Excluded
from collalign.engine.jobs.run import SharedTable
from collalign.engine.stage import ProgressFactory, run_stage
from collalign.engine.store.keys import fingerprint, pair_seed
from collalign.engine.store.records import Record
from collalign.engine.store.store import Store
from collalign.options import AlignOptions, RunOptions
from collalign.stages.shapes import PreparedShapes
from collalign.stages.stored_types import poses_from_record, poses_to_record, samples_from_record
from collalign.synchronization import SynchronizationResult, synchronize
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import CollectionError
from pairwise.match import match_problem
from pairwise.options import MatchOptions
from pairwise.problem.problem import Problem

#: Changes whenever the same two shapes and options would give other poses.
PAIR_VERSION = "pair-3"


@dataclass(frozen=True, kw_only=True)
class PairTask:
    """What a worker needs to match one pair; the samples come from the shared table."""

    target_key: str
    source_key: str
    group: str
    options: MatchOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPair:
    """One pair's distinct poses.

    Attributes
    ----------
    target, source : int
        Positions of the shapes in the collection.
    rotations : ndarray, shape (m, d, d)
        ``R_target_source`` of each pose in the embedding, the lowest energy first.
    maps : ndarray of int, shape (m, k)
    energies : ndarray, shape (m,)
    lower_bound : float
        NaN where nothing was certified.
    status : str
        Name of a :class:`pairwise.status.Status`.
    chirality_proven : bool
        Whether every pose of the other chirality is proven to be worse than the best one.
    """

    target: int
    source: int
    rotations: FloatArray
    maps: IntArray
    energies: FloatArray
    lower_bound: float
    status: str
    chirality_proven: bool = False


def match_pair(task: PairTask, shared: SharedTable) -> Record:
    """Match one pair; runs inside a worker.

    Returns
    -------
    dict
        ``rotations`` (m, d, d), ``maps`` (m, k), ``energies`` (m,), ``lower_bound``, ``status``.
    """
    target, source = (samples_from_record(shared[key], key) for key in (task.target_key, task.source_key))
    return poses_to_record(match_problem(pair_problem(target, source, task.group), task.options))


def pair_problem(
    target: Samples,
    source: Samples,
    group: str,
    *,
    num_matches: int | None = None,
    unmatched_penalty: float | None = None,
) -> Problem:
    """Return the Procrustes matching problem of two preprocessed shapes.

    Parameters
    ----------
    target, source : Samples
    group : {"SO", "O"}
    num_matches, unmatched_penalty : optional
        Partial matching, see :func:`pairwise.match`.
    """
    return Problem.from_user(
        target.coordinates,
        source.coordinates,
        group=group,
        rotation_pattern=target.block_sizes if len(target.block_sizes) > 1 else None,
        invariants=(target.invariants, source.invariants),
        num_matches=num_matches,
        unmatched_penalty=unmatched_penalty,
    )


def match_pairs(
    shapes: PreparedShapes,
    edges: IntArray,
    options: AlignOptions,
    run: RunOptions,
    store: Store,
    *,
    progress: ProgressFactory | None = None,
) -> tuple[list[MatchedPair], list[Excluded]]:
    """Match every pair whose result the store does not hold yet.

    Parameters
    ----------
    shapes : PreparedShapes
    edges : ndarray of int, shape (E, 2)
        Target and source of each pair.
    options : AlignOptions
    run : RunOptions
    store : Store
    progress : callable, optional

    Returns
    -------
    pairs : list of MatchedPair
        In the order of ``edges``, failed ones left out.
    failed : list of Excluded

    Raises
    ------
    InputError
        With ``options.strict``, at the first pair that fails.
    CollectionError
        If no pair is left.
    """
    # Files of equal content give equal keys, so a key may stand for several pairs.
    keyed = [(pair_key(shapes.keys[i], shapes.keys[j], options), i, j) for i, j in edges.tolist()]
    tasks = {key: (_label(shapes, i, j), _task(shapes, i, j, options)) for key, i, j in keyed}
    with SharedTable.create((key, store.require("shapes", key)) for key in sorted(set(shapes.keys))) as table:
        run_stage(
            "pairs",
            match_pair,
            tasks,
            store,
            run,
            time_limit_s=run.pair_time_limit_s,
            strict=options.strict,
            shared=table,
            progress=progress,
        )
    failures, done = store.failures("pairs"), store.keys("pairs")
    pairs = [_matched(store.require("pairs", key), i, j, _label(shapes, i, j)) for key, i, j in keyed if key in done]
    failed = [
        Excluded(file=_label(shapes, i, j), reason=failures[key].reason) for key, i, j in keyed if key not in done
    ]
    if not pairs:
        reasons = "".join(f"\n  {item.file}: {item.reason}" for item in failed[:10])
        raise CollectionError(f"not one of {len(edges)} pairs could be matched{reasons}")
    return pairs, failed


def candidate_arrays(pairs: Sequence[MatchedPair]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the pairs as synchronization takes them.

    Returns
    -------
    edges : ndarray of int, shape (E, 2)
    rotations : ndarray, shape (E, m, d, d)
        Padded with the best pose where a pair has fewer than m.
    energies : ndarray, shape (E, m)
        ``inf`` where padded.
    """
    num = max(len(pair.energies) for pair in pairs)
    dim = pairs[0].rotations.shape[-1]
    rotations = np.empty((len(pairs), num, dim, dim))
    energies = np.full((len(pairs), num), np.inf)
    for e, pair in enumerate(pairs):
        rotations[e] = pair.rotations[0]
        rotations[e, : len(pair.energies)] = pair.rotations
        energies[e, : len(pair.energies)] = pair.energies
    return np.array([(pair.target, pair.source) for pair in pairs]), rotations, energies


def _label(shapes: PreparedShapes, i: int, j: int) -> str:
    return f"{shapes.names[i]} - {shapes.names[j]}"


def synchronize_pairs(
    pairs: Sequence[MatchedPair],
    num_shapes: int,
    options: AlignOptions,
    *,
    fixed: Mapping[int, FloatArray] | None = None,
    reference: int = 0,
) -> SynchronizationResult:
    """Synchronize the pairs' rotations of space.

    Parameters
    ----------
    pairs : sequence of MatchedPair
    num_shapes : int
    options : AlignOptions
    fixed : mapping of int to ndarray (3, 3), optional
        ``R_common_shape`` set by hand.
    reference : int
        Shape whose orientation is the common frame's.
    """
    edges, rotations, energies = candidate_arrays(pairs)
    return synchronize(
        edges,
        np.ascontiguousarray(rotations[..., :3, :3]),
        energies=energies,
        group=options.group,
        method=options.synchronization,
        num_shapes=num_shapes,
        fixed=fixed,
        reference=reference,
    )


def pair_key(target_key: str, source_key: str, options: AlignOptions) -> str:
    """Return the key of a pair's record in the store, from the keys of its shapes; the group is "SO" or "O"."""
    settings = {"group": options.group, "matching": options.matching, "seed": options.seed}
    return fingerprint(PAIR_VERSION, settings, target_key, source_key)


def _task(shapes: PreparedShapes, i: int, j: int, options: AlignOptions) -> PairTask:
    seed = pair_seed(options.seed, shapes.keys[i], shapes.keys[j])
    return PairTask(
        target_key=shapes.keys[i],
        source_key=shapes.keys[j],
        group=options.group,
        options=replace(options.matching, seed=seed),
    )


def _matched(record: Record, target: int, source: int, label: str) -> MatchedPair:
    return MatchedPair(target=target, source=source, **poses_from_record(record, label))
