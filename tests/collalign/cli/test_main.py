"""The command as a process: its streams, its messages and its exit codes, whatever the other end does."""

import os
import signal
import subprocess
import sys
import time

import pytest

from data_tools.datasets.synthetic import write_collection
from tests.commands import run_command
from tests.faults import worker_processes
from tests.finished_runs import chairs

COLLALIGN = [sys.executable, "-m", "collalign"]
FLAGS = ["--sampling.num-points", "16", "--sampling.num-dense-points", "0", "--jobs", "2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "chairs"
    write_collection(path, chairs(4))
    return path


def test_names_need_not_fit_the_encoding_of_the_terminal(tmp_path):
    (tmp_path / "Schädel").mkdir()
    command = [*COLLALIGN, "align", str(tmp_path / "Schädel"), "--out", str(tmp_path / "out")]
    done = subprocess.run(
        command,
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        timeout=600,
    )
    assert done.returncode == 2
    assert b"Sch\\xe4del: holds no shape file" in done.stderr


def test_options_of_status_and_variation_that_exclude_each_other_are_refused(tmp_path):
    said = run_command("status", tmp_path, "--cite", "--prune", ends=2)
    assert "--cite and --prune: one at a time" in said.err


@pytest.mark.usefixtures("two_cores")
@pytest.mark.parametrize(
    ("sent", "code"),
    [
        ([signal.SIGINT], 130),
        ([signal.SIGTERM], 143),
        ([signal.SIGHUP] * 3, 129),
    ],
)
def test_whatever_interrupts_a_run_it_says_what_is_kept_and_leaves_nothing_temporary(
    sent, code, folder, tmp_path, monkeypatch
):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    out = tmp_path / "out"
    command = [*COLLALIGN, "align", str(folder), "--out", str(out), *FLAGS]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)
    while not worker_processes(process.pid):
        assert process.poll() is None, "ended before its workers were seen"
        time.sleep(0.01)
    assert any((tmp_path / "tmp").iterdir())
    for number in sent:  # a terminal sends it to all processes in the foreground
        os.killpg(process.pid, number)
        time.sleep(0.02)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == code
    assert "Traceback" not in errors
    assert "Warning" not in errors
    assert errors.splitlines()[-1] == (
        f"collalign: interrupted; everything finished is kept in {out / 'store.sqlite'}; "
        "run the same command to go on"
    )
    assert not (out / "alignment.json").exists()
    assert [*(tmp_path / "tmp").iterdir()] == []
    run_command("status", out, ends=5)


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", "--out", "FILE"],
        ["align", "FOLDER", "--out", "FILE"],
        ["align", "FILE", "--out", "o"],
    ],
)
def test_a_file_in_the_place_of_a_folder_is_called_so(arguments, folder, tmp_path):
    places = {"FILE": tmp_path / "file", "FOLDER": folder, "o": tmp_path / "o"}
    places["FILE"].touch()
    said = run_command(*[str(places.get(word, word)) for word in arguments], ends=2).err
    assert str(places["FILE"]) in said
    assert "is a file, not a folder" in said or "not a directory" in said.lower()


def test_help_is_quick_and_imports_nothing_heavy():
    code = "import sys; from collalign.cli import main; main(['--help']); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "cyclopts" in loaded
    assert not loaded & {
        "numpy",
        "scipy",
        "trimesh",
        "matplotlib",
        "joblib",
        "potpourri3d",
        "networkx",
    }
