"""The command that is being run, for the records of what it writes."""

from __future__ import annotations

from contextvars import ContextVar
from datetime import UTC, datetime

#: The words of the command line; empty where Python calls.
COMMAND: ContextVar[str] = ContextVar("COMMAND", default="")


def now() -> str:
    """Return date and time in UTC, as ISO 8601 has it, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
