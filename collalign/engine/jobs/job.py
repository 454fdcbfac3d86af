"""What a stage hands the engine: a job and what it is wanted on; and how workers come by what many tasks share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, Generic, TypeVar

from collalign.engine.jobs.shared_table import SharedTable
from collalign.engine.store.records import Reader, fields_of, from_record, to_record
from collalign.engine.store.store import Store, fingerprint

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
        What is made of the record, see :func:`collalign.engine.store.records.from_record`; several tasks get the same
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
        One of :data:`collalign.engine.store.file.KINDS`: what its results are.
    version : str
        Changes whenever the same settings and contents would give another result.
    run : callable
        Of a module, so that workers can import it; called with the arguments of a :class:`Wanted`, it must depend on
        nothing else. Returns a frozen dataclass or a record.
    reader : type or callable
        What its records are when they are read, see :func:`collalign.engine.store.records.from_record`.
    """

    kind: str
    version: str
    run: Callable[..., Any]
    reader: Reader[T]

    def key(self, settings: Any, *contents: str) -> str:
        """Return the key of a result, see :func:`collalign.engine.store.store.fingerprint`."""
        return fingerprint(self.version, settings, *contents)

    def shared(self, key: str, reader: Reader[Any] | None = None) -> Shared:
        """Return what stands for a result of this job among the arguments of another one."""
        return Shared(key=key, reader=reader or self.reader, kind=self.kind)


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

    def shared(self, name: K, reader: Reader[Any] | None = None) -> Shared:
        """Return what stands for a result among the arguments of another job."""
        return self._job.shared(self._wanted[name].key, reader)


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
