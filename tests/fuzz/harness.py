"""Damages files, hands them to a target in a guarded worker, and counts how each ended."""

import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from collalign.engine.jobs.run import run_jobs
from tests.fuzz.mutations import mutate

LIMITS = {"time_limit_s": 60.0, "memory_limit_bytes": 2 * 2**30}


@dataclass
class FuzzReport:
    """How the damaged files ended, and those that ended badly: by name, with the reason."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: dict[str, str] = field(default_factory=dict)
    slowest_s: float = 0.0

    def __str__(self):
        kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(self.counts.items()))
        return f"{self.counts.total()} files: {kinds}; slowest {self.slowest_s:.2f} s"


def fuzz(target, files, num, *, seed=0, num_jobs=1, keep=None):
    """Run a target on ``num`` damaged files; the same seed damages in the same way.

    The target is a function of a module that takes (name, bytes). Damaged files keep the suffix of good ones; those
    that ended badly go to the folder ``keep``.
    """
    report = FuzzReport()
    made = {}

    def tasks():
        for i in range(num):
            key = f"{seed}-{i}"
            made[key] = damaged(files, seed, i)
            yield key, made[key]

    jobs = run_jobs(target, tasks(), num_jobs=num_jobs, **LIMITS)
    for job in jobs:
        name, data = made.pop(job.key)
        kind = how_it_ended(job)
        report.counts[kind] += 1
        report.slowest_s = max(
            report.slowest_s, job.seconds if job.seconds == job.seconds else LIMITS["time_limit_s"]
        )
        if kind not in ("valid", "clear errors"):
            report.bad[f"{job.key}-{name}"] = f"{kind}: {job.failure}"
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{job.key}-{name}").write_bytes(data)
    return report


def damaged(files, seed, index):
    """Return the name and bytes of one damaged file."""
    rng = np.random.default_rng((seed, index))
    names = sorted(files)
    name = names[int(rng.integers(len(names)))]
    return name, mutate(files[name], list(files.values()), rng)


def how_it_ended(job):
    """Name the ending of a job; errors that the project does not raise on purpose carry their type."""
    if job.crashed:
        return "crashes" if "time limit" not in str(job.failure) else "hangs"
    if job.failure is None:
        return "valid"
    unexpected = re.match(r"[A-Z]\w*(Error|Exception|Interrupt|Iteration): ", job.failure)
    return "unclear errors" if unexpected else "clear errors"
