"""Damages files, hands them to a target in a guarded worker, and counts how each ended."""

import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from collalign.engine.run_jobs import run_jobs
from tests.fuzz.mutations import mutate

LIMITS = {"time_limit_s": 60.0, "memory_limit_bytes": 2 * 2**30}
#: Endings as they should be, of files and of forgeries.
GOOD = ("valid", "clear errors", "true", "refused")


@dataclass
class Report:
    """How many ended in each way, and those that ended badly: by name, with the reason."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, endings):
        """Count endings, given with the name of what ended so; what follows a colon is a reason."""
        report = cls()
        for name, ending in endings:
            report.counts[ending.split(":")[0]] += 1
            if ending not in GOOD:
                report.bad[name] = ending
        return report

    def __str__(self):
        return f"{self.counts.total()} cases: " + ", ".join(
            f"{n} {kind}" for kind, n in sorted(self.counts.items())
        )


def fuzz(kinds, numbers, *, seed=0, num_jobs=1, keep=None):
    """Damage so many files of each kind and yield how each ended; the same seed damages in the same way.

    A kind is a target and good files by name; a target is a function of a module that takes (name, bytes). Damaged
    files keep the suffix of good ones; those that ended badly go to the folder ``keep``.
    """
    made = {}

    def tasks():
        for kind, num in numbers.items():
            target, files = kinds[kind]
            for i in range(num):
                key = f"{kind} {seed}-{i}"
                made[key] = damaged(files, seed, i)
                yield key, (target, made[key])

    for job in run_jobs(_call, tasks(), num_jobs=num_jobs, **LIMITS):
        name, data = made.pop(job.key)
        ending = how_it_ended(job)
        if keep is not None and ending not in GOOD:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{job.key}-{name}").write_bytes(data)
        yield f"{job.key}-{name}", ending


def _call(task):
    target, payload = task
    return target(payload)


def damaged(files, seed, index):
    """Return the name and bytes of one damaged file."""
    rng = np.random.default_rng((seed, index))
    names = sorted(files)
    name = names[int(rng.integers(len(names)))]
    return name, mutate(files[name], list(files.values()), rng)


def how_it_ended(job):
    """Name the ending of a job; errors that the project does not raise on purpose carry their type."""
    if job.crashed:
        return f"{'crashes' if 'time limit' not in str(job.failure) else 'hangs'}: {job.failure}"
    if job.failure is None:
        return "valid"
    unexpected = re.match(r"[A-Z]\w*(Error|Exception|Interrupt|Iteration): ", job.failure)
    return f"unclear errors: {job.failure}" if unexpected else "clear errors"
