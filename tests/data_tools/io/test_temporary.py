"""Temporary folders go with whoever made them; what a killed process left goes with the next."""

import errno
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from data_tools.io import temporary
from data_tools.io.temporary import TemporaryFolder, remove_left

MAKE = (
    "import time; from data_tools.io.temporary import TemporaryFolder; folder = TemporaryFolder()\n"
    "(folder.path / 'a').mkdir(); (folder.path / 'a' / 'b').touch(); print(folder.path, flush=True)\n"
)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty folder of temporary files, for this process and those that it starts."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def killed():
    """Let a process make a folder, kill it, and return the folder."""
    with subprocess.Popen(
        [sys.executable, "-c", f"{MAKE}time.sleep(600)"], stdout=subprocess.PIPE, text=True
    ) as process:
        left = Path(process.stdout.readline().strip()).parent
        process.send_signal(signal.SIGKILL)
    return left


def test_a_folder_is_its_users_alone_and_goes_with_its_block(place):
    with TemporaryFolder() as folder:
        for one in (folder, folder.parent):
            assert stat.S_IMODE(one.stat().st_mode) == 0o700
        (folder / "a").touch()
    assert [*place.iterdir()] == []


def test_what_a_killed_process_left_goes_with_the_next(place):
    left = killed()
    assert (left / "files" / "a" / "b").exists()
    remove_left.cache_clear()
    with TemporaryFolder():
        assert not left.exists()


def test_folders_that_somebody_lives_in_or_that_are_none_of_ours_stay(place, monkeypatch):
    with TemporaryFolder() as alive:
        left = killed()
        (place / "collalign-demo").mkdir()  # of a user, called like a temporary one
        (place / "collalign-demo" / "report.html").touch()
        (place / "collalign-link").symlink_to(left)
        remove_left.cache_clear()
        with monkeypatch.context() as patch:
            patch.setattr("os.geteuid", lambda: left.stat().st_uid + 1)
            remove_left(str(place))
        assert left.exists()
        remove_left.cache_clear()
        remove_left(str(place))
        assert alive.exists()
    assert {one.name for one in place.iterdir()} == {"collalign-demo", "collalign-link"}
    assert (place / "collalign-demo" / "report.html").exists()


def test_a_folder_that_was_taken_for_left_before_its_lock_is_made_again(place, monkeypatch):
    take, taken = temporary.LockFile.take, []

    def too_late(path):
        taken.append(path)
        if len(taken) == 1:
            path.touch()
            remove_left.cache_clear()
            remove_left(str(place))
        return take(path)

    monkeypatch.setattr(temporary.LockFile, "take", too_late)
    with TemporaryFolder() as folder:
        assert folder.exists()
        assert len(taken) == 2
    assert [*place.iterdir()] == []


def test_without_locks_folders_are_made_and_none_is_taken_for_left(place, monkeypatch):
    left = killed()

    def refuse(_):
        raise OSError(errno.ENOLCK, "no locks")

    monkeypatch.setattr("data_tools.io.locks.take_lock", refuse)
    monkeypatch.setattr(temporary, "take_lock", refuse)
    remove_left.cache_clear()
    with TemporaryFolder() as folder:
        (folder / "a").touch()
    assert [*place.iterdir()] == [left]


def test_no_folder_stays_where_one_cannot_be_marked(place, monkeypatch):
    def refuse(_):
        raise OSError(errno.EMFILE, "too many open files")

    monkeypatch.setattr("data_tools.io.locks.take_lock", refuse)
    with pytest.raises(OSError, match="too many"):
        TemporaryFolder()
    assert [*place.iterdir()] == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_child_leaves_the_folder_to_its_parent(place):
    code = (
        f"import os, sys\n{MAKE}"
        "if os.fork() == 0: sys.exit()\n"
        "os.wait(); print(folder.path.exists())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "True"
    assert [*place.iterdir()] == []
