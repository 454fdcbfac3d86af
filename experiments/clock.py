"""Wall time and CPU time of what an experiment compares, worker processes included."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(kw_only=True)
class Elapsed:
    """What a stopwatch showed; NaN until it was stopped.

    Attributes
    ----------
    wall_s : float
        Seconds on the wall.
    processor_s : float
        Seconds of all cores together, of this process and of those it started; NaN where ``/proc`` is missing.
        On a machine that others use it says more than the wall.
    """

    wall_s: float = float("nan")
    processor_s: float = float("nan")


@contextmanager
def stopwatch() -> Iterator[Elapsed]:
    """Measure the block.

    Yields
    ------
    Elapsed
        Filled in at the end of the block.
    """
    elapsed = Elapsed()
    processor_s, start_s = _processor_s(), time.perf_counter()
    try:
        yield elapsed
    finally:
        elapsed.wall_s = time.perf_counter() - start_s
        elapsed.processor_s = _processor_s() - processor_s


def _processor_s(root: Path = Path("/proc")) -> float:
    """Return the CPU time of this process and all its descendants, those that ended included."""
    if not (root / "self").exists():
        return float("nan")
    return sum(_family(root).values()) / os.sysconf("SC_CLK_TCK")


def _family(root: Path) -> dict[int, int]:
    """Return the clock ticks of this process and all its descendants by their ids."""
    parents, ticks = {}, {}
    for folder in root.glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()
        except OSError:  # it ended meanwhile
            continue
        parents[int(folder.name)] = int(fields[1])
        ticks[int(folder.name)] = sum(int(value) for value in fields[11:15])
    return {pid: ticks[pid] for pid in ticks if _descends(pid, os.getpid(), parents)}


def _descends(pid: int, ancestor: int, parents: dict[int, int]) -> bool:
    while pid != ancestor:
        if pid not in parents:
            return False
        pid = parents[pid]
    return True
