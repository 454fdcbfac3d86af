"""What a run will cost before it starts: time and disk, from what shapes and pairs took so far."""

from __future__ import annotations

import math
from dataclasses import dataclass

from collalign.engine.store.layout import Costs
from data_tools.errors import OptionsError

#: Bytes of a row beside its record: key, label, digest, index entry.
_ROW_OVERHEAD_BYTES = 220
#: Pages per filled page; measured 1.1 to 1.4, depending on how many records fit a page.
_PAGE_FACTOR = 1.2
#: Share of its ideal speed that each further worker reaches (1.8 to 1.98 of 2 measured).
_EFFICIENCY = 0.95


@dataclass(frozen=True, kw_only=True)
class RunEstimate:
    """What a run is expected to take.

    Attributes
    ----------
    num_shapes, num_pairs : int
        Still to be computed.
    seconds : float
        Wall-clock time with the given workers; NaN where nothing similar has been timed yet.
    disk_bytes : float
        What the store will grow by, to some 20 %; NaN where nothing similar has been stored yet.
    """

    num_shapes: int
    num_pairs: int
    seconds: float
    disk_bytes: float

    def __str__(self) -> str:
        seconds = "unknown" if math.isnan(self.seconds) else f"{self.seconds / 60:.1f} min"
        disk = "unknown" if math.isnan(self.disk_bytes) else f"{self.disk_bytes / 2**20:.1f} MiB"
        return f"{self.num_shapes} shapes and {self.num_pairs} pairs to compute: time {seconds}, disk {disk}"


def estimate_run(
    *, num_shapes: int, num_pairs: int, shape_costs: Costs, pair_costs: Costs, num_jobs: int = 1
) -> RunEstimate:
    """Estimate the time and disk space of a run.

    Parameters
    ----------
    num_shapes, num_pairs : int
        Still to be computed, for instance ``len(store.missing("pairs", keys))``.
    shape_costs, pair_costs : Costs
        Of similar ones: :meth:`collalign.engine.store.store.Store.costs` of a store that holds some, which may be a
        trial of a few pairs in :meth:`~collalign.engine.store.store.Store.memory`.
    num_jobs : int
        Worker processes.

    Raises
    ------
    OptionsError
        If a number is negative or there is no worker.
    """
    if num_shapes < 0 or num_pairs < 0 or num_jobs < 1:
        raise OptionsError(f"cannot estimate {num_shapes} shapes and {num_pairs} pairs on {num_jobs} workers")
    speed = 1.0 + _EFFICIENCY * (num_jobs - 1)
    work = _times(num_shapes, shape_costs.mean_seconds) + _times(num_pairs, pair_costs.mean_seconds)
    disk = _times(num_shapes, shape_costs.mean_bytes + _ROW_OVERHEAD_BYTES)
    disk += _times(num_pairs, pair_costs.mean_bytes + _ROW_OVERHEAD_BYTES)
    return RunEstimate(
        num_shapes=num_shapes, num_pairs=num_pairs, seconds=work / speed, disk_bytes=disk * _PAGE_FACTOR
    )


def _times(number: int, each: float) -> float:
    """Return the product, 0 where there is nothing to do even if the cost is unknown."""
    return number * each if number else 0.0
