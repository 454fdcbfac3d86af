"""Measures of a confidence: honest statements pass, overconfident and shuffled ones do not."""

from types import SimpleNamespace

import numpy as np

from collalign.products.trust import KINDS
from experiments.collections.posed import MIRRORED_DEG, PosedCollection
from experiments.confidence.confidence import by_size, stated_by_held_out_weights
from experiments.confidence.draws import measure_run, measure_runs, shape_facts
from experiments.confidence.fit import training_rows
from experiments.confidence.reliability import auc_within, reliability, right_above, unnoticed_runs
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


def test_a_run_is_unnoticed_if_one_wrong_shape_has_no_word():
    run = np.array([0, 0, 1, 1])
    wrong = np.array([True, True, False, True])
    assert unnoticed_runs(wrong, np.array([True, False, False, True]), run) == 0.5
    assert unnoticed_runs(wrong, wrong, run) == 0.0


def test_share_of_the_sure():
    share, count = right_above([0.99, 0.95, 0.2], [True, False, False], 0.95)
    assert (share, count) == (0.5, 2)
    assert np.isnan(right_above([0.1], [True], 0.95)[0])


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


def test_limits_of_a_confidence_stay_when_others_judge():
    records = {"teeth": record_of(9.0), "ant": record_of(9.0)}
    records["ant"]["evidence"][:] = 1.0
    stated = stated_by_held_out_weights(records)["ant"]["stated"]
    assert stated.max() <= 0.5


def test_wrong_chirality_is_no_evidence_about_turns():
    record = record_of(9.0)
    record["error_deg"][:7] = MIRRORED_DEG
    record["intruder"][7:9] = True
    record["evidence"][9, 0] = np.nan
    assert len(training_rows({"teeth": record})[0]) == len(record["right"]) - 10


def test_sizes_tell_what_few_shapes_state_and_how_they_are_wrong():
    record = record_of(9.0, num=13)
    record["run"] = np.repeat([0, 1, 2], [2, 3, 8])
    record["stated"] = np.full(13, 0.96)
    record["right"] = np.arange(13) != 1
    record["error_deg"] = np.where(record["right"], 0.0, 90.0)
    record["error_deg"][4], record["right"][4] = MIRRORED_DEG, False
    two, three, more = by_size({"teeth": record})
    assert [row["size"] for row in (two, three, more)] == ["2", "3", "7 to 12"]
    assert (two["wrong_pose"], two["wrong_side"], three["wrong_pose"], three["wrong_side"]) == (
        1,
        0,
        0,
        1,
    )
    assert more["right"] == more["usable"] == 100.0


def test_runs_are_measured_one_by_one_and_joined_by_kind():
    asked = {}

    def measure(cells):
        asked.update(cells)
        return {label: {"run": np.full(2, one["run"])} for label, one in cells.items()}

    found = measure_runs(measure, {"ant": 2, "noise": 1}, seed=7)
    assert {kind: record["run"].tolist() for kind, record in found.items()} == {
        "ant": [0, 0, 1, 1],
        "noise": [0, 0],
    }
    assert asked["ant, run 1"] == {"kind": "ant", "seed": 7, "run": 1}


def test_a_run_is_drawn_by_its_number_and_says_what_was_stated_and_is_true(tmp_path):
    first, again, other = (
        measure_run(Cell(data=tmp_path, settings={"kind": "cylinders", "seed": 11, "run": run}))
        for run in (4, 4, 0)
    )
    np.testing.assert_array_equal(first["stated"], again["stated"])
    assert len(first["stated"]) != len(other["stated"])
    assert not first["intruder"].any()
    assert first["named"].all()


def test_shapes_of_different_parts_are_not_compared(tmp_path):
    names = tuple(f"m{i}" for i in range(5))
    relative = np.broadcast_to(np.eye(3), (5, 5, 3, 3))
    posed = PosedCollection(folder=tmp_path, names=names, relative=relative)
    rotations = np.stack([np.eye(3)] * 5)
    rotations[3:] = np.diag([-1.0, -1.0, 1.0])
    aligned = SimpleNamespace(
        names=names,
        rotations=rotations,
        confidence=np.ones(5),
        notes=(),
        made=SimpleNamespace(trust=None),
    )
    for parts, right in (
        ([0, 0, 0, 0, 0], [True, True, True, False, False]),
        ([0, 0, 0, 1, 1], [True, True, True, True, True]),
        ([0, 0, 2, 1, 1], [True, True, False, True, True]),  # alone: nothing to be right about
    ):
        aligned.part_numbers = np.array(parts)
        facts = shape_facts(aligned, posed, "teeth")
        assert [fact["right"] for fact in facts] == right
