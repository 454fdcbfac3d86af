"""How time and memory grow with the collection: ``python -m tests.benchmarks.bench_scale --sizes 100 300 1000``.

Generated chairs in random poses, default options (so sparse pairs that grow where poses are uncertain), outputs
included. Prints the seconds of each stage, the CPU seconds of all processes (other work on the machine hardly
changes these), the peak memory of the parent and of the largest worker, the errors against the truth, and the
exponent of the CPU time against the number of shapes; ``--plot`` draws it.
"""

import argparse
import itertools
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from joblib.externals.loky import get_reusable_executor

from collalign import RunOptions, align_collection
from data_tools.datasets.synthetic import bumped, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import chair
from data_tools.rotations import rotation_angle_deg


def generate(num, folder, seed):
    """Write chairs of varied proportions in random poses and return ``R_common_shape`` of each, in natural order."""
    rng = np.random.default_rng(seed)
    width = len(str(num))
    family = [
        bumped(chair(rng, resolution=1, name=f"chair{i:0{width}d}"), rng, rms=0.015)
        for i in range(num)
    ]
    planted = planted_collection(family, rng, scale_range=(0.7, 1.5))
    write_collection(folder, planted)
    return planted.rotations


def gibibytes(who):
    return resource.getrusage(who).ru_maxrss / 2**20


def processor_s():
    """CPU seconds of this process and of the workers that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def measure(num, jobs, seed):
    """Align and save a generated collection, print what it took, and return the CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        truth = generate(num, Path(folder) / "shapes", seed)
        start_s, before_s = time.perf_counter(), processor_s()
        run = RunOptions(jobs=jobs, store=Path(folder) / "store.sqlite")
        collection = align_collection(Path(folder) / "shapes", run=run)
        aligned_s = time.perf_counter() - start_s
        collection.save(Path(folder) / "out")
        seconds = time.perf_counter() - start_s
        get_reusable_executor().shutdown(wait=True)  # so that the workers' time counts
        used_s = processor_s() - before_s
    chosen = np.random.default_rng(0).permutation(num)[:60]
    found = collection.rotations
    errors = [
        float(rotation_angle_deg(found[i].T @ found[j], truth[i].T @ truth[j]))
        for i, j in itertools.combinations(chosen, 2)
    ]
    stages = {stage: round(value, 1) for stage, value in collection.run.times_s.items()}
    stages["outputs"] = round(seconds - aligned_s, 1)
    print(
        f"N = {num}: {seconds:.0f} s {stages}, processor {used_s:.0f} s, {len(collection.pairs)} pairs",
        end=", ",
    )
    parent, worker = gibibytes(resource.RUSAGE_SELF), gibibytes(resource.RUSAGE_CHILDREN)
    print(f"peak memory {parent:.2f} GiB, largest worker {worker:.2f} GiB", end=", ")
    print(f"error median {np.median(errors):.2f} deg, worst {max(errors):.1f}", flush=True)
    return used_s


def plot(sizes, seconds, exponent, path):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.loglog(sizes, seconds, "o-")
    axes.set_xlabel("shapes")
    axes.set_ylabel("CPU seconds")
    axes.set_title(f"time ~ N^{exponent:.2f}")
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 300, 1000])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    seconds = [measure(num, arguments.jobs, arguments.seed) for num in arguments.sizes]
    if len(seconds) > 1:
        exponent = float(np.polyfit(np.log(arguments.sizes), np.log(seconds), 1)[0])
        print(f"exponent {exponent:.2f}")
        if arguments.plot:
            plot(arguments.sizes, seconds, exponent, arguments.plot)


if __name__ == "__main__":
    main()
