"""Locks of files that the system frees however their holder ends, and how files are opened that no child inherits."""

from __future__ import annotations

import errno
import os
import stat
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

#: For ``os.open``: no child inherits the file, no link is followed, bytes come as they are; each system has some.
PRIVATE = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
#: The byte that stands for a file on Windows, where others cannot read what is locked: far behind any content.
_LOCKED_BYTE = 2**30


@dataclass(frozen=True, kw_only=True)
class LockFile:
    """A locked file; get it with :meth:`take`, and end it with :meth:`release`.

    Attributes
    ----------
    path : Path
    descriptor : int
    made : bool
        Whether there was no such file before.
    """

    path: Path
    descriptor: int
    made: bool

    @classmethod
    def take(cls, path: Path) -> LockFile:
        """Lock a file at once or refuse; it is made if it does not exist.

        A file that its former holder removed meanwhile is not the one of that name any more, and locks nobody out.

        Raises
        ------
        OSError
            As :func:`take_lock`; if it cannot be opened or is no regular file: a pipe or a device is not opened.
        """
        while True:
            made = not os.path.lexists(path)
            flags = (
                os.O_RDWR
                | PRIVATE
                | (os.O_CREAT | os.O_EXCL if made else getattr(os, "O_NONBLOCK", 0))
            )
            try:
                if not made and not stat.S_ISREG(path.lstat().st_mode):
                    raise OSError(errno.EINVAL, "it is no regular file")
                descriptor = os.open(path, flags, 0o644)
            except (FileExistsError, FileNotFoundError) as error:
                if made == isinstance(error, FileExistsError):
                    continue  # another run made or removed it just now
                raise
            try:
                take_lock(descriptor)
                with suppress(FileNotFoundError):
                    if os.path.samestat(os.fstat(descriptor), path.lstat()):
                        return cls(path=path, descriptor=descriptor, made=made)
            except BaseException:
                os.close(descriptor)
                raise
            os.close(descriptor)

    def release(self) -> None:
        """Free the lock, and remove the file if it was made here."""
        if self.made:
            with suppress(OSError):  # Windows removes no open file
                self.path.unlink()
        os.close(self.descriptor)


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
