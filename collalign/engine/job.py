"""What a stage hands the engine: a job and what it is wanted on; and how workers come by what many tasks share.

What many tasks share is written to a file once, read by every worker, and sent once to each Dask worker. It is read
from the file and not mapped: pages of a map count as a worker's own memory, by its limit and by joblib, which
replaces workers that seem to grow.
"""

from __future__ import annotations

import os
import struct
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from io import FileIO
from pathlib import Path
from typing import Any, Generic, TypeVar

from collalign.engine.records import (
    Reader,
    Record,
    decode,
    encode,
    fields_of,
    from_record,
    to_record,
)
from collalign.engine.store import Store, fingerprint
from data_tools.errors import StoreError
from data_tools.io.temporary import TemporaryFolder

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
        self._owned: TemporaryFolder | None = None
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
            Keys are unique strings; see :mod:`collalign.engine.records` for what a record holds.
        """
        owned = TemporaryFolder()
        table = cls(owned.path / "records.table")
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
            See :func:`collalign.engine.records.from_record`, and of a module. Several tasks get the same
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
            self._owned.close()

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


T = TypeVar("T")
K = TypeVar("K")


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Stands for an argument of a task that is read from the table which all tasks of a run share.

    Attributes
    ----------
    key : str
        Of its record in the table.
    reader : type or callable
        What is made of the record, see :func:`collalign.engine.records.from_record`; several tasks get the same
        object, which none of them may change.
    kind : str
        Of the store's records that it is one of; empty for a table that the caller has made.
    growth : float
        About how many times the record's bytes the object takes.
    """

    key: str
    reader: Reader[Any]
    kind: str = ""
    growth: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Job(Generic[T]):
    """A function whose results the store keeps.

    Attributes
    ----------
    kind : str
        One of :data:`collalign.engine.store_file.KINDS`: what its results are.
    version : str
        Changes whenever the same settings and contents would give another result.
    run : callable
        Of a module, so that workers can import it; called with the arguments of a :class:`Wanted`, it must depend on
        nothing else. Returns a frozen dataclass or a record.
    reader : type or callable
        What its records are when they are read, see :func:`collalign.engine.records.from_record`.
    """

    kind: str
    version: str
    run: Callable[..., Any]
    reader: Reader[T]

    def key(self, settings: Any, *contents: str) -> str:
        """Return the key of a result, see :func:`collalign.engine.store.fingerprint`."""
        return fingerprint(self.version, settings, *contents)

    def shared(self, key: str) -> Shared:
        """Return what stands for a result of this job among the arguments of another one."""
        return Shared(key=key, reader=self.reader, kind=self.kind)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A result that a run wants.

    Attributes
    ----------
    key : str
        From :meth:`Job.key`; results of the same key are computed once.
    label : str
        What it is, for people.
    arguments : dict
        By name, for the job's function. They travel to a worker: what is large or common to many tasks is a
        :class:`Shared`, also within tuples.
    """

    key: str
    label: str
    arguments: Mapping[str, Any]


class Results(Mapping[K, T]):
    """The results of a job by what they were wanted for, in that order; each is read and checked when looked up.

    Attributes
    ----------
    failures : dict
        Why there is no result of the others.
    """

    def __init__(
        self, store: Store, job: Job[T], wanted: Mapping[K, Wanted], failures: dict[K, str]
    ) -> None:
        self._store, self._job, self._wanted = store, job, wanted
        self.failures = failures

    def __getitem__(self, name: K) -> T:
        if name in self.failures:
            raise KeyError(name)
        one = self._wanted[name]
        return from_record(
            self._job.reader, self._store.require(self._job.kind, one.key), one.label
        )

    def __contains__(self, name: object) -> bool:
        return name in self._wanted and name not in self.failures

    def __iter__(self) -> Iterator[K]:
        return (name for name in self._wanted if name not in self.failures)

    def __len__(self) -> int:
        return len(self._wanted) - len(self.failures)

    def shared(self, name: K) -> Shared:
        """Return what stands for a result among the arguments of another job."""
        return self._job.shared(self._wanted[name].key)


def run_task(
    run: Callable[..., Any],
    is_kept: bool,
    arguments: Mapping[str, Any],
    table: SharedTable | None = None,
) -> Any:
    """Call a function with the arguments of one task, inside a worker; a result that the store keeps is a record."""
    value = run(**{name: _looked_up(argument, table) for name, argument in arguments.items()})
    return to_record(value) if is_kept and is_dataclass(value) else value


def _looked_up(argument: Any, table: SharedTable | None) -> Any:
    if isinstance(argument, tuple):
        return tuple(_looked_up(item, table) for item in argument)
    if not isinstance(argument, Shared):
        return argument
    assert table is not None
    return table.made(argument.key, argument.reader, growth=argument.growth)


def table_of_values(values: Iterable[Any]) -> SharedTable:
    """Return a table of dataclasses, by position as text; use it in a ``with`` block."""
    return SharedTable.create((str(i), to_record(value)) for i, value in enumerate(values))


def table_of_stored(store: Store, tasks: Iterable[Mapping[str, Any]]) -> SharedTable | None:
    """Return a table of the stored records that tasks share, without the fields that nobody reads; None for none."""
    wanted: dict[tuple[str, str], frozenset[str] | None] = {}
    for one in _shared_by(tasks):
        place, fields = (one.kind, one.key), fields_of(one.reader)
        former = wanted.get(place, frozenset())
        wanted[place] = None if fields is None or former is None else fields | former

    def read(kind: str, key: str, names: frozenset[str] | None) -> dict[str, Any]:
        record = store.require(kind, key)
        return {name: value for name, value in record.items() if names is None or name in names}

    records = ((key, read(kind, key, wanted[kind, key])) for kind, key in sorted(wanted))
    return SharedTable.create(records) if wanted else None


def _shared_by(tasks: Iterable[Mapping[str, Any]]) -> Iterator[Shared]:
    for arguments in tasks:
        for argument in arguments.values():
            for item in argument if isinstance(argument, tuple) else (argument,):
                if isinstance(item, Shared) and item.kind:
                    yield item
