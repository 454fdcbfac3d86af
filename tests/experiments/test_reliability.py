"""Measures of a confidence: honest statements pass, overconfident and shuffled ones do not."""

import numpy as np

from collalign.products.trust import KINDS
from experiments.confidence.confidence import stated_by_held_out_weights
from experiments.confidence.draws import measure_run
from experiments.confidence.reliability import auc_within, reliability
from experiments.experiment import Cell

RNG = np.random.default_rng(0)
STATED = RNG.random(20000)
HONEST = RNG.random(20000) < STATED


def test_honest_statements_are_calibrated_and_overconfident_ones_are_not():
    honest, boasting = reliability(STATED, HONEST), reliability(np.sqrt(STATED), HONEST)
    assert honest.expected_error < 0.02 < 0.1 < boasting.expected_error
    assert honest.worst_excess < 0.05 < 0.1 < boasting.worst_excess
    assert honest.count.sum() == len(STATED)


def test_ranking_counts_pairs_of_the_same_run_and_ties_half():
    right = np.array([True, False, True, False])
    assert auc_within([0.9, 0.1, 0.5, 0.5], right, [0, 0, 1, 1]) == 0.75
    assert auc_within([0.1, 0.9, 0.9, 0.1], right, [0, 0, 1, 1]) == 0.5
    assert np.isnan(auc_within([0.9, 0.1], [True, True], [0, 0]))


def record_of(slope, num=400):
    """Return a record whose votes say the truth if the slope is positive, and its contrary if it is negative."""
    rng = np.random.default_rng(5)
    evidence = np.full((num, len(KINDS)), 0.5)
    evidence[:, KINDS.index("votes")] = evidence[:, KINDS.index("collection votes")] = rng.random(
        num
    )
    right = rng.random(num) < 1.0 / (1.0 + np.exp(-slope * (evidence[:, 0] - 0.5)))
    return {
        "evidence": evidence,
        "right": right,
        "error_deg": np.where(right, 0.0, 90.0),
        "intruder": np.zeros(num, dtype=bool),
        "stated": np.full(num, 0.5),
        "run": np.zeros(num, dtype=np.int64),
    }


def test_a_collection_is_judged_by_the_others_alone():
    records = {"teeth": record_of(9.0), "ant": record_of(9.0), "fish": record_of(-9.0)}
    judged = stated_by_held_out_weights(records)
    votes = records["fish"]["evidence"][:, 0]
    assert (
        np.corrcoef(judged["fish"]["stated"], votes)[0, 1] > 0.9
    )  # what teeth and ants say, which is wrong here
    assert (
        auc_within(judged["fish"]["stated"], records["fish"]["right"], records["fish"]["run"]) < 0.3
    )


def test_a_run_is_drawn_by_its_number_and_says_what_was_stated_and_is_true(tmp_path):
    first, again, other = (
        measure_run(Cell(data=tmp_path, settings={"kind": "cylinders", "seed": 11, "run": run}))
        for run in (4, 4, 0)
    )
    np.testing.assert_array_equal(first["stated"], again["stated"])
    assert len(first["stated"]) != len(other["stated"])
    assert not first["intruder"].any()
    assert first["named"].all()
