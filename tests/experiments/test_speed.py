"""What a fresh process took, what is installed, and the lines of the table of speed."""

import pytest

from data_tools.errors import InputError
from experiments import load_experiment
from experiments.__main__ import app
from experiments.experiment import Bench
from experiments.peers.speed import ALIGNED, COMMANDS, GOALS, PM_SDP_SIZES
from experiments.provenance import ROOT, code_digest


def test_every_line_has_a_goal():
    relaxations = {f"PM-SDP of {num} points" for num in PM_SDP_SIZES}
    assert set(GOALS) == {*ALIGNED, *COMMANDS, *relaxations, "installed"}


def test_single_lines_are_measured_and_the_page_names_the_others(tmp_path):
    words = ["speed", "--only", "collalign --help", "--only", "installed", "--quick", "--quiet"]
    assert app([*words, "--out", str(tmp_path)], exit_on_error=False) == 0
    rows = (tmp_path / "results" / "speed.csv").read_text("utf-8").splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == ["collalign --help", "installed"]
    page = (tmp_path / "results" / "speed.md").read_text("utf-8")
    assert code_digest(ROOT) in page
    missing = page.partition("Not measured here: ")[2]
    assert all(line in missing for line in GOALS if line not in ("collalign --help", "installed"))
    assert "installed;" not in missing


def test_lines_that_there_are_not_are_refused(tmp_path):
    with pytest.raises(InputError, match="no line is called '117 teeth'"):
        load_experiment("speed").measure(Bench(data=tmp_path, store=None, only=("117 teeth",)))
    with pytest.raises(InputError, match="theorem3: --only does not apply"):
        app(["theorem3", "--only", "chair", "--out", str(tmp_path)], exit_on_error=False)
