"""What commands say to people, to programs and to logs."""

import errno
import json
import logging
import os
from types import SimpleNamespace

import numpy as np
import pytest

from collalign.engine import progress
from tests.commands import read_json, run_command

TEXTS = (".json", ".csv", ".html")
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


def test_programs_get_one_object_and_logs_get_everything(folder, tmp_path):
    out, log = tmp_path / "out", tmp_path / "run.log"
    said = run_command(
        "align", folder, "--out", out, *FLAGS, "--json", "--quiet", "--log", log, ends=3
    )
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


def test_off_a_terminal_stages_are_lines_unless_nobody_wants_them(folder, tmp_path):
    align = ["align", str(folder), "--out", str(tmp_path), *FLAGS]
    said = run_command(*align, ends=3)
    assert "pairs: 0 of 3\n" in said.err
    assert "Aligned 3 shapes" in said.out
    assert run_command(*align, "--quiet", ends=3).out == ""
    assert not logging.getLogger("collalign").handlers, "what a command listens by ends with it"


def test_a_stage_has_a_line_at_its_start_and_end_and_one_a_minute_between(monkeypatch, caplog):
    now = [0.0]
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now[0]))
    with caplog.at_level(logging.INFO), progress.ProgressBar("pairs", 200) as bar:
        for _ in range(200):
            now[0] += 0.7
            bar.advance()
    assert caplog.messages == [
        "pairs: 0 of 200",
        "pairs: 86 of 200, 60.2 s",
        "pairs: 172 of 200, 120.4 s",
        "pairs: 200 of 200, 140.0 s",
    ]
    assert caplog.records[-1].numbers == {
        "event": "end",
        "stage": "pairs",
        "done": 200,
        "total": 200,
        "failed": 0,
        "seconds": 140.0,
    }


@pytest.mark.parametrize(
    "wrong", [["align", "nowhere", "--out", "out"], ["align", ".", "--out", "x", "--nothing", "1"]]
)
def test_errors_are_told_as_well(wrong):
    told = json.loads(run_command(*wrong, "--json", ends=2).out)
    assert told["exit_code"] == 2
    assert wrong[-2] in told["error"] or "nowhere" in told["error"]


def test_a_log_of_lines_for_programs_tells_of_each_stage_and_the_end(folder, tmp_path):
    log = tmp_path / "run.jsonl"
    run_command("align", folder, "--out", tmp_path / "out", *FLAGS, "--log", log, ends=3)
    lines = [json.loads(line) for line in log.read_text("utf-8").splitlines()]
    assert lines[0] == {"format": "collalign-log", "version": 1}
    assert [line.get("exit_code") for line in lines].count(3) == 1
    stages = [line for line in lines[1:] if "stage" in line]
    events = [line["event"] for line in stages if line["stage"] == "outputs"]
    assert events == ["begin", "end"]
    assert stages[-1] | {"message": "", "time": "", "seconds": 0} == {
        "time": "",
        "level": "info",
        "message": "",
        "event": "end",
        "stage": "outputs",
        "done": 3,
        "total": 3,
        "failed": 0,
        "seconds": 0,
    }
    assert all(line["seconds"] >= 0 and line["done"] <= line["total"] for line in stages)
    assert all({"time", "level", "message"} <= line.keys() for line in lines[1:])


def test_control_characters_in_names_reach_no_output(tmp_path):
    shapes, out, red = tmp_path / "in", tmp_path / "out", "\x1b[31m"
    shapes.mkdir()
    points = np.random.default_rng(0).random((40, 3))
    for name in ("a", f"{red}b", "c\nd"):
        np.savetxt(shapes / f"{name}.xyz", points)
    (shapes / f"{red}bad\n.ply").write_bytes(b"rubbish")
    (shapes / f"{red}note.md").touch()
    said = [
        *run_command("align", shapes, "--out", out, *FLAGS, "--log", tmp_path / "log", ends=3),
        *run_command("align", tmp_path / f"{red}\ngone.ply", "--out", out, *FLAGS, ends=2),
        *run_command("status", out, ends=3),
    ]
    files = [path for path in out.iterdir() if path.suffix in TEXTS]
    texts = [path.read_text("utf-8") for path in (*files, tmp_path / "log")]
    assert not [text for text in (*said, *texts) if "\x1b" in text or "d.xyz: c" in text]
    assert "\\x1b[31mbad\\n.ply" in said[1]
    assert "\\x1b[31m\\ngone.ply: " in said[3]
    assert read_json(out / "alignment.json")["shapes"][0]["name"] == "\\x1b[31mb"
    assert "\\x1b[31mb" in (out / "pairs.csv").read_text()
    assert "c\\nd" in (out / "pairs.csv").read_text()


def test_a_disk_without_room_for_one_more_file_is_said(folder, tmp_path, monkeypatch):
    def refuse(*arguments, **keywords):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/tmp/x")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    said = run_command("align", folder, "--out", tmp_path / "out", *FLAGS, ends=1)
    assert "/tmp/x: the disk is full, or has no room for one more file" in said.err
    monkeypatch.undo()
    monkeypatch.setattr("data_tools.io.files.os.replace", refuse)
    assert "`df -i`" in run_command("align", folder, "--out", tmp_path / "out", *FLAGS, ends=2).err


def test_a_log_that_cannot_be_written_is_named(tmp_path):
    said = run_command("status", tmp_path, "--log", tmp_path, ends=2)
    assert f"--log {tmp_path}: cannot be written" in said.err
