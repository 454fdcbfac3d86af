"""The pair stage: every chosen pair of shapes is matched once, and its distinct poses are kept in the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from collalign.engine.job import Job, Wanted
from collalign.engine.store import pair_seed
from collalign.options import AlignOptions, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Excluded, Shapes
from collalign.stages.shape_stage import SAMPLING
from collalign.whole_pairs.match_whole import match_whole
from data_tools.arrays import FloatArray, Holds, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import CollectionError, InputError
from data_tools.notes import MAX_NAMED
from pairwise.options import MatchOptions
from pairwise.relaxations import check_solver
from pairwise.results import Status


@dataclass(frozen=True, kw_only=True, eq=False)
class PairPoses:
    """The distinct poses of a pair, the best first; energies of rounding size are 0. Fields are those of ``Pair``."""

    rotations: Annotated[FloatArray, Holds(shape="m d d", rotations=True)]
    maps: Annotated[IntArray, Holds(shape="m k", lower=-1)]
    energies: Annotated[FloatArray, Holds(shape="m")]
    mismatches: Annotated[FloatArray, Holds(shape="m", nan=True)]
    lower_bound: Annotated[float, Holds(nan=True)]
    status: Status

    def __post_init__(self) -> None:
        if not len(self.energies):
            raise InputError("holds no pose")

    def pair(self, target: int, source: int) -> Pair:
        """Return the pair of two shapes, given by their positions in the collection."""
        return Pair(target=target, source=source, **vars(self) | {"status": self.status.name})


def match_pair(target: Samples, source: Samples, group: str, options: MatchOptions) -> PairPoses:
    """Match one pair; runs inside a worker.

    Raises
    ------
    SolveFailed
        If there is no pose.
    """
    result, mismatches = match_whole(target, source, group, options)
    poses = result.candidates
    return PairPoses(
        rotations=np.array([pose.R_target_source for pose in poses]),
        maps=np.array([pose.map_target_source for pose in poses], dtype=np.int32),
        energies=np.array([pose.energy for pose in poses]),
        mismatches=mismatches,
        lower_bound=float(result.lower_bound),
        status=result.status,
    )


#: Matches a pair. The version changes whenever the same two shapes and options would give other poses.
MATCHING = Job(kind="pairs", version="pair-9", run=match_pair, reader=PairPoses)


def match_pairs(
    session: AlignSession, shapes: Shapes, edges: IntArray
) -> tuple[list[Pair], list[Excluded]]:
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
    UnavailableError
        If the solver of the relaxation is not installed.
    """
    options = session.options
    check_solver(options.matching.solver)
    wanted = {
        (i, j): Wanted(
            key=pair_key(shapes.keys[i], shapes.keys[j], options),
            label=shapes.label(i, j),
            arguments={
                "target": SAMPLING.shared(shapes.keys[i]),
                "source": SAMPLING.shared(shapes.keys[j]),
                "group": options.group,
                "options": MatchOptions(
                    **vars(options.matching),
                    seed=pair_seed(options.seed, shapes.keys[i], shapes.keys[j]),
                ),
            },
        )
        for i, j in edges.tolist()
    }
    found = session.compute(
        MATCHING, wanted, time_limit_s=session.run.pair_time_limit_s, strict=options.strict
    )
    pairs = [poses.pair(i, j) for (i, j), poses in found.items()]
    failed = [
        Excluded(file=shapes.label(i, j), reason=reason)
        for (i, j), reason in found.failures.items()
    ]
    if not pairs:
        reasons = "".join(f"\n  {item.file}: {item.reason}" for item in failed[:MAX_NAMED])
        raise CollectionError(f"not one of {len(edges)} pairs could be matched{reasons}")
    return pairs, failed


def pairs_that_match(session: AlignSession, shapes: Shapes, edges: IntArray) -> list[Pair]:
    """Match pairs of which perhaps none can be matched; the list is empty then.

    Parameters
    ----------
    session, shapes, edges
        As of :func:`match_pairs`. There may be no edges.
    """
    try:
        return match_pairs(session, shapes, edges)[0] if len(edges) else []
    except CollectionError:
        return []


def num_reused_pairs(session: AlignSession, shapes: Shapes, pairs: Sequence[Pair]) -> int:
    """Return how many of the pairs the store held before this run."""
    keys = (pair_key(shapes.keys[p.target], shapes.keys[p.source], session.options) for p in pairs)
    return session.num_reused("pairs", keys)


def pair_key(target_key: str, source_key: str, options: AlignOptions) -> str:
    """Return the key of a pair's record in the store, from the keys of its shapes; the group is "SO" or "O"."""
    settings = {"group": options.group, "matching": options.matching, "seed": options.seed}
    return MATCHING.key(settings, target_key, source_key)
