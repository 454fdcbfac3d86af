"""How the work of a run is done: processes, store and limits."""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from data_tools.checks import check_number
from data_tools.errors import OptionsError

#: Largest memory limit: what a system can count.
_MAX_LIMIT_GIB = sys.maxsize / 2**30


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How the work is done; nothing here changes the result of what finishes.

    Parameters
    ----------
    jobs : int
        Worker processes; -1 is one per core, and more than one per core are not started: they would only wait for
        each other, each with its own libraries to load. 1 starts none: all runs in this process, without the limits
        below.
    store : Path, optional
        SQLite file that keeps every finished shape and pair, so that an interrupted run can go on.
    scheduler : str, optional
        Address of a Dask scheduler (tcp://...) that takes the jobs instead of this machine's processes.
    shape_time_limit_s : float
        Seconds for preparing one shape before it is given up.
    pair_time_limit_s : float
        Seconds for matching one pair before it is given up.
    memory_limit_gib : float
        Memory of one worker before its task is given up.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    jobs: int = -1
    store: Path | None = None
    scheduler: str | None = None
    shape_time_limit_s: float = 300.0
    pair_time_limit_s: float = 300.0
    memory_limit_gib: float = 8.0

    def __post_init__(self) -> None:
        if not isinstance(self.jobs, int) or self.jobs == 0 or self.jobs < -1:
            raise OptionsError(
                f"jobs: expected -1 or a positive number of processes, got {self.jobs!r}"
            )
        for name, largest in (
            ("shape_time_limit_s", threading.TIMEOUT_MAX),
            ("pair_time_limit_s", threading.TIMEOUT_MAX),
            ("memory_limit_gib", _MAX_LIMIT_GIB),
        ):
            check_number(name, getattr(self, name), upper=largest, positive=True)

    @property
    def num_workers(self) -> int:
        """Worker processes: as many as asked for and as there are cores that this process may use."""
        from joblib import cpu_count

        num_cores = int(cpu_count())
        return num_cores if self.jobs == -1 else min(self.jobs, num_cores)

    @property
    def is_alone(self) -> bool:
        """Whether all runs in this process: a hang or an exhausted memory cannot be ended from inside."""
        return self.jobs == 1 and self.scheduler is None

    @property
    def memory_limit_bytes(self) -> int:
        """Memory of one worker in bytes."""
        return int(self.memory_limit_gib * 2**30)


class RunKeywords(TypedDict, total=False):
    """The fields of :class:`RunOptions` as keywords."""

    jobs: int
    store: Path | None
    scheduler: str | None
    shape_time_limit_s: float
    pair_time_limit_s: float
    memory_limit_gib: float
