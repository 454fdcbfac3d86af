"""One writer per store: an advisory lock on a file beside it, which the system frees however the writer ends."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from data_tools.errors import StoreError


class StoreLock:
    """Holds the lock of a store until released or the process is gone; get it with :meth:`acquire`."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

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
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        except OSError as error:
            raise StoreError(f"{path}: cannot be opened ({error.strerror})") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            owner = os.pread(descriptor, 20, 0).decode("ascii", "replace").strip()
            os.close(descriptor)
            raise StoreError(
                f"{store_path}: another run (process {owner or 'unknown'}) is writing to this store; wait for it, "
                "or name another store"
            ) from None
        content = os.pread(descriptor, 21, 0)
        if content.strip() and not content.strip().isdigit():
            os.close(descriptor)
            raise StoreError(f"{path}: is no lock of a store but a file of somebody else; name another store")
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        return cls(descriptor)

    def release(self) -> None:
        """Free the lock; the empty file stays, since removing it would race with the next run."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
