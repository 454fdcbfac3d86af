"""How true the estimates of ``batch --dry-run`` are: ``python -m tests.benchmarks.bench_estimate [NAME-NUM ...]``.

Estimates a folder with an empty store, aligns it, saves it, and prints both, stage by stage. Everything runs in this
process, on one thread, and both sides are CPU seconds: other work on the machine hardly changes these, and a
clock would compare a quiet trial with a loaded run. ``start`` is zero then: there are no workers to start.
"""

import argparse
import shutil
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

time.perf_counter = time.process_time  # all stages are timed by it

from collalign import RunOptions, align_collection  # noqa: E402
from collalign.batch import BatchJob, estimate_job  # noqa: E402
from collalign.engine import session  # noqa: E402
from collalign.engine.run_jobs import run_jobs  # noqa: E402
from collalign.options import AlignOptions  # noqa: E402
from data_tools.io.files import natural_key  # noqa: E402
from tests.benchmarks.bench_scale import generate  # noqa: E402

NAMES = ("teeth-116", "teeth-20", "skulls-20", "bodies-20", "generated-20")
DATA = Path("../shared/data")
FOLDERS = {
    "teeth": DATA / "teeth_pnas116" / "meshes",
    "skulls": DATA / "mouse_skulls62" / "meshes",
    "bodies": DATA / "shrec07_dev" / "human" / "meshes",
}


@contextmanager
def shapes_of(name, num):
    """Give a folder with the first shapes of a collection."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "shapes"
        if name == "generated":
            generate(num, folder, 0)
        else:
            folder.mkdir()
            for file in sorted(FOLDERS[name].iterdir(), key=lambda path: natural_key(path.name))[
                :num
            ]:
                shutil.copy(file, folder)
        yield folder


def measure(name, num):
    """Print the estimated and the actual seconds of one folder."""
    with shapes_of(name, num) as folder:
        run = RunOptions(jobs=1, store=folder.parent / "store.sqlite")
        start = time.process_time()
        estimate = estimate_job(
            BatchJob(
                folders=(folder,),
                out=folder.parent / "out",
                recursive=False,
                parts=False,
                include=(),
                kinds_by="",
                options=AlignOptions(),
            ),
            run,
        )
        trial_s = time.process_time() - start
        start = time.process_time()
        collection = align_collection(folder, run=run)
        aligned_s = time.process_time() - start
        collection.save(folder.parent / "out")
        total_s = time.process_time() - start
    print(f"{name}-{num}: {total_s:.1f} s, estimated {estimate.seconds:.1f} s", end=", ")
    print(f"factor {estimate.seconds / total_s:.2f}; the trial took {trial_s:.1f} s")
    print("  estimated", {stage: round(seconds, 1) for stage, seconds in estimate.stages_s.items()})
    stages = dict(collection.run.times_s) | {"outputs": total_s - aligned_s}
    print(
        "  actual   ", {stage: round(seconds, 1) for stage, seconds in stages.items()}, flush=True
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", default=NAMES, metavar="NAME-NUM")
    arguments = parser.parse_args()
    unlimited = {"time_limit_s": None, "memory_limit_bytes": None}  # no worker processes
    session.run_jobs = lambda *given, **options: run_jobs(*given, **options | unlimited)
    for name, _, num in (folder.partition("-") for folder in arguments.names):
        measure(name, int(num))


if __name__ == "__main__":
    main()
