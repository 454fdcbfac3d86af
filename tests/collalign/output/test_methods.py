"""The paragraph for a paper says what the result is, and records say how every folder was made."""

import dataclasses
import json
import os

import numpy as np
import pytest

from collalign.options import AlignOptions
from collalign.output.provenance import methods_paragraph, option_words
from collalign.tools.export.run import export
from tests.commands import read_json, run_command
from tests.view_problems import view_of, write_result


def test_figures_are_those_of_the_result():
    view = view_of(6)
    said = methods_paragraph(view)
    num_sure = int((view.confidence >= 0.95).sum())
    assert said.startswith("We aligned 6 surfaces with collalign ")
    assert f"confidence was at least 95 % for {num_sure} of 6 poses." in said
    assert f"{len(view.pairs)} pairs of surfaces were matched" in said
    assert (
        "(2016) Point registration via efficient convex relaxation" in said.split("References")[1]
    )
    assert "by hand" not in said
    assert "incomplete" not in said
    by_hand = methods_paragraph(dataclasses.replace(view, by_hand={view.names[0]: 0.1}))
    assert "1 of 6 poses was set by hand" in by_hand
    some = np.where(np.arange(6) < 5, np.nan, view.confidence)
    for confidence, is_known in ((some, True), (np.full(6, np.nan), False)):
        told = methods_paragraph(dataclasses.replace(view, confidence=confidence))
        assert ("confidence" in told) == is_known


def test_tools_of_the_folder_are_cited_and_every_export_has_a_record(tmp_path, capsys):
    view = view_of(6)
    write_result(view, tmp_path)
    run_command("export", tmp_path, "--format", "csv", "--to", tmp_path / "csv")
    record = read_json(tmp_path / "csv" / "run-export-csv.json")
    assert record["command"].startswith("collalign export ")
    assert record["options"]["space"] == "unscaled"
    assert {"version", "date"} <= record.keys()
    tests = {"model": "size + sex", "sums_of_squares": "II", "permutations": 9999, "seed": 4}
    options = {
        "variation": {"tests": tests, "num_shapes": 5, "num_vertices": 800},
        "transfer": {"templates": ["s1"], "num_landmarks": 7},
    }
    for tool, given in options.items():
        (tmp_path / tool).mkdir()
        record = {"tool": tool, "options": given}
        (tmp_path / tool / f"run-{tool}.json").write_text(json.dumps(record))
    capsys.readouterr()
    run_command("status", tmp_path, "--cite")
    said = capsys.readouterr().out
    assert "5 surfaces were brought into dense correspondence (800 vertices)" in said
    assert "(type II) and 9999 random permutations" in said
    assert "shape ~ size + sex" in said
    assert "RRPP" in said
    assert "7 landmarks were carried to all specimens from 1 template (s1)." in said


def test_a_call_from_python_has_no_command(tmp_path):
    export(view_of(6), "csv", tmp_path)
    assert read_json(tmp_path / "run-export-csv.json")["command"] == ""


def test_options_are_said_where_they_are_not_as_by_default():
    options = AlignOptions(seed=3, sampling={"num_points": 30})
    assert {*option_words(options)} == {"--seed=3", "--sampling.num-points=30"}


@pytest.mark.parametrize(
    "record",
    ["", "[1]", "[" * 100_000, "{}", '{"options": {"tests": 3}}', '{"options": []}', "pipe"],
)
@pytest.mark.parametrize("tool", ["variation", "transfer"])
def test_a_record_that_anybody_wrote_is_passed_over(tmp_path, tool, record):
    view = dataclasses.replace(view_of(6), folder=tmp_path)
    path = tmp_path / tool / f"run-{tool}.json"
    path.parent.mkdir()
    if record == "pipe":
        os.mkfifo(path)
    else:
        path.write_text(record)
    assert methods_paragraph(view) == methods_paragraph(view_of(6))
