from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from collalign.engine.store.records import encode
from collalign.engine.store.store import Store
from tests.faults import run_with_kills, worker_processes
from tests.resumable_run import main

ROOT = Path(__file__).resolve().parents[3]
NUM_TASKS = 120


def contents(path: Path) -> dict[str, bytes]:
    with Store.open(path, read_only=True) as store:
        return {key: encode(store.require("pairs", key)) for key in store.keys("pairs")}


def test_a_run_that_is_killed_again_and_again_ends_with_the_same_bytes(tmp_path: Path) -> None:
    main(str(tmp_path / "undisturbed"), NUM_TASKS)
    killed = tmp_path / "killed"
    command = [sys.executable, "-m", "tests.resumable_run", str(killed), str(NUM_TASKS)]
    log = run_with_kills(command, 5, np.random.default_rng(0), delay_s=(0.8, 1.6), parent_share=0.5, cwd=ROOT)
    assert log.kills >= 2
    with Store.open(killed) as store:
        status = store.status()["pairs"]
        assert (status.left, status.failed) == (0, 0)
    assert contents(killed) == contents(tmp_path / "undisturbed")


def test_a_lost_record_would_be_noticed(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with Store.open(tmp_path / name) as store:
            store.put("pairs", "k", {"x": 1.0 if name == "a" else 1.0 + 1e-15})
    assert contents(tmp_path / "a") != contents(tmp_path / "b")


def test_a_command_that_fails_is_not_taken_for_a_survivor() -> None:
    with pytest.raises(RuntimeError, match="code 3"):
        run_with_kills([sys.executable, "-c", "import sys; sys.exit(3)"], 0, np.random.default_rng(0), delay_s=(1, 1))


def test_processes_that_are_no_workers_are_not_listed() -> None:
    with subprocess.Popen(["sleep", "60"]) as process:
        parent = os.getpid()
        assert process.pid not in worker_processes(parent)
        assert worker_processes(process.pid) == []
        process.kill()
