"""What commands say to people, to programs and to logs."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest

from collalign.cli import main
from collalign.cli.talk import end, speak, talking, tell
from collalign.engine.jobs import progress

FLAGS = ["--sampling.num-points", "12", "--sampling.num-dense-points", "0", "--jobs", "1"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("clouds")
    rng = np.random.default_rng(0)
    points = rng.random((40, 3))
    for name in "abc":
        np.savetxt(path / f"{name}.xyz", points + 0.01 * rng.standard_normal((40, 3)))
    (path / "broken.ply").write_bytes(b"rubbish")
    return path


def test_programs_get_one_object_and_logs_get_everything(folder, tmp_path, capsys):
    out, log = tmp_path / "out", tmp_path / "run.log"
    assert main(["align", str(folder), "--out", str(out), *FLAGS, "--json", "--quiet", "--log", str(log)]) == 3
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert (told["command"], told["exit_code"], told["shapes"], told["pairs"]) == ("align", 3, 3, 3)
    assert [one["file"] for one in told["left_out"]] == ["broken.ply"]
    assert str(out / "alignment.json") in told["files"]
    assert "broken.ply" in said.err
    assert "pairs:" not in said.err
    lines = log.read_text("utf-8").splitlines()
    assert any("pairs: 0 of 3" in line for line in lines)
    assert any("Aligned 3 shapes" in line for line in lines)
    assert lines[-1].endswith("exit code 3")


def test_off_a_terminal_stages_are_lines_unless_nobody_wants_them(folder, tmp_path, capsys):
    align = ["align", str(folder), "--out", str(tmp_path), *FLAGS]
    assert main(align) == 3
    said = capsys.readouterr()
    assert "pairs: 0 of 3\n" in said.err
    assert "Aligned 3 shapes" in said.out
    assert main([*align, "--quiet"]) == 3
    assert capsys.readouterr().out == ""
    assert not logging.getLogger("collalign").handlers, "what a command listens by ends with it"


def test_every_minute_has_a_line(monkeypatch, caplog):
    monkeypatch.setattr(progress, "_LINE_EVERY_S", 0.0)
    with caplog.at_level(logging.INFO), progress.ProgressBar("pairs", 4, done=1) as bar:
        bar.advance(2)
    assert caplog.messages == ["pairs: 1 of 4", "pairs: 3 of 4"]


@pytest.mark.parametrize(
    "wrong", [["align", "nowhere", "--out", "out"], ["align", ".", "--out", "x", "--nothing", "1"]]
)
def test_errors_are_told_as_well(wrong, capsys):
    assert main([*wrong, "--json"]) == 2
    told = json.loads(capsys.readouterr().out)
    assert told["exit_code"] == 2
    assert wrong[-2] in told["error"] or "nowhere" in told["error"]


def test_a_batch_tells_of_each_folder(folder, tmp_path, capsys):
    jobs = "".join(
        f"[[jobs]]\nfolder = '{at}'\nout = '{tmp_path / out}'\n" for at, out in ((folder, "x"), ("no", "y"))
    )
    (tmp_path / "batch.toml").write_text("[options.sampling]\nnum_points = 12\nnum_dense_points = 0\n" + jobs)
    assert main(["batch", str(tmp_path / "batch.toml"), "--jobs", "1", "--json"]) == 3
    first, second = json.loads(capsys.readouterr().out)["jobs"]
    assert (first["shapes"], first["exit_code"], second["exit_code"]) == (3, 3, 2)
    assert "no such folder" in second["error"]


def test_what_is_unknown_is_null_for_programs(capsys):
    with talking():
        speak(quiet=False, as_json=True, verbose=False, log=None)
        tell(
            confidence=np.array([0.5, np.nan]),
            bound=float("-inf"),
            path=Path("a"),
            nested={"x": (np.float64("nan"),)},
        )
        assert end(3) == 3
    told = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert told == {"exit_code": 3, "confidence": [0.5, None], "bound": None, "path": "a", "nested": {"x": [None]}}


def test_a_log_that_cannot_be_written_is_named(tmp_path, capsys):
    assert main(["status", str(tmp_path), "--log", str(tmp_path)]) == 2
    assert f"--log {tmp_path}: cannot be written" in capsys.readouterr().err
