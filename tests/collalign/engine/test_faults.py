import argparse
import os
import subprocess
import sys

import numpy as np
import pytest

from collalign.engine.store import Store
from data_tools.datasets.synthetic import write_collection
from tests.benchmarks import fault_test
from tests.commands import read_json
from tests.faults import run_with_kills, worker_processes
from tests.finished_runs import chairs


def test_a_command_that_fails_is_not_taken_for_a_survivor():
    with pytest.raises(RuntimeError, match="code 3"):
        run_with_kills(
            [sys.executable, "-c", "import sys; sys.exit(3)"],
            0,
            np.random.default_rng(0),
            delay_s=(1, 1),
        )


def test_processes_that_are_no_workers_are_not_listed():
    with subprocess.Popen(["sleep", "60"]) as process:
        parent = os.getpid()
        assert process.pid not in worker_processes(parent)
        assert worker_processes(process.pid) == []
        process.kill()


@pytest.mark.usefixtures("two_cores")
def test_a_whole_run_that_is_killed_and_interrupted_loses_nothing(tmp_path):
    options = argparse.Namespace(kills=1, signals=1, shapes=3, points=16, delay=(0.5, 2.0), seed=1)
    log = fault_test.compare(tmp_path, options)
    assert (log.kills, log.signals) == (1, 1)


@pytest.mark.parametrize("damage", ["original", "foreign", "record", "mesh", "staging"])
def test_every_loss_would_be_noticed(tmp_path, damage):
    shapes, out = tmp_path / "shapes", tmp_path / "out"
    shapes.mkdir()
    (shapes / "a.ply").write_text("a")
    watch = fault_test.Watch(shapes, out)
    with Store.open(out / "store.sqlite") as store:
        store.put("pairs", "k", {"x": 1.0})
    (out / "meshes" / "a.ply").write_text("a")
    (out / "alignment.json").write_text('{"shapes": [{"name": "a"}]}')
    (out / ".collalign").mkdir()
    for name in ("lock", "manifest.json"):
        (out / ".collalign" / name).touch()
    watch.check_end()
    if damage == "record":
        with Store.open(out / "store.sqlite") as store:
            store._connection.execute("DELETE FROM pairs")
    elif damage == "staging":
        (out / ".collalign" / "staging").mkdir()
    else:
        lost = {
            "original": shapes / "a.ply",
            "foreign": out / "notes.txt",
            "mesh": out / "meshes" / "a.ply",
        }
        lost[damage].unlink()
    with pytest.raises(RuntimeError):
        watch.check_end()


@pytest.mark.usefixtures("two_cores")
def test_shapes_that_are_added_survive_kills_and_move_nothing(tmp_path):
    old, new, out = tmp_path / "old", tmp_path / "new", tmp_path / "out"
    options = argparse.Namespace(points=16)
    write_collection(old, chairs(3))
    (tmp_path / "more").mkdir()
    write_collection(tmp_path / "more", chairs(5))
    new.mkdir()
    for name in ("chair4.ply", "chair5.ply"):
        (tmp_path / "more" / name).rename(new / name)
    rng, watch = np.random.default_rng(4), fault_test.Watch(new, out)
    run_with_kills(fault_test.command(old, out, options), 0, rng, delay_s=(1, 1))
    before = read_json(out / "alignment.json")["shapes"]
    command = [sys.executable, "-m", "collalign", "add", str(out), str(new), "--jobs", "2"]
    log = run_with_kills(
        command, 1, rng, delay_s=(0.5, 3.0), parent_share=0.7, resume_codes=(3,), check=watch.check
    )
    watch.check_end()
    after = read_json(out / "alignment.json")["shapes"]
    assert log.kills
    for one, now in zip(before, after, strict=False):
        # Points are numbered anew, so the sum over them may differ in its last bit.
        assert now.pop("centroid_size_points") == pytest.approx(
            one.pop("centroid_size_points"), rel=1e-12
        )
        assert now == one | {"evidence": now["evidence"]}
    assert [one["name"] for one in after[3:]] == ["chair4", "chair5"]
