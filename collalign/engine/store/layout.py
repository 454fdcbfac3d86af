"""The tables of a store, statement by statement, and what their rows mean; a file whose tables differ is refused."""

from __future__ import annotations

from dataclasses import dataclass

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
