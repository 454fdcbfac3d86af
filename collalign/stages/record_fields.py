"""Fields of the store's records, each checked: a store made by somebody else can be wrong but not harmful."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from data_tools.arrays import FloatArray, IntArray, as_floats, as_indices, read_only
from data_tools.errors import InputError, StoreError
from pairwise.status import Status

#: Indices are below this.
MAX_INDEX = 2**31


@contextmanager
def checked(what: str) -> Iterator[None]:
    """Report whatever is wrong with a record, which ``what`` names, as damage of the store.

    Raises
    ------
    StoreError
        Instead of whatever says that a field is missing or impossible.
    """
    try:
        yield
    except KeyError as error:
        raise StoreError(f"stored {what}: {error} is missing") from None
    except (InputError, TypeError, ValueError) as error:
        raise StoreError(f"stored {what}: {error}") from None


def floats(value: Any, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Return finite numbers of this shape; None is any length."""
    return read_only(as_floats(value, name, shape=shape))


def indices(value: Any, name: str, num: int | None = None) -> IntArray:
    """Return indices, so many of them where ``num`` says."""
    return read_only(as_indices(value, name, upper=MAX_INDEX, shape=(num,)))


def number(value: Any, name: str, *, allow_nan: bool = False) -> float:
    """Return a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name}: expected a number, got {type(value).__name__}")
    if not allow_nan and value != value:
        raise InputError(f"{name}: is NaN")
    return float(value)


def positive(value: Any, name: str) -> int:
    """Return a positive integer."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < MAX_INDEX:
        raise InputError(f"{name}: expected a positive integer, got {value!r}")
    return value


def listed(value: Any, name: str) -> list[Any]:
    """Return a list."""
    if not isinstance(value, list):
        raise InputError(f"{name}: expected a list, got {type(value).__name__}")
    return value


def text(value: Any, name: str) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise InputError(f"{name}: expected text, got {type(value).__name__}")
    return value


def status(value: Any) -> Status:
    """Return a status by its name."""
    if not isinstance(value, str) or value not in Status.__members__:
        raise InputError(f"status: {value!r} is none")
    return Status[value]
