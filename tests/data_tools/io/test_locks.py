"""A lock is held by one process at a time and freed with the file."""

import os

import pytest

from data_tools.io.locks import PRIVATE, LockFile, take_lock


def opened(path):
    return os.open(path, os.O_RDWR | os.O_CREAT | PRIVATE, 0o600)


def test_a_held_lock_is_refused_until_its_file_is_closed(tmp_path):
    first, second = opened(tmp_path / "lock"), opened(tmp_path / "lock")
    take_lock(first)
    with pytest.raises(BlockingIOError):
        take_lock(second)
    os.close(first)
    take_lock(second)
    os.close(second)


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="this system follows links")
def test_links_are_not_followed(tmp_path):
    (tmp_path / "lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="lock"):
        opened(tmp_path / "lock")


def test_only_a_lock_that_was_made_here_is_removed(tmp_path):
    path = tmp_path / "lock"
    lock = LockFile.take(path)
    with pytest.raises(BlockingIOError):
        LockFile.take(path)
    assert path.exists()
    lock.release()
    assert not path.exists()
    path.touch()
    LockFile.take(path).release()
    assert path.exists()


def test_a_lock_that_was_removed_before_it_was_held_is_taken_anew(tmp_path, monkeypatch):
    path = tmp_path / "lock"
    former = LockFile.take(path)
    waits = [former]

    def released_first(descriptor):
        if waits:
            waits.pop().release()
        take_lock(descriptor)

    monkeypatch.setattr("data_tools.io.locks.take_lock", released_first)
    lock = LockFile.take(path)
    assert os.path.samestat(os.fstat(lock.descriptor), path.stat())
    with pytest.raises(BlockingIOError):
        LockFile.take(path)
    lock.release()
