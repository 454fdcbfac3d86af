"""Damages files, hands them to a target in a guarded worker, and counts how each ended."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.jobs.run import JobResult, run_jobs
from tests.fuzz.mutations import mutate

TIME_LIMIT_S = 60.0
MEMORY_LIMIT_BYTES = 2 * 2**30


@dataclass
class FuzzReport:
    """How the damaged files ended, and those that ended badly: by name, with the reason."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: dict[str, str] = field(default_factory=dict)
    slowest_s: float = 0.0

    def __str__(self) -> str:
        kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(self.counts.items()))
        return f"{self.counts.total()} files: {kinds}; slowest {self.slowest_s:.2f} s"


def fuzz(
    target: Callable[[tuple[str, bytes]], Any],
    files: Mapping[str, bytes],
    num: int,
    *,
    seed: int = 0,
    num_jobs: int = 1,
    keep: Path | None = None,
) -> FuzzReport:
    """Run a target on ``num`` damaged files; the same seed damages in the same way.

    The target is a function of a module that takes (name, bytes). Damaged files keep the suffix of good ones; those
    that ended badly go to the folder ``keep``.
    """
    report = FuzzReport()
    made: dict[str, tuple[str, bytes]] = {}

    def tasks() -> Iterator[tuple[str, tuple[str, bytes]]]:
        for i in range(num):
            key = f"{seed}-{i}"
            made[key] = damaged(files, seed, i)
            yield key, made[key]

    jobs = run_jobs(
        target, tasks(), num_jobs=num_jobs, time_limit_s=TIME_LIMIT_S, memory_limit_bytes=MEMORY_LIMIT_BYTES
    )
    for job in jobs:
        name, data = made.pop(job.key)
        kind = how_it_ended(job)
        report.counts[kind] += 1
        report.slowest_s = max(report.slowest_s, job.seconds if job.seconds == job.seconds else TIME_LIMIT_S)
        if kind not in ("valid", "clear errors"):
            report.bad[f"{job.key}-{name}"] = f"{kind}: {job.failure}"
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{job.key}-{name}").write_bytes(data)
    return report


def damaged(files: Mapping[str, bytes], seed: int, index: int) -> tuple[str, bytes]:
    """Return the name and bytes of one damaged file."""
    rng = np.random.default_rng((seed, index))
    names = sorted(files)
    name = names[int(rng.integers(len(names)))]
    return name, mutate(files[name], list(files.values()), rng)


def how_it_ended(job: JobResult) -> str:
    """Name the ending of a job; errors that the project does not raise on purpose carry their type."""
    if job.crashed:
        return "crashes" if "time limit" not in str(job.failure) else "hangs"
    if job.failure is None:
        return "valid"
    unexpected = re.match(r"[A-Z]\w*(Error|Exception|Interrupt|Iteration): ", job.failure)
    return "unclear errors" if unexpected else "clear errors"
