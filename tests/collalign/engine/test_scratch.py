import os
import subprocess
import sys
from pathlib import Path

from collalign.engine.jobs.scratch import remove_scratch, scratch_directory


def left_by_a_killed_run(parent: Path) -> Path:
    script = (
        "import os, pathlib, sys; from collalign.engine.jobs.scratch import scratch_directory\n"
        "path = scratch_directory(pathlib.Path(sys.argv[1])); (path / 'ledger').write_text('x'); print(path)\n"
        "sys.stdout.flush(); os._exit(9)"
    )
    ended = subprocess.run([sys.executable, "-c", script, str(parent)], check=False, capture_output=True, text=True)
    return Path(ended.stdout.strip())


def test_what_a_killed_run_left_is_removed_by_the_next(tmp_path: Path) -> None:
    left = left_by_a_killed_run(tmp_path)
    assert (left / "ledger").exists()
    others = [tmp_path / "collalign-another_host-1-abc", tmp_path / f"{left.name.rsplit('-', 1)[0]}-notes"]
    for other in others:
        other.mkdir()
    mine = [scratch_directory(tmp_path), scratch_directory(tmp_path)]
    assert set(tmp_path.iterdir()) == {*others, *mine}
    for path in mine:
        remove_scratch(path)
    assert set(tmp_path.iterdir()) == set(others)


def test_a_run_whose_process_number_means_nothing_here_keeps_its_directory(tmp_path: Path) -> None:
    script = (
        "import pathlib, sys; from collalign.engine.jobs.scratch import scratch_directory\n"
        "print(scratch_directory(pathlib.Path(sys.argv[1])), flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        theirs = Path(other.stdout.readline().strip())
        # In another container its number may be nobody's here: the name must not decide.
        assert str(other.pid) not in theirs.name.split("-")
        mine = scratch_directory(tmp_path)
        assert theirs.is_dir()
        other.communicate("")
    remove_scratch(mine)
    scratch_directory(tmp_path)
    assert not theirs.exists()


def test_links_are_not_followed(tmp_path: Path) -> None:
    target = tmp_path / "precious"
    target.mkdir()
    for name in ("file", "lock"):
        (target / name).touch()
    parent = tmp_path / "temporary"
    parent.mkdir()
    prefix = scratch_directory(parent).name.rsplit("-", 1)[0]
    (parent / f"{prefix}-x").symlink_to(target)
    scratch_directory(parent)
    assert (target / "file").exists()


def test_locks_are_freed(tmp_path: Path) -> None:
    num_before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        remove_scratch(scratch_directory(tmp_path))
    assert len(os.listdir("/proc/self/fd")) == num_before
    assert not list(tmp_path.iterdir())
