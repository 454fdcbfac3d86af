"""Records that many tasks need: written to a file once, mapped by every worker, and sent once to each Dask worker."""

from __future__ import annotations

import mmap
import struct
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from collalign.engine.jobs.scratch import remove_scratch, scratch_directory
from collalign.engine.store.records import Record, decode, encode
from data_tools.errors import StoreError

#: Decoded records that each worker keeps.
_CACHE_SIZE = 256
_FOOTER = struct.Struct("<QQ")


class SharedTable(Mapping[str, Record]):
    """A read-only mapping of keys to records in one file; only records that are looked up are in memory.

    Build it with :meth:`create` in the parent, and use it as a context manager there, so that the file goes away.
    Travelling to a worker process costs a path; the worker maps the file when it first looks something up.

    Parameters
    ----------
    path : Path
        A file written by :meth:`create`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._owned: Path | None = None
        self._map: mmap.mmap | None = None
        self._index: dict[str, list[int]] = {}
        self._cache: OrderedDict[str, Record] = OrderedDict()

    @classmethod
    def create(cls, records: Iterable[tuple[str, Record]], *, directory: Path | None = None) -> SharedTable:
        """Write records, one at a time, into a new temporary file.

        Parameters
        ----------
        records : iterable of (key, record)
            Keys are unique strings; see :mod:`collalign.engine.store.records` for what a record holds.
        directory : Path, optional
            Where it goes, in a directory of its own; the system's place for temporary files by default.
        """
        path = scratch_directory(directory) / "records.table"
        index: dict[str, list[int]] = {}
        try:
            with path.open("wb") as file:
                for key, record in records:
                    data = encode(record)
                    index[key] = [file.tell(), len(data)]
                    file.write(data)
                footer = encode({"index": index})
                start = file.tell()
                file.write(footer + _FOOTER.pack(start, len(footer)))
        except BaseException:
            remove_scratch(path.parent)
            raise
        table = cls(path)
        table._owned = path.parent
        return table

    def __getitem__(self, key: str) -> Record:
        """Return a record with read-only arrays; the ones used last are kept decoded."""
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        data = self._open()
        start, size = self._index[key]
        record = decode(data[start : start + size], f"{self.path}: {key}")
        self._cache[key] = record
        if len(self._cache) > _CACHE_SIZE:
            self._cache.popitem(last=False)
        return record

    def __iter__(self) -> Iterator[str]:
        self._open()
        return iter(self._index)

    def __len__(self) -> int:
        self._open()
        return len(self._index)

    def close(self) -> None:
        """Unmap the file, and remove it where this is the table that :meth:`create` returned."""
        if self._map is not None:
            self._map.close()
            self._map = None
        if self._owned is not None:
            remove_scratch(self._owned)

    def __enter__(self) -> SharedTable:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _opened, (str(self.path),)

    def _open(self) -> mmap.mmap:
        if self._map is None:
            with open(self.path, "rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            start, size = _FOOTER.unpack(self._map[-_FOOTER.size :])
            index = decode(self._map[start : start + size], str(self.path))["index"]
            if not isinstance(index, dict):
                raise StoreError(f"{self.path}: not a table")
            self._index = index
        return self._map


_TABLES: dict[str, SharedTable] = {}


def _opened(path: str) -> SharedTable:
    """Return this process's table of a path; each task that arrives carries the path again."""
    if path not in _TABLES:
        _TABLES.clear()
        _TABLES[path] = SharedTable(Path(path))
    return _TABLES[path]
