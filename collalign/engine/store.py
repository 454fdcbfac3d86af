"""The store: one SQLite file in which every finished shape and pair survives whatever ends the run.

Only the run that opened the store for writing writes to it, one transaction per result, so that ``kill -9`` at any
instant loses at most what was not finished. Nothing in the file is trusted on the way back: its layout, the digest of
each row and every value in a record are checked, and no pickle exists in it.
"""

from __future__ import annotations

import hashlib
import sqlite3
import statistics
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.records import Record, decode, encode
from collalign.engine.store_file import (
    KINDS,
    MAX_TEXT,
    Failure,
    open_connection,
    open_memory,
    reason_of,
    table_of,
)
from data_tools.errors import StoreError
from data_tools.io.files import system_reason
from data_tools.io.locks import LockFile
from data_tools.io.source import DIGEST_LENGTH


class Store:
    """Shapes and pairs by key; open it with :meth:`open` or :meth:`memory`, and close it or use ``with``.

    Attributes
    ----------
    path : Path or None
        Where it lies; None for a store in memory.
    read_only : bool
    """

    def __init__(
        self, connection: sqlite3.Connection, path: Path | None, lock: LockFile | None
    ) -> None:
        self._connection = connection
        self._lock = lock
        self._planned = set[str]()
        self.path = path
        self.read_only = path is not None and lock is None

    @classmethod
    def open(cls, path: str | Path, *, read_only: bool = False) -> Store:
        """Open a store; create it when it is opened for writing and does not exist.

        Parameters
        ----------
        path : str or Path
            The file. ``-wal``, ``-shm`` and ``.lock`` files are next to it while it is open.
        read_only : bool
            Look only; works while another run writes.

        Raises
        ------
        StoreError
            If another run has it open for writing, it is no store, or it is of another format version.
        """
        path = Path(path).absolute()
        lock = None if read_only else _locked(path)
        try:
            return cls(open_connection(path, read_only=read_only), path, lock)
        except BaseException:
            if lock is not None:
                lock.release()
            raise

    @classmethod
    def memory(cls) -> Store:
        """Return an empty store that lives in memory, for runs without a file."""
        return cls(open_memory(), None, None)

    def close(self) -> None:
        """Close the file and let other runs have it; closing twice does nothing."""
        self._connection.close()
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def get(self, kind: str, key: str) -> Record | None:
        """Return a record, or None where there is none.

        Raises
        ------
        StoreError
            If the record is damaged; it is taken out, so that the next run makes it anew.
        """
        rows = self._query(
            f"SELECT label, digest, record FROM {table_of(kind)} WHERE key = ?", (key,)
        )
        for label, digest, data in rows:
            name = f"{self._name}: {kind} {key} ({str(label)[:80]!r})"
            if not isinstance(data, bytes) or digest != _digest(kind, key, data):
                if not self.read_only:
                    with self._transaction() as connection:
                        connection.execute(f"DELETE FROM {table_of(kind)} WHERE key = ?", (key,))
                raise StoreError(
                    f"{name}: damaged; run the same command again, which makes it anew"
                )
            return decode(data, name)
        return None

    def require(self, kind: str, key: str) -> Record:
        """Return a record that must be there.

        Raises
        ------
        StoreError
            If it is missing or damaged.
        """
        record = self.get(kind, key)
        if record is None:
            raise StoreError(f"{self._name}: {kind} {key} has vanished while the run was using it")
        return record

    def put(
        self, kind: str, key: str, record: Record, *, label: str = "", seconds: float = float("nan")
    ) -> None:
        """Keep a record and forget its failure, in one transaction.

        Parameters
        ----------
        kind : {"shapes", "pairs"}
        key : str
            From :func:`collalign.engine.store.fingerprint`.
        record : dict
            See :mod:`collalign.engine.records`.
        label : str
            What it is, for people who look into the file.
        seconds : float
            What it took.
        """
        data = encode(record)
        table = table_of(kind)
        duration = None if seconds != seconds else float(seconds)
        row = (_checked(key), _text(label), duration, _digest(kind, key, data), data)
        with self._transaction() as connection:
            connection.execute(f"INSERT OR REPLACE INTO {table} VALUES (?, ?, ?, ?, ?)", row)
            connection.execute("DELETE FROM failures WHERE kind = ? AND key = ?", (kind, key))

    def keys(self, kind: str) -> frozenset[str]:
        """Return the keys of all records of a kind."""
        return frozenset(str(key) for (key,) in self._query(f"SELECT key FROM {table_of(kind)}"))

    def put_failure(
        self, kind: str, key: str, reason: str, *, label: str = "", crashed: bool = False
    ) -> None:
        """Record why there is no result for a key."""
        table_of(kind)
        row = (kind, _checked(key), _text(label), int(crashed), _text(reason))
        with self._transaction() as connection:
            connection.execute("INSERT OR REPLACE INTO failures VALUES (?, ?, ?, ?, ?)", row)

    def failures(self, kind: str) -> dict[str, Failure]:
        """Return the recorded failures of a kind by key, in the order of the keys."""
        table_of(kind)
        rows = self._query(
            "SELECT key, label, crashed, reason FROM failures WHERE kind = ? ORDER BY key", (kind,)
        )
        return {
            str(key): Failure(reason=str(reason), label=str(label), crashed=bool(crashed))
            for key, label, crashed, reason in rows
        }

    def plan(self, kind: str, labels: dict[str, str]) -> None:
        """Say which keys the present run wants, by key with a label each.

        The first plan of a kind since the store was opened takes the place of the former run's, further ones add to
        it. :meth:`status` counts against it; records that no plan names stay, for runs with other options, until
        :meth:`prune`.
        """
        table_of(kind)
        rows = [(kind, _checked(key), _text(label)) for key, label in labels.items()]
        with self._transaction() as connection:
            if kind not in self._planned:
                connection.execute("DELETE FROM plan WHERE kind = ?", (kind,))
            connection.executemany("INSERT OR REPLACE INTO plan VALUES (?, ?, ?)", rows)
        self._planned.add(kind)

    def unplan(self, kind: str, keys: Iterable[str]) -> None:
        """Take keys out of the plan that the run has given up."""
        with self._transaction() as connection:
            rows = [(table_of(kind), key) for key in keys]
            connection.executemany("DELETE FROM plan WHERE kind = ? AND key = ?", rows)

    def prune(self) -> int:
        """Delete what the last plan of each kind does not name, shrink the file, and return how many records went."""
        with self._transaction() as connection:
            planned = [str(kind) for (kind,) in self._query("SELECT DISTINCT kind FROM plan")]
            stale = "key NOT IN (SELECT key FROM plan WHERE kind = ?)"
            removed = 0
            for kind in planned:
                removed += connection.execute(
                    f"DELETE FROM {table_of(kind)} WHERE {stale}", (kind,)
                ).rowcount
                connection.execute(f"DELETE FROM failures WHERE kind = ? AND {stale}", (kind, kind))
        self._query("VACUUM")
        return removed

    def set_note(self, name: str, value: str) -> None:
        """Keep a short text about the run, for those who look at the store meanwhile; an empty one is forgotten."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM meta WHERE name = ?", (name,))
            if value:
                connection.execute("INSERT INTO meta VALUES (?, ?)", (name, value))

    def notes(self) -> dict[str, str]:
        """Return the texts of :meth:`set_note` by name."""
        return {
            str(name): str(value)
            for name, value in self._query("SELECT name, value FROM meta ORDER BY name")
        }

    def missing(self, kind: str, keys: Iterable[str], *, again: bool = False) -> list[str]:
        """Return the keys that are still to be computed, in the given order.

        Parameters
        ----------
        kind : {"shapes", "pairs"}
        keys : iterable of str
        again : bool
            Whether all failures are tried again, and not only those that another run may survive (a worker died or
            hung, the machine failed it): an error that the content causes comes back each time.
        """
        failures = {} if again else self.failures(kind)
        settled = self.keys(kind).union(
            key for key, failure in failures.items() if not failure.crashed
        )
        return [key for key in keys if key not in settled]

    def status(self) -> dict[str, dict[str, int]]:
        """Return, for each kind, how much is ``planned``, and of that ``done``, ``failed`` and ``left``.

        What has one label counts once, however often a run looked at it: a shape that was read with all its
        components and without, or a pair that was matched with reflections and without.
        """
        return {kind: self._counts(kind) for kind in KINDS}

    def median_seconds(self, kind: str) -> float:
        """Return the median time of records of a kind, which first tasks of workers hardly raise; NaN if unknown."""
        return self._median("seconds", kind)

    def median_bytes(self, kind: str) -> float:
        """Return the median size of records of a kind; NaN if there is none."""
        return self._median("length(record)", kind)

    def _median(self, value: str, kind: str) -> float:
        found = self._query(f"SELECT {value} FROM {table_of(kind)} WHERE {value} IS NOT NULL")
        values = [one for (one,) in found]
        return statistics.median(values) if values else float("nan")

    @property
    def _name(self) -> str:
        return "store in memory" if self.path is None else str(self.path)

    def _counts(self, kind: str) -> dict[str, int]:
        done = f"EXISTS (SELECT 1 FROM {table_of(kind)} AS t WHERE t.key = plan.key)"
        failed = (
            "EXISTS (SELECT 1 FROM failures AS f WHERE f.kind = plan.kind AND f.key = plan.key)"
        )
        numbers = f"count(*), total({done}), total(NOT {done} AND {failed})"
        sql = f"SELECT {numbers} FROM plan WHERE kind = ? GROUP BY label"
        rows = self._query(sql, (kind,))
        left = sum(count > num_done + num_failed for count, num_done, num_failed in rows)
        num_failed = sum(bad > 0 and not good and count == good + bad for count, good, bad in rows)
        return {
            "planned": len(rows),
            "done": len(rows) - left - num_failed,
            "failed": num_failed,
            "left": left,
        }

    def _query(self, sql: str, values: tuple[Any, ...] = ()) -> list[Any]:
        try:
            return self._connection.execute(sql, values).fetchall()
        except (sqlite3.Error, UnicodeError) as error:
            raise StoreError(f"{self._name}: cannot be read ({error})") from None

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """Write under BEGIN IMMEDIATE, so that a conflict shows at once and never halfway."""
        if self.read_only:
            raise StoreError(f"{self._name}: opened for reading only")
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            with self._connection:
                yield self._connection
        except (sqlite3.Error, UnicodeError) as error:
            raise StoreError(f"{self._name}: {reason_of(error)}") from None


def _digest(kind: str, key: str, data: bytes) -> bytes:
    """Return the digest of a row: it shows damage and swapped rows, it is no signature."""
    return hashlib.blake2b(f"{kind} {key} ".encode() + data, digest_size=16).digest()


def _checked(key: str) -> str:
    if not isinstance(key, str) or not 0 < len(key) <= MAX_TEXT:
        raise ValueError(f"a key is a string of 1 to {MAX_TEXT} characters, got {key!r}")
    return key


def _text(text: str) -> str:
    """Return text that SQLite can hold: file names may contain bytes that are no Unicode."""
    return text[:MAX_TEXT].encode("utf-8", "replace").decode("utf-8")


def _locked(path: Path) -> LockFile:
    """Lock a store at once or refuse, by a file next to it, which the system frees however the writer ends."""
    lock = path.with_name(path.name + ".lock")
    try:
        return LockFile.take(lock)
    except BlockingIOError:
        raise StoreError(
            f"{path}: another run is writing to this store; wait for it, or name another store"
        ) from None
    except OSError as error:
        raise StoreError(f"{lock}: cannot be opened and locked ({system_reason(error)})") from None


def fingerprint(algorithm_version: str, options: Any, *content_hashes: str) -> str:
    """Return the key of a computation.

    Parameters
    ----------
    algorithm_version : str
        Changes whenever the same input and options would give another answer.
    options : dataclass, mapping, or plain value
        Only the options that matter for the answer. 1 and 1.0 count as the same value.
    *content_hashes : str
        Hashes or keys of the inputs, in order.

    Returns
    -------
    str
        40 hexadecimal digits.

    Examples
    --------
    >>> fingerprint("1", {"points": 64}, "ab") == fingerprint("1", {"points": 64.0}, "ab")
    True
    """
    content = {
        "version": algorithm_version,
        "options": _canonical(options),
        "content": list(content_hashes),
    }
    return hashlib.sha256(encode(content)).hexdigest()[:DIGEST_LENGTH]


def pair_seed(seed: int, target: str, source: str) -> int:
    """Return the seed of a pair, the same in every order and company of shapes.

    Parameters
    ----------
    seed : int
        Of the collection.
    target, source : str
        What identifies the two shapes: in an alignment their keys, made of their contents and options, so that
        neither the names of files nor their places matter.

    Returns
    -------
    int
        In [0, 2^63), for :func:`numpy.random.default_rng`.
    """
    names = [name.encode("utf-8", "surrogateescape") for name in (target, source)]
    content = encode({"seed": int(seed), "names": names})
    return int.from_bytes(hashlib.sha256(content).digest()[:8], "big") >> 1


def _canonical(value: Any) -> Any:
    """Return options as plain values in which equal settings are equal bytes."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _canonical(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items()}
    if isinstance(value, set | frozenset):
        return sorted(_canonical(item) for item in value)
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value
