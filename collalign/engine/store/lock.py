"""One writer per store: an advisory lock on a file beside it, which the system frees however the writer ends."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from data_tools.errors import StoreError
from data_tools.io.locks import LockFile

#: No process number has more digits.
_MAX_DIGITS = len(str(sys.maxsize))


class StoreLock:
    """Holds the lock of a store until released or the process is gone; get it with :meth:`acquire`."""

    def __init__(self, lock: LockFile) -> None:
        self._lock: LockFile | None = lock

    @classmethod
    def acquire(cls, store_path: Path) -> StoreLock:
        """Take the lock at once or refuse.

        Raises
        ------
        StoreError
            If another process holds it, or the file beside the store cannot be made.
        """
        path = store_path.with_name(store_path.name + ".lock")
        try:
            lock = LockFile.take(path)
        except BlockingIOError:
            owner = path.read_bytes()[:_MAX_DIGITS].decode("ascii", "replace").strip() if path.is_file() else ""
            raise StoreError(
                f"{store_path}: another run (process {owner or 'unknown'}) is writing to this store; wait for it, "
                "or name another store"
            ) from None
        except OSError as error:
            raise StoreError(f"{path}: cannot be opened and locked ({error.strerror})") from None
        content = os.read(lock.descriptor, _MAX_DIGITS).strip()
        if content and not content.isdigit():
            lock.release()
            raise StoreError(f"{path}: is no lock of a store but a file of somebody else; name another store")
        os.ftruncate(lock.descriptor, 0)
        os.lseek(lock.descriptor, 0, os.SEEK_SET)
        os.write(lock.descriptor, str(os.getpid()).encode())
        return cls(lock)

    def release(self) -> None:
        """Free the lock; a second time it does nothing."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None
