"""Measures of a confidence: honest statements pass, overconfident and shuffled ones do not."""

import numpy as np

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


def test_a_run_is_drawn_by_its_number_and_says_what_was_stated_and_is_true(tmp_path):
    first, again, other = (
        measure_run(Cell(data=tmp_path, settings={"kind": "cylinders", "seed": 11, "run": run}))
        for run in (4, 4, 0)
    )
    np.testing.assert_array_equal(first["stated"], again["stated"])
    assert len(first["stated"]) != len(other["stated"])
    assert not first["intruder"].any()
    assert first["named"].all()
