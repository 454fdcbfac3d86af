"""Where the processor time of a run goes, by stage and kernel: ``python -m tests.benchmarks.profile [NAME ...]``.

    NAME: teeth, skulls, bodies, generated (all four by default); --num takes the first shapes of each only

Everything runs in this process, on one thread, from files to report; times are processor seconds, which other
work on the machine hardly changes. A kernel's time includes what it calls, so kernels overlap; the percentages are of
the whole run. ``--deep`` lists the functions that cost most by themselves (cProfile, which slows Python down).
"""

from __future__ import annotations

import argparse
import cProfile
import functools
import importlib
import pkgutil
import pstats
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import collalign
import data_tools
import pairwise
from collalign.engine.jobs import run as jobs_run
from collalign.engine.jobs.worker import Limits
from data_tools.io.files import natural_key
from tests.benchmarks.bench_scale import generate

DATA = Path("../shared/data")
FOLDERS = {
    "teeth": DATA / "teeth_pnas116" / "meshes",
    "skulls": DATA / "mouse_skulls62" / "meshes",
    "bodies": DATA / "shrec07_dev" / "human" / "meshes",
}
NUM_GENERATED = 1000
#: Functions whose calls are timed, by stage: module and name, or class and name.
KERNELS = {
    "shapes": (
        "stages.shape_stage:prepare_shapes",
        "io.shapes:read_shape",
        "surface.cleaning:clean",
        "surface.geodesics:GeodesicSolver.__init__",
        "surface.geodesics:average_geodesic_distance",
        "surface.geodesics:agd_maxima",
        "surface.laplacian:spectrum",
        "embedding.sampling:farthest_points",
        "surface.normals:outward_normals",
    ),
    "pairs": (
        "stages.chirality.pilot:decide_group",
        "stages.pairs.match:match_pairs",
        "local.rotation_search:explore",
        "local.rotation_search:look_around",
        "local.local_search:minimise",
        "stages.pairs.select:select_pairs",
    ),
    "poses": (
        "stages.evidence.weigh:weigh_pairs",
        "synchronization.solve:synchronize_graph",
        "stages.poses.agreement:resolve_pairs",
        "stages.poses.refinement:refine_rotations",
        "dense.refine:refine_pose",
        "stages.poses.placement:common_labels",
        "stages.poses.agreement:match_at",
    ),
    "outputs": (
        "output.write:save_collection",
        "output.contact_sheet:ContactSheet.write",
        "output.evidence.gather:view_collection",
        "output.evidence.display_mesh:display_mesh",
        "output.evidence.evidence_file:save_view",
        "output.report.page:Page.write",
        "io.shapes:write_mesh",
    ),
}


class Clock:
    """Processor seconds and calls of a function, counted where it is not already running."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.seconds, self.num_calls, self._depth = 0.0, 0, 0

        @functools.wraps(function)
        def timed(*arguments: Any, **options: Any) -> Any:
            self.num_calls += 1
            self._depth += 1
            start = time.process_time()
            try:
                return function(*arguments, **options)
            finally:
                self._depth -= 1
                self.seconds += (time.process_time() - start) * (self._depth == 0)

        self.timed = timed


def our_modules() -> dict[str, Any]:
    """Import every module of the three packages: ours by name without the package."""
    found = {}
    for package in (data_tools, pairwise, collalign):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if "__main__" not in info.name and not info.name.endswith(("dask", "window")):
                found[info.name.partition(".")[2]] = importlib.import_module(info.name)
    return found


def find(kernel: str, modules: dict[str, Any]) -> tuple[Any, str]:
    """Return the module or class that holds a function, and its name there."""
    place, _, name = kernel.partition(":")
    owner, _, method = name.rpartition(".")
    return getattr(modules[place], owner) if owner else modules[place], method


def install(kernel: str, modules: dict[str, Any]) -> Clock:
    """Put a clock around a function, wherever it has been imported to."""
    holder, method = find(kernel, modules)
    function = getattr(holder, method)
    clock = Clock(function)
    for home in [holder, *modules.values()]:
        for attribute in [a for a, value in vars(home).items() if value is function]:
            setattr(home, attribute, clock.timed)
    return clock


@contextmanager
def shapes_of(name: str, num: int | None) -> Iterator[Path]:
    """Give a folder with the first shapes of a collection."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "shapes"
        if name == "generated":
            generate(num or NUM_GENERATED, folder, 0)
        else:
            folder.mkdir()
            for file in sorted(FOLDERS[name].iterdir(), key=lambda path: natural_key(path.name))[:num]:
                shutil.copy(file, folder)
        yield folder


def align_and_save(folder: Path) -> collalign.AlignedCollection:
    run = collalign.RunOptions(jobs=1, store=folder.parent / "store.sqlite")
    collection = collalign.align_collection(folder, run=run)
    collection.save(folder.parent / "out")
    return collection


def measure(name: str, num: int | None, clocks: dict[str, list[tuple[str, Clock]]]) -> None:
    """Align one collection and print its table."""
    for clock in (clock for stage in clocks.values() for _, clock in stage):
        clock.seconds, clock.num_calls = 0.0, 0
    with shapes_of(name, num) as folder:
        start = time.process_time()
        collection = align_and_save(folder)
        total = time.process_time() - start
    print(f"\n{name}: {len(collection.names)} shapes, {len(collection.pairs)} pairs, {total:.1f} s")
    for stage, kernels in clocks.items():
        print(f"  {stage}")
        for kernel, clock in kernels:
            share = f"{clock.seconds / total:4.0%}"
            print(f"    {kernel:48} {clock.seconds:8.2f} s {share} {clock.num_calls:8} calls", flush=True)


def measure_deep(name: str, num: int | None) -> None:
    """Align one collection and print what cost most by itself."""
    with shapes_of(name, num) as folder:
        profile = cProfile.Profile(time.process_time)
        profile.runcall(align_and_save, folder)
    print(f"\n{name}")
    pstats.Stats(profile, stream=sys.stdout).sort_stats("tottime").print_stats(40)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=[*FOLDERS, "generated"])
    parser.add_argument("--num", type=int)
    parser.add_argument("--deep", action="store_true")
    arguments = parser.parse_args()
    jobs_run.Limits = lambda **ignored: Limits()  # type: ignore[assignment,misc]  # no limits: no worker processes
    if arguments.deep:
        for name in arguments.names:
            measure_deep(name, arguments.num)
        return
    modules = our_modules()
    clocks = {stage: [(kernel, install(kernel, modules)) for kernel in kernels] for stage, kernels in KERNELS.items()}
    for name in arguments.names:
        measure(name, arguments.num, clocks)


if __name__ == "__main__":
    main()
