"""The command that is being run, for the records of what it writes, and what commands say to programs."""

from __future__ import annotations

import math
import signal
from collections.abc import Mapping
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any

#: The words of the command line; empty where Python calls.
COMMAND: ContextVar[str] = ContextVar("COMMAND", default="")
#: Signals that ask a command to end: Ctrl-C, ``kill`` or a batch system, and a terminal that is closed.
ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


def now() -> str:
    """Return date and time in UTC, as ISO 8601 has it, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def can_be_answered(number: int) -> bool:
    """Return whether this process may answer a signal: ``nohup`` and the like want it ignored, also by children."""
    return number == signal.SIGINT or signal.getsignal(number) not in (signal.SIG_IGN, None)


def json_types(value: Any) -> Any:
    """Turn a value into JSON types: tuples into lists, numbers that are not finite into None."""
    if isinstance(value, Mapping):
        return {str(key): json_types(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_types(item) for item in value]
    if hasattr(value, "tolist"):  # an array or a number of NumPy, which is not imported for this
        return json_types(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
