"""Records that many tasks need: written to a file once, read by every worker, and sent once to each Dask worker.

Records are read from the file and not mapped: pages of a map count as a worker's own memory, by its limit and by
joblib, which replaces workers that seem to grow.
"""

from __future__ import annotations

import os
import struct
from collections import OrderedDict
from collections.abc import Iterable
from io import FileIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from collalign.engine.store.records import Reader, Record, decode, encode, from_record
from data_tools.errors import StoreError

Made = TypeVar("Made")

#: Bytes that each worker keeps of decoded records and of what was made of them: those used last.
_MAX_KEPT_BYTES = 2**27
_FOOTER = struct.Struct("<QQ")


class SharedTable:
    """Records by key in one file, to be read; only records that are looked up are in memory.

    Build it with :meth:`create` in the parent, and use it as a context manager there, so that the file goes away.
    Travelling to a worker process costs a path; the worker opens the file when it first looks something up.

    Parameters
    ----------
    path : Path
        A file written by :meth:`create`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._owned: TemporaryDirectory[str] | None = None
        self._file: FileIO | None = None
        self._index: dict[str, list[int]] = {}
        self._kept_bytes = 0.0
        self._cache: OrderedDict[tuple[str, Reader[Any]], tuple[Any, float]] = OrderedDict()

    @classmethod
    def create(cls, records: Iterable[tuple[str, Record]]) -> SharedTable:
        """Write records, one at a time, into a new temporary file.

        Parameters
        ----------
        records : iterable of (key, record)
            Keys are unique strings; see :mod:`collalign.engine.store.records` for what a record holds.
        """
        owned = TemporaryDirectory(prefix="collalign-", ignore_cleanup_errors=True)
        table = cls(Path(owned.name) / "records.table")
        table._owned = owned
        index: dict[str, list[int]] = {}
        try:
            with table.path.open("wb") as file:
                for key, record in records:
                    data = encode(record)
                    index[key] = [file.tell(), len(data)]
                    file.write(data)
                footer = encode({"index": index})
                start = file.tell()
                file.write(footer + _FOOTER.pack(start, len(footer)))
        except BaseException:
            table.close()
            raise
        return table

    def made(self, key: str, reader: Reader[Made], *, growth: float = 1.0) -> Made:
        """Return what is made of a record; what was made of the ones used last is kept.

        Parameters
        ----------
        key : str
        reader : type or callable
            See :func:`collalign.engine.store.records.from_record`, and of a module. Several tasks get the same
            object, which none of them may change.
        growth : float
            About how many times the record's bytes that object takes.
        """
        if (key, reader) in self._cache:
            self._cache.move_to_end((key, reader))
        else:
            file = self._open()
            start, size = self._index[key]
            made = from_record(reader, decode(_part(file, start, size), f"{self.path}: {key}"), key)
            self._cache[key, reader] = made, growth * size
            self._kept_bytes += growth * size
            while self._kept_bytes > _MAX_KEPT_BYTES and len(self._cache) > 1:
                _, (_, dropped) = self._cache.popitem(last=False)
                self._kept_bytes -= dropped
        found: Made = self._cache[key, reader][0]
        return found

    def close(self) -> None:
        """Close the file, and remove it where this is the table that :meth:`create` returned."""
        if self._file is not None:
            self._file.close()
            self._file = None
        if self._owned is not None:
            self._owned.cleanup()

    def __enter__(self) -> SharedTable:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _opened, (str(self.path),)

    def _open(self) -> FileIO:
        if self._file is None:
            self._file = FileIO(str(self.path))
            end = self._file.seek(0, os.SEEK_END)
            start, size = _FOOTER.unpack(_part(self._file, end - _FOOTER.size, _FOOTER.size))
            index = decode(_part(self._file, start, size), str(self.path))["index"]
            if not isinstance(index, dict):
                raise StoreError(f"{self.path}: not a table")
            self._index = index
        return self._file


def _part(file: FileIO, start: int, size: int) -> bytes:
    """Return so many bytes of a file from a place on; fewer where it is truncated."""
    file.seek(start)
    return file.read(size)


_TABLES: dict[str, SharedTable] = {}


def _opened(path: str) -> SharedTable:
    """Return this process's table of a path; each task that arrives carries the path again."""
    if path not in _TABLES:
        for stale in _TABLES.values():
            stale.close()
        _TABLES.clear()
        _TABLES[path] = SharedTable(Path(path))
    return _TABLES[path]
