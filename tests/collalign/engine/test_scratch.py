from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from collalign.engine.jobs.scratch import is_running, scratch_directory


def test_what_a_killed_run_left_is_removed_by_the_next(tmp_path: Path) -> None:
    script = (
        "import os, pathlib, sys; from collalign.engine.jobs.scratch import scratch_directory\n"
        "path = scratch_directory(pathlib.Path(sys.argv[1])); (path / 'ledger').write_text('x'); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=False)
    (left,) = tmp_path.iterdir()
    others = [tmp_path / "collalign-another_host-1-abc", tmp_path / f"{left.name.rsplit('-', 2)[0]}-notes"]
    for other in others:
        other.mkdir()
    mine = [scratch_directory(tmp_path), scratch_directory(tmp_path)]
    assert set(tmp_path.iterdir()) == {*others, *mine}


def test_links_are_not_followed(tmp_path: Path) -> None:
    target = tmp_path / "precious"
    target.mkdir()
    (target / "file").touch()
    parent = tmp_path / "temporary"
    parent.mkdir()
    prefix = scratch_directory(parent).name.rsplit("-", 2)[0]
    with subprocess.Popen(["true"]) as process:
        process.wait()
    (parent / f"{prefix}-{process.pid}-x").symlink_to(target)
    scratch_directory(parent)
    assert (target / "file").exists()


def test_running_processes_are_known() -> None:
    with subprocess.Popen(["true"]) as process:
        process.wait()
    assert not is_running(process.pid)
    assert is_running(os.getpid())
    assert is_running(1)
