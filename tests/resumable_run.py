"""A run on a store that can be killed and started again: ``python -m tests.resumable_run STORE NUM_TASKS``."""

from __future__ import annotations

import sys
import time

from collalign.engine.jobs.run import run_jobs
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.engine.store.store import Store
from tests.job_functions import spectrum


def slow_spectrum(payload: int) -> Record:
    time.sleep(0.03)
    return {"vectors": spectrum(payload)}


def main(path: str, num_tasks: int) -> None:
    payloads = {fingerprint("1", {}, str(i)): i for i in range(num_tasks)}
    with Store.open(path) as store:
        store.plan("pairs", {key: str(i) for key, i in payloads.items()})
        missing = store.missing("pairs", payloads)
        for job in run_jobs(slow_spectrum, ((key, payloads[key]) for key in missing), num_jobs=2, time_limit_s=60.0):
            if job.failure is None:
                store.put("pairs", job.key, job.value, seconds=job.seconds)
            else:
                store.put_failure("pairs", job.key, job.failure, crashed=job.crashed)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
