"""How long a run will take, by what shapes and pairs took so far, and fixed rates for the rest."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.engine.store import Store
from collalign.options import AUTO, AlignOptions
from collalign.stages.choose_pairs import all_pairs
from collalign.stages.evidence.weigh import wants_maps, weigh_pairs
from collalign.stages.incomplete.detect import MIN_COMPLETE_SHAPES
from collalign.stages.match_pairs import match_pairs
from collalign.stages.pieces import assembled_shapes
from collalign.stages.shape_stage import MOST_FOR_SIDES, prepare_shapes
from collalign.stages.trust.rival_poses import MAX_PARTNERS
from data_tools.io.listing import FolderListing

#: Shapes of a trial, from all over the folder.
NUM_TRIAL_SHAPES = 5

# Measured by cProfile and tests/benchmarks/bench_estimate.py on teeth, skulls, bodies and generated shapes.
#: In times of matching a pair: of each pair, in all synchronizations; of each shape, the pairs
#: of the pilot, the refinement of its local pairs, its confidence, the search of what is missing, and its tile.
SYNCHRONIZATION, PILOT, LOCAL, CONFIDENCE, MISSING, TILE = 0.1, 2.5, 4.0, 1.0, 1.65, 0.5
#: Outputs of a shape, in times of preparing one; so many shapes have tiles.
OUTPUT, MOST_TILES = 0.13, 100
#: Share of its ideal speed that each further worker reaches (1.8 to 1.98 of 2 measured).
_EFFICIENCY = 0.95
_MINUTE_S = 60.0


@dataclass(frozen=True, kw_only=True)
class RunEstimate:
    """What a run is expected to take.

    Attributes
    ----------
    num_shapes, num_pairs : int
        Still to be computed.
    stages_s : mapping of str to float
        Wall-clock seconds of each stage with the given workers; NaN where nothing similar has been timed yet.
    tasks : mapping of str to int
        What workers are given in each stage whose tasks are known before.
    store_bytes : float
        What the store grows by; NaN where no similar record is known.
    """

    num_shapes: int
    num_pairs: int
    stages_s: Mapping[str, float]
    tasks: Mapping[str, int]
    store_bytes: float

    @property
    def seconds(self) -> float:
        """Wall-clock time of the whole run."""
        return sum(self.stages_s.values())

    def __str__(self) -> str:
        stages = ", ".join(
            f"{stage} {seconds / _MINUTE_S:.1f}" for stage, seconds in self.stages_s.items()
        )
        known = (
            "unknown"
            if math.isnan(self.seconds)
            else f"{self.seconds / _MINUTE_S:.1f} min ({stages})"
        )
        return f"{self.num_shapes} shapes and {self.num_pairs} pairs to compute: time {known}"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What some shapes of a folder took.

    Attributes
    ----------
    costs, sizes : dict of str to float
        Seconds and bytes of each kind of record, by the median; NaN where there was none.
    start_s : float
        Seconds until the workers had started.
    is_assembled : bool
        Whether the shapes are assembled of components, so that all are matched by the largest and by all of these.
    """

    costs: dict[str, float]
    sizes: dict[str, float]
    start_s: float
    is_assembled: bool = False


def try_shapes(listing: FolderListing, options: AlignOptions, run: RunOptions) -> Trial:
    """Prepare and match some shapes of a folder, keep nothing of it, and return what each kind of record took.

    Raises
    ------
    CollalignError
        If too few of them are usable.
    """
    num = len(listing.names)
    chosen = sorted({round(place) for place in np.linspace(0, num - 1, min(num, NUM_TRIAL_SHAPES))})
    with Session.open(options, replace(run, store=None)) as session:
        started = time.perf_counter()
        shapes = prepare_shapes(session, listing.some(chosen))
        prepared_s = time.perf_counter() - started
        pairs, _ = match_pairs(session, shapes, all_pairs(len(shapes.names)))
        if wants_maps(options, shapes, pairs):
            weigh_pairs(session, shapes, pairs)
        assembled = assembled_shapes(session, shapes)
        costs = costs_of(session.store)
        sizes = {kind: session.store.median_bytes(kind) for kind in costs}
    busy_s = costs["shapes"] * len(shapes.names) / min(run.num_workers, len(shapes.names))
    return Trial(
        costs=costs,
        sizes=sizes,
        start_s=max(0.0, prepared_s - busy_s),
        is_assembled=bool(assembled),
    )


def costs_of(store: Store) -> dict[str, float]:
    """Return what each kind of record that the forecast reckons with cost, by the median."""
    return {
        kind: store.median_seconds(kind) for kind in ("shapes", "pairs", "surfaces", "evidence")
    }


def forecast(
    costs: Mapping[str, float],
    shapes: tuple[int, int],
    pairs: tuple[int, int],
    options: AlignOptions,
    num_jobs: int,
    *,
    pilot: bool = False,
    is_assembled: bool = False,
    start_s: float = 0.0,
    sizes: Mapping[str, float] | None = None,
) -> RunEstimate:
    """Return what a run will take.

    Parameters
    ----------
    costs : mapping of str to float
        Of similar shapes and pairs, and of their maps, none where the collection needs none.
    shapes, pairs : tuple of int
        How many there are, and of how many no store holds anything.
    options : AlignOptions
    num_jobs : int
        Worker processes.
    pilot : bool
        Whether sides are asked for.
    is_assembled : bool
        Whether shapes are matched by the largest and by all of their components. The latter is counted as if nothing
        of it were stored.
    start_s : float
        Until the workers have started.
    sizes : mapping of str to float, optional
        Bytes of each kind of record.
    """
    match_s, prepare_s = costs["pairs"], costs["shapes"]
    (num, missing_shapes), (num_pairs, missing_pairs) = shapes, pairs
    new = missing_pairs + pilot * PILOT * min(num, MOST_FOR_SIDES)
    refines = float(options.refine)
    shared = {"shapes": _times(missing_shapes, prepare_s), "pairs": _times(new, match_s)}
    tasks, records = (
        {"shapes": missing_shapes, "pairs": round(new)},
        {"shapes": missing_shapes, "pairs": new},
    )
    alone = {"start": start_s, "outputs": TILE * match_s * min(num, MOST_TILES)}
    if missing_pairs and not math.isnan(costs["evidence"]):
        settled = num * MAX_PARTNERS / 2  # as if half of the shapes were in doubt
        shared["maps"] = num * costs["surfaces"] + (missing_pairs + settled) * costs["evidence"]
        tasks["maps"] = round(num + missing_pairs + settled)
        records |= {"surfaces": num, "evidence": missing_pairs + settled}
    if options.synchronization == "robust":
        shared["poses"] = refines * LOCAL * num * match_s
        alone["poses"] = SYNCHRONIZATION * num_pairs * match_s
        shared["confidence"] = refines * CONFIDENCE * num * match_s
        tasks["confidence"] = num
    if options.incomplete == AUTO and num >= MIN_COMPLETE_SHAPES:
        shared["incomplete shapes"] = refines * MISSING * num * match_s
        tasks["incomplete shapes"] = num
    if is_assembled:
        shared["pieces"] = num * prepare_s + num_pairs * match_s
        tasks["pieces"] = num + num_pairs
        records["shapes"] += num
        records["pairs"] += num_pairs
    tasks["outputs"] = num
    shared["outputs"] = OUTPUT * prepare_s * num
    speed = 1.0 + _EFFICIENCY * (num_jobs - 1)
    return RunEstimate(
        num_shapes=missing_shapes,
        num_pairs=missing_pairs,
        stages_s={
            stage: shared.get(stage, 0.0) / speed + alone.get(stage, 0.0)
            for stage in dict.fromkeys([*shared, *alone])
        },
        tasks=tasks,
        store_bytes=sum(
            _times(number, (sizes or {}).get(kind, math.nan)) for kind, number in records.items()
        ),
    )


def _times(number: float, each: float) -> float:
    """Return the product, 0 where there is nothing to do even if the cost is unknown."""
    return number * each if number else 0.0
