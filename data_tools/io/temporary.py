"""Folders of temporary files: they go with whoever asked for them, or with the process, or with the next one."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from data_tools.io.locks import PRIVATE, LockFile, take_lock

_PREFIX = "collalign-"
#: A file in each folder: its name says that the folder is one of these, and its lock that somebody lives there.
_MARK = ".collalign-temporary"
#: Where the files are, so that all of them can go before the mark.
_FILES = "files"
#: Errors of file systems that know no locks: what lies there is never taken for left.
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)


class TemporaryFolder:
    """A new folder that only its user can look into; use it in a ``with`` block, or call :meth:`close`.

    Otherwise it goes with the object, at the latest at the end of the process. What a process that was killed has
    left goes when the next one makes a folder: the system frees locks however their holder ends.

    Attributes
    ----------
    path : Path
    """

    def __init__(self) -> None:
        place = tempfile.gettempdir()
        remove_left(place)
        while True:
            folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=place))
            self.path = folder / _FILES
            try:
                self.path.mkdir(0o700)
                lock = _marked(folder)
                break
            except (BlockingIOError, FileNotFoundError):
                continue  # another process took it for one that was left, before it had its lock
            except BaseException:
                _remove_all(folder)
                raise
        self._finalize = weakref.finalize(self, _remove, folder, lock, os.getpid())

    def close(self) -> None:
        """Remove the folder; closing twice does nothing."""
        self._finalize()

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *exception: object) -> None:
        self.close()


@cache
def remove_left(place: str) -> None:
    """Remove the folders of one's own processes that were killed, once a process.

    Parameters
    ----------
    place : str
        The folder of all temporary files. Nothing in it is touched that has not the mark of these folders, belongs
        to another user, or is locked.
    """
    for folder in Path(place).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if not _is_own(folder.lstat(), stat.S_ISDIR):
                continue
            descriptor = os.open(folder / _MARK, os.O_RDWR | PRIVATE)
            try:
                take_lock(descriptor)
                if _is_own(os.fstat(descriptor), stat.S_ISREG):
                    _remove_all(folder)
            finally:
                os.close(descriptor)


def _is_own(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    return is_kind(found.st_mode) and (not hasattr(os, "geteuid") or found.st_uid == os.geteuid())


def _marked(folder: Path) -> LockFile | None:
    """Put the locked mark into a folder; without its lock where the file system knows none."""
    try:
        return LockFile.take(folder / _MARK)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        return None


def _remove(folder: Path, lock: LockFile | None, pid: int) -> None:
    if os.getpid() != pid:
        return  # a child that was forked: the folder is its parent's
    if lock is not None:
        os.close(lock.descriptor)  # Windows removes no open file
    try:
        _remove_all(folder)
    except KeyboardInterrupt:
        _remove_all(folder)
        raise


def _remove_all(folder: Path) -> None:
    """Remove a folder, its mark last; one descriptor is enough, as the process may have no more (``ulimit -n``)."""
    for place in (folder / _FILES, folder):
        for root, folders, files in os.walk(place, topdown=False):
            for name in files:
                with suppress(OSError):
                    os.unlink(os.path.join(root, name))
            for name in folders:
                with suppress(OSError):
                    os.rmdir(os.path.join(root, name))
    with suppress(OSError):
        os.rmdir(folder)
