import math
from pathlib import Path

import numpy as np
import pytest

from collalign.engine.estimate import Work, estimate_run
from collalign.engine.store.layout import Costs
from collalign.engine.store.store import Store
from data_tools.errors import OptionsError

NOTHING = Costs(num_records=0, mean_seconds=math.nan, mean_bytes=math.nan)


def test_time_and_disk_follow_what_a_store_holds(tmp_path: Path, rng: np.random.Generator) -> None:
    def fill(store: Store, first: int, last: int) -> None:
        for i in range(first, last):
            store.put("pairs", f"{i:040x}", {"R": rng.standard_normal(300)}, label=f"a{i} ~ b{i}", seconds=0.5)

    path = tmp_path / "store"
    with Store.open(path) as store:
        fill(store, 0, 20)
        estimate = estimate_run(
            num_shapes=0, num_pairs=2000, shape_costs=NOTHING, pair_costs=store.costs("pairs"), num_jobs=1
        )
        fill(store, 20, 2020)
    assert estimate.seconds == pytest.approx(1000.0)
    assert estimate.disk_bytes == pytest.approx(path.stat().st_size, rel=0.25)
    assert "2000 pairs" in str(estimate)
    assert "16.7 min" in str(estimate)


def test_workers_divide_the_time() -> None:
    costs = Costs(num_records=5, mean_seconds=2.0, mean_bytes=1000.0)
    times = [
        estimate_run(num_shapes=10, num_pairs=45, shape_costs=costs, pair_costs=costs, num_jobs=num).seconds
        for num in (1, 2, 4)
    ]
    assert times[0] == pytest.approx(110.0)
    assert times[0] / 2 <= times[1] <= times[0] / 1.8
    assert times[2] < times[1]


def test_what_is_unknown_is_said() -> None:
    estimate = estimate_run(num_shapes=0, num_pairs=1, shape_costs=NOTHING, pair_costs=NOTHING)
    assert math.isnan(estimate.seconds)
    assert "time unknown, disk unknown" in str(estimate)
    with pytest.raises(OptionsError):
        estimate_run(num_shapes=-1, num_pairs=0, shape_costs=NOTHING, pair_costs=NOTHING)


def test_further_work_counts_for_its_stage_and_is_spread_or_not() -> None:
    costs = Costs(num_records=5, mean_seconds=2.0, mean_bytes=1000.0)
    further = [
        Work(stage="pairs", number=5, each_s=2.0),
        Work(stage="outputs", number=10, each_s=0.5, spread=False),
    ]
    alone, shared = (
        estimate_run(
            num_shapes=10, num_pairs=45, shape_costs=costs, pair_costs=costs, num_jobs=num, further=further
        ).stages_s
        for num in (1, 2)
    )
    assert alone == pytest.approx({"shapes": 20.0, "pairs": 100.0, "outputs": 5.0})
    assert shared["outputs"] == 5.0
    assert shared["pairs"] < 0.6 * alone["pairs"]


def test_memory_grows_with_the_records() -> None:
    costs = Costs(num_records=5, mean_seconds=2.0, mean_bytes=1e5)
    small, large = (
        estimate_run(num_shapes=num, num_pairs=0, shape_costs=costs, pair_costs=NOTHING).memory_bytes
        for num in (100, 10_100)
    )
    assert 1e9 <= large - small <= 2e9
