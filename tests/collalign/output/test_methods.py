"""The paragraph for a paper says what the result is, and records say how every folder was made."""

import dataclasses
import json
import os
import shutil

import numpy as np
import pytest

from collalign.output.methods.paragraph import methods_paragraph
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
    for tool, given in OPTIONS.items():
        write_record(tmp_path / tool, tool, given)
    capsys.readouterr()
    run_command("status", tmp_path, "--cite")
    said = capsys.readouterr().out
    assert "5 surfaces were brought into dense correspondence (800 vertices)" in said
    assert "(type II) and permuted residuals" in said
    assert "9999 random permutations (seed 4)" in said
    assert "shape ~ size + sex" in said
    assert "RRPP" in said
    assert "7 landmarks were carried to all specimens from 1 template (s1)" in said


TESTS = {
    "model": "size + sex",
    "sums_of_squares": "II",
    "permutations": 9999,
    "seed": 4,
    "blocks": [],
}
OPTIONS = {
    "transfer": {
        "result": "..",
        "templates": ["s1"],
        "num_landmarks": 7,
        "semilandmarks": [],
        "slide": None,
        "num_carried": 33,
        "num_lacking": 2,
        "num_contradicted": 0,
        "left_out_error": None,
        "left_out_median": None,
        "median_radius": 0.25,
    },
    "variation": {
        "result": "..",
        "tests": TESTS,
        "num_shapes": 5,
        "num_vertices": 800,
        "labels": ["sex"],
        "left_out": [["shape_001", "doubtful"]],
        "include_doubtful": False,
        "without_posture": False,
        "symmetry": None,
        "individuals": None,
        "sides": None,
        "repeats": [],
    },
}


def write_record(folder, tool, options):
    """Write the record of a tool as the tool does."""
    folder.mkdir(exist_ok=True)
    record = {"tool": tool, "options": options}
    (folder / f"run-{tool}.json").write_text(json.dumps(record))


def test_the_folder_of_a_tool_tells_the_whole_chain_wherever_both_are(tmp_path):
    home, moved = tmp_path / "a" / "out", tmp_path / "b"
    write_result(view_of(6), home)
    write_record(tmp_path / "a" / "marks", "transfer", OPTIONS["transfer"] | {"result": "../out"})
    said = run_command("status", tmp_path / "a" / "marks", "--cite").out
    told = run_command("status", tmp_path / "a" / "marks", ends=2).err
    assert "written by a tool" in told
    assert said.startswith("We aligned 6 surfaces")
    assert "from 1 template (s1)" in said
    assert "33 landmarks were carried" in said
    assert "has a median of 0.25" in said
    assert "dense correspondence" not in said
    shutil.move(tmp_path / "a", moved)
    assert run_command("status", moved / "marks", "--cite").out == said
    shutil.rmtree(moved / "out")
    assert (
        "(../out) is not there any more"
        in run_command("status", moved / "marks", "--cite", ends=2).err
    )
    nothing = run_command("status", tmp_path, "--cite", ends=2).err
    assert "there is no result" in nothing


def test_who_was_left_out_is_said_and_by_whom():
    view = view_of(6)
    asked = dataclasses.replace(view.run, left_out=("old", "young"))
    said = methods_paragraph(dataclasses.replace(view, run=asked))
    assert "We left out 2 specimens (old, young) beforehand." in said
    assert "The program left out 1 file or pair that it could not use: folder/broken.ply." in said
    assert "left out" not in methods_paragraph(dataclasses.replace(view, excluded=()))


def test_a_call_from_python_has_no_command(tmp_path):
    export(view_of(6), "csv", tmp_path)
    assert read_json(tmp_path / "run-export-csv.json")["command"] == ""


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
