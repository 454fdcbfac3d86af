"""A trial with a few shapes of a folder: what each kind of work costs here and now, and so what the whole will."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.engine.estimate import Work, estimate_run
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.engine.store.layout import Costs
from collalign.options import AUTO, AlignOptions, AlignSession
from collalign.products.matching_input import dense_points
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.chirality.pilot import MOST_SHAPES
from collalign.stages.evidence.decide import wants_maps
from collalign.stages.evidence.weigh import weigh_pairs
from collalign.stages.incomplete.detect import MIN_SHAPES
from collalign.stages.pairs.match import match_pairs
from collalign.stages.pairs.sparse_pairs import all_pairs
from collalign.stages.poses.refinement import NUM_NEIGHBOURS, NUM_ROUNDS
from collalign.stages.shape_stage import prepare_shapes
from data_tools.io.shapes import FolderListing, read_shape
from pairwise.dense.refine import refine_pose

#: Shapes of the trial, from all over the folder, and pairs of a run that are refined to time that.
NUM_TRIAL_SHAPES, NUM_TRIAL_PAIRS = 5, 10

# Measured by cProfile and tests/benchmarks/bench_estimate.py on teeth, skulls, bodies and generated shapes, in
# seconds of matching one pair, of refining one or of reading one shape, which the trial times on the machine at hand.
#: Pairs that the pilot matches for each shape that it looks at.
PILOT_PAIRS = 2.5
#: Solving a pair again, and its part in all synchronizations.
AGAIN_MATCHES, SYNCHRONIZATION_MATCHES = 0.22, 0.1
#: Local pairs of a shape, as a share of the neighbours that it names.
LOCAL_SHARE = 0.75
#: Poses of a shape that are tried for its confidence, and the search of what is missing from it.
TRUST_REFINEMENTS, MISSING_REFINEMENTS = 3.0, 5.0
#: Outputs of a shape, and its tile of the contact sheet.
OUTPUT_READS, TILE_MATCHES, MOST_TILES = 2.0, 0.5, 100


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What work costs.

    Attributes
    ----------
    shape_costs, pair_costs : Costs
    start_s : float
        Until the workers had started.
    refinement_s, read_s : float
        Of one pair on its dense samples, and of one file.
    surface_costs, map_costs : Costs
        Of preparing a shape for maps and of a pair's maps; of none where the collection needs none.
    """

    shape_costs: Costs
    pair_costs: Costs
    start_s: float
    refinement_s: float
    read_s: float
    surface_costs: Costs
    map_costs: Costs


def try_shapes(listing: FolderListing, options: AlignOptions, run: RunOptions) -> Trial:
    """Prepare and match the first shapes of a folder, and keep nothing of it.

    Raises
    ------
    CollalignError
        If too few of them are usable.
    """
    chosen = _evenly(len(listing.names))
    few = replace(
        listing, files=tuple(listing.files[i] for i in chosen), names=tuple(listing.names[i] for i in chosen)
    )
    with Session.open(options, replace(run, store=None)) as session:
        started = time.perf_counter()
        shapes = prepare_shapes(session, few)
        prepared_s = time.perf_counter() - started
        pairs, _ = match_pairs(session, shapes, all_pairs(len(shapes.names)))
        if wants_maps(options, pairs):
            weigh_pairs(session, shapes, pairs)
        costs = [session.store.costs(kind) for kind in ("shapes", "pairs", "surfaces", "evidence")]
    busy_s = costs[0].mean_seconds * len(shapes.names) / min(run.num_workers, len(shapes.names))
    return Trial(
        shape_costs=costs[0],
        pair_costs=costs[1],
        start_s=max(0.0, prepared_s - busy_s),
        refinement_s=_refinement_s(shapes, pairs) if options.refine else 0.0,
        read_s=_read_s(shapes, options),
        surface_costs=costs[2],
        map_costs=costs[3],
    )


def rest_s(session: AlignSession, shapes: Shapes, pairs: Sequence[Pair]) -> float:
    """Return how many seconds are left to the outputs once all pairs are matched, from what the run took so far.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    pairs : sequence of Pair
        All of them.
    """
    options, store = session.options, session.store
    few = replace(shapes, files=tuple(shapes.files[i] for i in _evenly(len(shapes.files))))
    trial = Trial(
        shape_costs=store.costs("shapes"),
        pair_costs=store.costs("pairs"),
        start_s=0.0,
        refinement_s=_refinement_s(shapes, pairs[:NUM_TRIAL_PAIRS]) if options.refine else 0.0,
        read_s=_read_s(few, options),
        surface_costs=store.costs("surfaces"),
        map_costs=store.costs("evidence"),
    )
    work = later_work(trial, len(shapes.names), len(pairs), options, missing_pairs=0, pilot=False)
    return estimate_run(
        num_shapes=0,
        num_pairs=0,
        shape_costs=trial.shape_costs,
        pair_costs=trial.pair_costs,
        num_jobs=session.run.num_workers,
        further=work,
    ).seconds


def later_work(
    trial: Trial, num_shapes: int, num_pairs: int, options: AlignOptions, *, missing_pairs: int, pilot: bool
) -> list[Work]:
    """Return the work beside shapes and pairs.

    Parameters
    ----------
    trial : Trial
    num_shapes, num_pairs : int
        Of the whole collection.
    options : AlignOptions
    missing_pairs : int
        Pairs that no store holds; these need maps as well, where the collection does.
    pilot : bool
        Whether the run must find out whether shapes are mirrored.
    """
    match_s = trial.pair_costs.mean_seconds
    work = [Work(stage="start", number=1, each_s=trial.start_s, spread=False)]
    if pilot:
        work.append(Work(stage="pairs", number=PILOT_PAIRS * min(num_shapes, MOST_SHAPES), each_s=match_s))
    if missing_pairs and trial.map_costs.num_records:
        work += [
            Work(stage="maps", number=num_shapes, each_s=trial.surface_costs.mean_seconds),
            Work(stage="maps", number=missing_pairs, each_s=trial.map_costs.mean_seconds),
        ]
    if options.synchronization == "robust":
        local = min(num_pairs, LOCAL_SHARE * NUM_NEIGHBOURS * num_shapes)
        work += [
            Work(stage="poses", number=num_pairs, each_s=AGAIN_MATCHES * match_s),
            Work(stage="poses", number=num_pairs, each_s=SYNCHRONIZATION_MATCHES * match_s, spread=False),
            Work(stage="poses", number=NUM_ROUNDS * local, each_s=trial.refinement_s),
            Work(stage="confidence", number=num_shapes, each_s=TRUST_REFINEMENTS * trial.refinement_s),
        ]
    if options.incomplete == AUTO and num_shapes >= MIN_SHAPES:
        missing_s = MISSING_REFINEMENTS * trial.refinement_s
        work.append(Work(stage="incomplete shapes", number=num_shapes, each_s=missing_s))
    tiles = min(num_shapes, MOST_TILES)
    return [
        *work,
        Work(stage="outputs", number=num_shapes, each_s=OUTPUT_READS * trial.read_s),
        Work(stage="outputs", number=tiles, each_s=TILE_MATCHES * match_s, spread=False),
    ]


def _evenly(num: int) -> list[int]:
    """Return the positions of the trial's shapes among so many."""
    return sorted({round(position) for position in np.linspace(0, num - 1, min(num, NUM_TRIAL_SHAPES))})


def _refinement_s(shapes: Shapes, pairs: Sequence[Pair]) -> float:
    """Return the seconds that the refinement of a pair takes; 0 where shapes have no dense samples."""
    if min(len(item.dense_indices) for item in shapes.samples) < 2:
        return 0.0
    points = [dense_points(item, invariants=False) for item in shapes.samples]
    started = time.perf_counter()
    for pair in pairs:
        refine_pose(points[pair.target], points[pair.source], pair.rotations[0, :3, :3])
    return (time.perf_counter() - started) / len(pairs)


def _read_s(shapes: Shapes, options: AlignOptions) -> float:
    started = time.perf_counter()
    for file in shapes.files:
        read_shape(file, options.cleaning)
    return (time.perf_counter() - started) / len(shapes.files)
