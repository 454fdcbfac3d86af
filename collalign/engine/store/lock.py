"""One writer per store: an advisory lock on a file beside it, which the system frees however the writer ends."""

from __future__ import annotations

import os
from pathlib import Path

from data_tools.errors import StoreError
from data_tools.io.locks import PRIVATE, take_lock


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
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | PRIVATE, 0o644)
        except OSError as error:
            raise StoreError(f"{path}: cannot be opened ({error.strerror})") from None
        try:
            take_lock(descriptor)
        except OSError:
            owner = _content(descriptor).decode("ascii", "replace").strip()
            os.close(descriptor)
            raise StoreError(
                f"{store_path}: another run (process {owner or 'unknown'}) is writing to this store; wait for it, "
                "or name another store"
            ) from None
        content = _content(descriptor)
        if content.strip() and not content.strip().isdigit():
            os.close(descriptor)
            raise StoreError(f"{path}: is no lock of a store but a file of somebody else; name another store")
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, str(os.getpid()).encode())
        return cls(descriptor)

    def release(self) -> None:
        """Free the lock; the empty file stays, since removing it would race with the next run."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def _content(descriptor: int) -> bytes:
    """Return the start of the file: a process number has fewer digits."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    return os.read(descriptor, 21)
