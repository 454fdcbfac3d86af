"""Measures of a confidence: honest statements pass, overconfident and shuffled ones do not."""

from __future__ import annotations

import numpy as np
import pytest

from data_tools.errors import InputError
from experiments.confidence.reliability import auc_within, reliability, right_above, unnoticed_runs

RNG = np.random.default_rng(0)
STATED = RNG.random(20000)
HONEST = RNG.random(20000) < STATED


def test_honest_statements_are_calibrated_and_overconfident_ones_are_not() -> None:
    honest, boasting = reliability(STATED, HONEST), reliability(np.sqrt(STATED), HONEST)
    assert honest.expected_error < 0.02 < 0.1 < boasting.expected_error
    assert honest.worst_excess < 0.05 < 0.1 < boasting.worst_excess
    assert honest.count.sum() == len(STATED)


def test_ranking_counts_pairs_of_the_same_run_and_ties_half() -> None:
    right = np.array([True, False, True, False])
    assert auc_within([0.9, 0.1, 0.5, 0.5], right, [0, 0, 1, 1]) == 0.75
    assert auc_within([0.1, 0.9, 0.9, 0.1], right, [0, 0, 1, 1]) == 0.5
    assert np.isnan(auc_within([0.9, 0.1], [True, True], [0, 0]))


def test_a_run_is_unnoticed_if_one_wrong_shape_has_no_word() -> None:
    run = np.array([0, 0, 1, 1])
    wrong = np.array([True, True, False, True])
    assert unnoticed_runs(wrong, np.array([True, False, False, True]), run) == 0.5
    assert unnoticed_runs(wrong, wrong, run) == 0.0


def test_share_of_the_sure() -> None:
    share, count = right_above([0.99, 0.95, 0.2], [True, False, False], 0.95)
    assert (share, count) == (0.5, 2)
    assert np.isnan(right_above([0.1], [True], 0.95)[0])


@pytest.mark.parametrize("stated", [[], [1.2], [np.nan]])
def test_impossible_confidences_are_refused(stated: list[float]) -> None:
    with pytest.raises(InputError, match="stated"):
        reliability(stated, [True] * len(stated))
