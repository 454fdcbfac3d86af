"""Forecasts: by what shapes and pairs took, by the number of workers, and unknown where nothing was timed."""

import math

import pytest

from collalign.engine.store import Store
from collalign.options import AlignOptions
from collalign.stages.forecast import costs_of, forecast

NOTHING = math.nan
COSTS = 2.0
KINDS = {"shapes": COSTS, "pairs": COSTS, "surfaces": NOTHING, "evidence": NOTHING}


def estimate(num_jobs=1, costs=KINDS, pilot=False, missing_shapes=0, missing_pairs=0):
    return forecast(
        costs, (10, missing_shapes), (45, missing_pairs), AlignOptions(), num_jobs, pilot=pilot
    )


def test_time_follows_what_a_store_holds(tmp_path):
    with Store.open(tmp_path / "store") as store:
        for i in range(20):
            store.put("pairs", f"{i:040x}", {"energy": 0.5}, label=f"a{i} ~ b{i}", seconds=0.5)
        found = estimate(costs=costs_of(store), missing_pairs=2000)
    assert found.stages_s["pairs"] == pytest.approx(1000.0)
    assert "2000 pairs" in str(found)
    assert "time unknown" in str(found)  # nothing is known of shapes, whose outputs take time
    assert "pairs 3.0" in str(estimate(missing_pairs=90))


def test_workers_divide_the_time_of_what_they_share():
    times = [estimate(num, missing_shapes=10, missing_pairs=45).stages_s for num in (1, 2, 4)]
    assert (times[0]["shapes"], times[0]["pairs"]) == pytest.approx((20.0, 90.0))
    assert times[0]["pairs"] / 2 <= times[1]["pairs"] <= times[0]["pairs"] / 1.8
    assert times[2]["pairs"] < times[1]["pairs"]
    assert times[2]["outputs"] > 0.4 * times[0]["outputs"]  # most of it is one picture
    assert sum(times[0].values()) == estimate(missing_shapes=10, missing_pairs=45).seconds


def test_the_pilot_costs_pairs():
    assert estimate(pilot=True).stages_s["pairs"] == pytest.approx(50.0)
    assert estimate().stages_s["pairs"] == 0.0
