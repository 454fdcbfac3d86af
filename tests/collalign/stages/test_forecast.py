"""Forecasts: by what shapes and pairs took, by the number of workers, and unknown where nothing was timed."""

import math
from pathlib import Path

import numpy as np
import pytest

from collalign.engine.store.layout import Costs
from collalign.engine.store.store import Store
from collalign.options import AlignOptions
from collalign.stages.forecast import RunEstimate, Workload, costs_of, forecast

NOTHING = Costs(num_records=0, mean_seconds=math.nan, mean_bytes=math.nan)
COSTS = Costs(num_records=5, mean_seconds=2.0, mean_bytes=1e5)
KINDS = {"shapes": COSTS, "pairs": COSTS, "surfaces": NOTHING, "evidence": NOTHING}


def estimate(num_jobs: int = 1, costs: dict[str, Costs] = KINDS, pilot: bool = False, **work: int) -> RunEstimate:
    return forecast(costs, Workload(num_shapes=10, num_pairs=45, pilot=pilot, **work), AlignOptions(), num_jobs)


def test_time_and_disk_follow_what_a_store_holds(tmp_path: Path, rng: np.random.Generator) -> None:
    def fill(store: Store, first: int, last: int) -> None:
        for i in range(first, last):
            store.put("pairs", f"{i:040x}", {"R": rng.standard_normal(300)}, label=f"a{i} ~ b{i}", seconds=0.5)

    path = tmp_path / "store"
    with Store.open(path) as store:
        fill(store, 0, 20)
        found = estimate(costs=costs_of(store), missing_pairs=2000)
        fill(store, 20, 2020)
    assert found.stages_s["pairs"] == pytest.approx(1000.0)
    assert found.disk_bytes == pytest.approx(path.stat().st_size, rel=0.25)
    assert "2000 pairs" in str(found)
    assert "time unknown" in str(found)  # nothing is known of shapes, whose outputs take time
    assert "pairs 3.0" in str(estimate(missing_pairs=90))


def test_workers_divide_the_time_of_what_they_share() -> None:
    times = [estimate(num, missing_shapes=10, missing_pairs=45).stages_s for num in (1, 2, 4)]
    assert (times[0]["shapes"], times[0]["pairs"]) == pytest.approx((20.0, 90.0))
    assert times[0]["pairs"] / 2 <= times[1]["pairs"] <= times[0]["pairs"] / 1.8
    assert times[2]["pairs"] < times[1]["pairs"]
    assert times[2]["outputs"] > 0.4 * times[0]["outputs"]  # most of it is one picture
    assert sum(times[0].values()) == estimate(missing_shapes=10, missing_pairs=45).seconds


def test_the_pilot_costs_pairs() -> None:
    assert estimate(pilot=True).stages_s["pairs"] == pytest.approx(50.0)
    assert estimate().stages_s["pairs"] == 0.0


def test_memory_grows_with_the_records() -> None:
    small, large = (estimate(missing_shapes=num).memory_bytes for num in (100, 10_100))
    assert 1e9 <= large - small <= 2e9
