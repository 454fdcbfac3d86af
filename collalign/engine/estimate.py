"""What a run will cost before it starts: time, disk and memory, from what shapes and pairs took so far."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from collalign.engine.store.layout import Costs
from data_tools.errors import OptionsError

#: Bytes of a row beside its record: key, label, digest, index entry.
_ROW_OVERHEAD_BYTES = 220
#: Pages per filled page; measured 1.1 to 1.4, depending on how many records fit a page.
_PAGE_FACTOR = 1.2
#: Share of its ideal speed that each further worker reaches (1.8 to 1.98 of 2 measured).
_EFFICIENCY = 0.95


#: Memory of a process that has loaded the libraries, and of each byte of a record while it is in use (measured at 100
#: and 300 shapes by tests/benchmarks/bench_scale.py).
_BASE_BYTES, _MEMORY_FACTOR = 2.4e8, 1.5


@dataclass(frozen=True, kw_only=True)
class Work:
    """Work of one kind that no store keeps.

    Attributes
    ----------
    stage : str
        What it counts for.
    number : float
        How many there are.
    each_s : float
        Seconds of one.
    spread : bool
        Whether all workers share it, or the parent does it alone.
    """

    stage: str
    number: float
    each_s: float
    spread: bool = True


@dataclass(frozen=True, kw_only=True)
class RunEstimate:
    """What a run is expected to take.

    Attributes
    ----------
    num_shapes, num_pairs : int
        Still to be computed.
    stages_s : mapping of str to float
        Wall-clock seconds of each stage with the given workers; NaN where nothing similar has been timed yet.
    disk_bytes : float
        What the store will grow by, to some 20 %; NaN where nothing similar has been stored yet.
    memory_bytes : float
        Peak of the parent process.
    """

    num_shapes: int
    num_pairs: int
    stages_s: Mapping[str, float]
    disk_bytes: float
    memory_bytes: float

    @property
    def seconds(self) -> float:
        """Wall-clock time of the whole run."""
        return sum(self.stages_s.values())

    def __str__(self) -> str:
        stages = ", ".join(f"{stage} {seconds / 60:.1f}" for stage, seconds in self.stages_s.items())
        seconds = "unknown" if math.isnan(self.seconds) else f"{self.seconds / 60:.1f} min ({stages})"
        disk, memory = (
            "unknown" if math.isnan(size) else f"{size / 2**20:.1f} MiB"
            for size in (self.disk_bytes, self.memory_bytes)
        )
        return (
            f"{self.num_shapes} shapes and {self.num_pairs} pairs to compute: time {seconds}, disk {disk}, "
            f"memory {memory}"
        )


def estimate_run(
    *,
    num_shapes: int,
    num_pairs: int,
    shape_costs: Costs,
    pair_costs: Costs,
    num_jobs: int = 1,
    further: Sequence[Work] = (),
) -> RunEstimate:
    """Estimate the time, disk space and memory of a run.

    Parameters
    ----------
    num_shapes, num_pairs : int
        Still to be computed, for instance ``len(store.missing("pairs", keys))``.
    shape_costs, pair_costs : Costs
        Of similar ones: :meth:`collalign.engine.store.store.Store.costs` of a store that holds some, which may be a
        trial of a few pairs in :meth:`~collalign.engine.store.store.Store.memory`.
    num_jobs : int
        Worker processes.
    further : sequence of Work
        What comes beside shapes and pairs.

    Raises
    ------
    OptionsError
        If a number is negative or there is no worker.
    """
    if num_shapes < 0 or num_pairs < 0 or num_jobs < 1:
        raise OptionsError(f"cannot estimate {num_shapes} shapes and {num_pairs} pairs on {num_jobs} workers")
    speed = 1.0 + _EFFICIENCY * (num_jobs - 1)
    stages_s: dict[str, float] = {}
    for work in (
        Work(stage="shapes", number=num_shapes, each_s=shape_costs.mean_seconds),
        Work(stage="pairs", number=num_pairs, each_s=pair_costs.mean_seconds),
        *further,
    ):
        seconds = _times(work.number, work.each_s) / (speed if work.spread else 1.0)
        stages_s[work.stage] = stages_s.get(work.stage, 0.0) + seconds
    sizes = _times(num_shapes, shape_costs.mean_bytes), _times(num_pairs, pair_costs.mean_bytes)
    return RunEstimate(
        num_shapes=num_shapes,
        num_pairs=num_pairs,
        stages_s=stages_s,
        disk_bytes=(sum(sizes) + (num_shapes + num_pairs) * _ROW_OVERHEAD_BYTES) * _PAGE_FACTOR,
        memory_bytes=_BASE_BYTES + _MEMORY_FACTOR * sum(sizes),
    )


def _times(number: float, each: float) -> float:
    """Return the product, 0 where there is nothing to do even if the cost is unknown."""
    return number * each if number else 0.0
