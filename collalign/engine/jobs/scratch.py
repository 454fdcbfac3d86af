"""Temporary files of a run, locked while it lives, so that the next run removes what a killed one left."""

from __future__ import annotations

import os
import re
import shutil
import socket
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from data_tools.io.locks import PRIVATE, take_lock

_PREFIX = f"collalign-{re.sub(r'[^A-Za-z0-9]', '_', socket.gethostname())}-"
_LOCK = "lock"
#: Descriptors of the locks that this process holds; the system frees them however it ends.
_HELD: dict[Path, int] = {}


def scratch_directory(directory: Path | None = None) -> Path:
    """Make a directory for one run, and remove those of runs that are gone.

    Whether a run is gone is told by its lock, not by its process number: containers that share a directory number
    their processes each on their own.

    Parameters
    ----------
    directory : Path, optional
        Where; the system's place for temporary files by default.
    """
    parent = Path(tempfile.gettempdir()) if directory is None else directory
    _remove_left_behind(parent)
    made = Path(tempfile.mkdtemp(prefix=".collalign-new-", dir=parent))
    path = parent / f"{_PREFIX}{made.name.removeprefix('.collalign-new-')}"
    if sys.platform == "win32":  # no folder with an open file can be renamed
        made = made.rename(path)
    descriptor = os.open(made / _LOCK, os.O_RDWR | os.O_CREAT | PRIVATE, 0o600)
    take_lock(descriptor)
    if made != path:
        made.rename(path)  # only now can others see it, and it is locked
    _HELD[path] = descriptor
    return path


def remove_scratch(path: Path) -> None:
    """Remove a directory that :func:`scratch_directory` made, and free its lock."""
    descriptor = _HELD.pop(path, None)
    if descriptor is not None:
        os.close(descriptor)
    shutil.rmtree(path, ignore_errors=True)


def _remove_left_behind(parent: Path) -> None:
    """Remove our own directories there whose lock nobody holds."""
    for entry in parent.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if entry.is_symlink() or not _is_ours(entry):
                continue
            descriptor = os.open(entry / _LOCK, os.O_RDWR | PRIVATE)
            try:
                take_lock(descriptor)
                shutil.rmtree(entry, ignore_errors=True)
            finally:
                os.close(descriptor)


def _is_ours(entry: Path) -> bool:
    """Whether it belongs to the user of this process; a Windows user's temporary folder is its own."""
    return not hasattr(os, "getuid") or entry.lstat().st_uid == os.getuid()
