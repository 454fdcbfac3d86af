"""Locks of files that the system frees however their holder ends, and how files are opened that no child inherits."""

from __future__ import annotations

import os
import sys

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

#: For ``os.open``: no child inherits the file, no link is followed, bytes come as they are; each system has some.
PRIVATE = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
#: The byte that stands for a file on Windows, where others cannot read what is locked: far behind any content.
_LOCKED_BYTE = 2**30


def take_lock(descriptor: int) -> None:
    """Lock an open file at once or refuse; closing it frees the lock.

    Raises
    ------
    BlockingIOError
        If another process holds the lock.
    OSError
        If the file system knows no locks.
    """
    if sys.platform == "win32":
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from None
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
