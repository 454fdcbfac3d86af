"""Time of reading and preprocessing by step: ``python -m tests.benchmarks.bench_preprocessing [FOLDER OR FILE ...]``.

Without arguments, generated shapes of several sizes. Prints each step's processor time, its share of the total, and
the total per thousand vertices.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.embedding import sample_shape
from data_tools.embedding.invariants import NUM_SPECTRUM
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.io.files import natural_key
from data_tools.io.shapes import READERS, read_shape, write_mesh
from data_tools.options import SamplingOptions

STEPS = ("read", "geodesics", "agd + seeds", "spectrum", "whole sample_shape")


def timed(step: Callable[[], object]) -> float:
    start = time.process_time()
    step()
    return time.process_time() - start


def measure(path: Path) -> tuple[int, list[float]]:
    """The number of vertices, and the seconds of each step."""
    seconds = [timed(lambda: read_shape(path))]
    shape = read_shape(path)
    options = SamplingOptions()
    surface = WorkingSurface(shape, options)
    seconds.append(timed(lambda: surface.geodesics))
    seconds.append(timed(lambda: surface.seeds(options.num_points // 2)))
    seconds.append(timed(lambda: surface.eigenfunctions(NUM_SPECTRUM)))
    seconds.append(timed(lambda: sample_shape(shape, options)))
    return len(shape.vertices), seconds


def files_of(arguments: list[Path], scratch: Path) -> Iterator[Path]:
    for path in arguments:
        inside = sorted(path.iterdir(), key=lambda p: natural_key(p.name)) if path.is_dir() else [path]
        yield from (p for p in inside if p.suffix.lower() in READERS)
    if not arguments:
        for num_vertices in (1000, 5000, 12_500, 50_000):
            shape = blob(np.random.default_rng(0), num_vertices=num_vertices)
            yield write_mesh(scratch / f"blob{num_vertices}.ply", shape)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path)
    with tempfile.TemporaryDirectory() as scratch:
        print(f"{'file':24} {'vertices':>8}  " + "  ".join(f"{step:>18}" for step in STEPS) + "   s / 1000 vertices")
        for path in files_of(parser.parse_args().paths, Path(scratch)):
            num_vertices, seconds = measure(path)
            total = seconds[0] + seconds[-1]
            cells = "  ".join(f"{s:8.2f} s ({s / total:5.0%})" for s in seconds)
            print(f"{path.name:24} {num_vertices:8}  {cells}   {1000 * total / num_vertices:.3f}", flush=True)


if __name__ == "__main__":
    main()
