"""A lock is held by one process at a time and freed with the file."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from data_tools.io.locks import PRIVATE, take_lock


def opened(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | PRIVATE, 0o600)


def test_a_held_lock_is_refused_until_its_file_is_closed(tmp_path: Path) -> None:
    first, second = opened(tmp_path / "lock"), opened(tmp_path / "lock")
    take_lock(first)
    with pytest.raises(BlockingIOError):
        take_lock(second)
    os.close(first)
    take_lock(second)
    os.close(second)


def test_no_child_keeps_a_lock(tmp_path: Path) -> None:
    held = opened(tmp_path / "lock")
    take_lock(held)
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, close_fds=False)
    os.close(held)
    other = opened(tmp_path / "lock")
    take_lock(other)
    os.close(other)
    child.communicate(b"\n")


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="this system follows links")
def test_links_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="lock"):
        opened(tmp_path / "lock")
