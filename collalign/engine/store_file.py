"""The SQLite file of a store: its tables, what their rows mean, and how a damaged or hostile file is refused."""

from __future__ import annotations

import os
import sqlite3
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from data_tools.errors import InputError, StoreError, UnavailableError
from data_tools.io.files import (
    MAX_TEXT_BYTES,
    open_regular,
    own_copy,
    resolved,
    system_reason,
    write_atomic,
)

#: Name of the store that a result's folder holds unless another one is named.
STORE_FILE = "store.sqlite"
#: Kinds of records, each a table; ``measurements`` are the cells of an experiment's tables.
KINDS = ("shapes", "pairs", "proofs", "surfaces", "evidence", "registrations", "measurements")
#: Names of notes: what a run does just now (:data:`FINISHED` in the end), and how many files it was given.
STAGE, NUM_FILES, FINISHED = "stage", "files", "finished"
#: Raised whenever the tables or the encoding of records change.
FORMAT_VERSION = 4
#: Marks an SQLite file as a store ("cola").
APPLICATION_ID = int.from_bytes(b"cola")
#: Of the file, in bytes: two records of 64 points fit a page, where SQLite's default would leave a third empty.
PAGE_SIZE = 8192
#: Longest key, label and reason of a failure, in characters.
MAX_TEXT = 1000

_RECORDS = (
    "CREATE TABLE {kind} (key TEXT PRIMARY KEY NOT NULL, label TEXT NOT NULL, seconds REAL, "
    "digest BLOB NOT NULL, record BLOB NOT NULL)"
)
STATEMENTS = (
    *(_RECORDS.format(kind=kind) for kind in KINDS),
    "CREATE TABLE failures (kind TEXT NOT NULL, key TEXT NOT NULL, label TEXT NOT NULL, crashed INTEGER NOT NULL, "
    "reason TEXT NOT NULL, PRIMARY KEY (kind, key)) WITHOUT ROWID",
    "CREATE TABLE plan (kind TEXT NOT NULL, key TEXT NOT NULL, label TEXT NOT NULL, "
    "PRIMARY KEY (kind, key)) WITHOUT ROWID",
    "CREATE TABLE meta (name TEXT PRIMARY KEY NOT NULL, value TEXT NOT NULL) WITHOUT ROWID",
)


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a shape or pair has no result.

    Attributes
    ----------
    reason : str
        One sentence.
    label : str
        What it is, for people.
    crashed : bool
        Whether another run may succeed: a worker died or hung on it, or the machine failed it.
    """

    reason: str
    label: str
    crashed: bool


def table_of(kind: str) -> str:
    """Return the table of a kind of records.

    Raises
    ------
    ValueError
        If there is no such kind; table names are never built from anything else.
    """
    if kind not in KINDS:
        raise ValueError(f"kind: expected one of {KINDS}, got {kind!r}")
    return kind


#: How SQLite's files next to a store begin (https://www.sqlite.org/fileformat.html and walformat.html).
_JOURNALS = {
    "-wal": (bytes.fromhex("377f0682"), bytes.fromhex("377f0683")),
    "-journal": (bytes.fromhex("d9d505f920a163d7"), bytes(8)),
    "-shm": ((3_007_000).to_bytes(4, "little"), (3_007_000).to_bytes(4, "big"), bytes(4)),
}


def open_connection(path: Path, *, read_only: bool) -> sqlite3.Connection:
    """Open a store's file, creating its tables where it is new.

    Raises
    ------
    StoreError
        If it cannot be opened, is no store, or is of another version.
    """
    if read_only and not path.is_file():
        raise StoreError(f"{path}: there is no such store")
    _prepare(path, read_only)
    uri = f"{path.as_uri()}?mode={'ro' if read_only else 'rw'}"
    try:
        connection = sqlite3.connect(uri, uri=True, isolation_level=None)
    except sqlite3.Error as error:
        raise StoreError(f"{path}: cannot be opened ({error})") from None
    try:
        _harden(connection)
        if not read_only:
            _check_layout(
                connection, path
            )  # before anything is written to a file that may be somebody else's
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = NORMAL")
        _check_layout(connection, path)
    except (sqlite3.Error, UnicodeError) as error:  # SQLite quotes damaged text in its messages
        connection.close()
        raise StoreError(f"{path}: {reason_of(error)}") from None
    except BaseException:
        connection.close()
        raise
    return connection


def open_memory() -> sqlite3.Connection:
    """Return a connection to a new store in memory."""
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.execute(f"PRAGMA page_size = {PAGE_SIZE}")
    for statement in STATEMENTS:
        connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {FORMAT_VERSION}")
    return connection


def reason_of(error: Exception) -> str:
    """Say whether the disk, the permissions or the file are to blame."""
    name = str(getattr(error, "sqlite_errorname", ""))
    if name.startswith("SQLITE_FULL"):
        return "cannot be written, the disk is full; make room or name a store on another disk"
    if name.startswith(
        ("SQLITE_IOERR", "SQLITE_CANTOPEN", "SQLITE_READONLY", "SQLITE_BUSY", "SQLITE_PERM")
    ):
        return f"cannot be read or written ({error}, {name}); look at the disk, its free space and the permissions"
    return f"not a store, or damaged ({error}); name another file"


def _prepare(path: Path, read_only: bool) -> None:
    """Make a store that does not exist, all at once; SQLite opens, and removes, only what is a store's.

    SQLite writes into the file in place. A backup of hard links shall stay as it is, so a store with other names is
    copied first.

    Raises
    ------
    StoreError
        If the file is no store, or what lies where SQLite keeps its journals belongs to no store.
    """
    try:
        path = resolved(path)  # SQLite's journals lie there
        header = _start(path, 100)
        for ending, marks in _JOURNALS.items():
            journal = path.with_name(path.name + ending)
            start = _start(journal, 8)
            if start is not None and not (header and (not start or start.startswith(marks))):
                raise StoreError(
                    f"{journal}: lies where a journal of the store {path.name} belongs, and is none; "
                    "move it away, or name another store"
                )
        if not header and not read_only:
            with closing(open_memory()) as connection:
                write_atomic(path, connection.serialize())
        elif (
            not header
            or header[:16] != b"SQLite format 3\0"
            or header[68:72] != APPLICATION_ID.to_bytes(4)
        ):
            raise StoreError(f"{path}: not a store of this program; name another file")
        elif not read_only:
            for file in (
                path,
                *(path.with_name(path.name + ending) for ending in ("-wal", "-journal")),
            ):
                own_copy(file)
    except InputError as error:
        raise StoreError(f"{path}: cannot be opened ({error})") from None
    except OSError as error:
        raise StoreError(f"{path}: cannot be opened ({system_reason(error)})") from None


def _start(path: Path, num: int) -> bytes | None:
    """Return the first bytes of a regular file, None where there is none."""
    if not os.path.lexists(path):
        return None
    try:
        with open_regular(path, sys.maxsize) as stream:
            return stream.read(num)
    except UnavailableError:
        if os.path.lexists(path):
            raise
        return None  # a reader's neighbour has just closed the store


def _harden(connection: sqlite3.Connection) -> None:
    """Let nothing inside the file run code or demand unbounded memory."""
    connection.text_factory = lambda data: data.decode("utf-8", "replace")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_TEXT_BYTES)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    connection.execute("PRAGMA mmap_size = 0")


def _check_layout(connection: sqlite3.Connection, path: Path) -> None:
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION_ID:
        raise StoreError(f"{path}: not a store of this program; name another file")
    if version != FORMAT_VERSION:
        raise StoreError(
            f"{path}: has format version {version}, and this program reads {FORMAT_VERSION}. Move it away: the next "
            "run computes everything again. Finished results stay as they are"
        )
    rows = connection.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall()
    if {sql for (sql,) in rows} != set(STATEMENTS):
        raise StoreError(f"{path}: its tables are not those of a store")
