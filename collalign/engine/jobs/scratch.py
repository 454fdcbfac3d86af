"""Temporary files of a run, named after its process, so that the next run removes what a killed one left."""

from __future__ import annotations

import os
import re
import shutil
import socket
import tempfile
from contextlib import suppress
from pathlib import Path

_PREFIX = f"collalign-{re.sub(r'[^A-Za-z0-9]', '_', socket.gethostname())}-"


def scratch_directory(directory: Path | None = None) -> Path:
    """Make a directory for one run, and remove those of runs on this machine that are gone.

    Parameters
    ----------
    directory : Path, optional
        Where; the system's place for temporary files by default.
    """
    parent = Path(tempfile.gettempdir()) if directory is None else directory
    _remove_left_behind(parent)
    return Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-", dir=parent))


def is_running(pid: int) -> bool:
    """Whether there is a process of that number on this machine."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _remove_left_behind(parent: Path) -> None:
    """Remove our own directories there whose process has ended."""
    for entry in parent.glob(f"{_PREFIX}*"):
        found = re.match(r"(\d+)-", entry.name.removeprefix(_PREFIX))
        with suppress(OSError):
            if found and not is_running(int(found.group(1))) and entry.lstat().st_uid == os.getuid():
                shutil.rmtree(entry, ignore_errors=True)
