"""Aligns public collections from random poses and compares with the landmarks.

    python -m tests.benchmarks.bench_collection teeth --num 116
    python -m tests.benchmarks.bench_collection chair --num 10 --points 20 --embedding xyz+lb

Prints the pairs' own errors, those of the aligned collection, wrong chiralities, doubted shapes and times.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from collalign import AlignedCollection, AlignOptions, RunOptions, align_collection
from data_tools.datasets import Dataset, read_shrec07_class, read_teeth
from data_tools.experiments.posed import PosedCollection, pose_collection
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import rotation_angle_deg

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"


def read_dataset(name: str, data: Path) -> Dataset:
    return read_teeth(data / "teeth_pnas116") if name == "teeth" else read_shrec07_class(data / "shrec07_dev" / name)


def candidate_errors_deg(collection: AlignedCollection, posed: PosedCollection) -> np.ndarray:
    """Return the errors of each pair's best pose and of its best candidate, shape (E, 2); 180 if mirrored."""
    index = [posed.names.index(name) for name in collection.names]
    errors = []
    for pair in collection.pairs:
        true = posed.relative[index[pair.target], index[pair.source]]
        found = np.nan_to_num(rotation_angle_deg(pair.rotations, np.tile(true, (len(pair.rotations), 1, 1))), nan=180)
        errors.append((found[0], found.min()))
    return np.array(errors)


def report(collection: AlignedCollection, posed: PosedCollection, wall_s: float) -> None:
    own = candidate_errors_deg(collection, posed)
    print(f"{len(collection.names)} shapes, {len(own)} pairs, {wall_s:.0f} s", end=" ")
    print({stage: round(seconds, 1) for stage, seconds in collection.run.times_s.items()})
    within = np.mean(own <= 20, axis=0)
    print(f"pairs alone: median {np.median(own[:, 0]):.2f} deg, within 20 deg {within[0]:.1%}, ", end="")
    print(f"one candidate within 20 deg {within[1]:.1%}")
    errors = posed.pair_errors_deg(collection.rotations, collection.names)
    right = errors[~np.isnan(errors)]
    middle, most = np.percentile(right, [50, 90])
    print(f"collection: median {middle:.2f} deg, 90 % {most:.1f}, worst {right.max():.1f}, ", end="")
    print(f"beyond 30 deg {(right > 30).sum()} of {len(errors)}, wrong chirality {np.isnan(errors).sum()}")
    shapes = posed.shape_errors_deg(collection.rotations, collection.names)
    print(f"shapes within 10 / 20 deg: {np.mean(shapes <= 10):.1%} / {np.mean(shapes <= 20):.1%}")
    for name, error, confidence in zip(collection.names, shapes, collection.confidence, strict=True):
        if error > 20 or confidence < 0.95:
            print(f"  {name}: {error:.1f} deg, confidence {confidence:.2f}")
    for note in collection.notes:
        print(f"  note: {note}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=["teeth", "glasses", "ant", "chair", "teddy"])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--num", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--points", type=int, default=64)
    parser.add_argument("--embedding", default="xyz+invariants")
    parser.add_argument("--pairs", default="auto")
    parser.add_argument("--group", default="auto")
    parser.add_argument("--synchronization", default="robust")
    parser.add_argument("--no-refine", action="store_true")
    parser.add_argument("--jobs", type=int, default=-1)
    arguments = parser.parse_args()
    dataset = read_dataset(arguments.name, arguments.data)
    rng = np.random.default_rng(arguments.seed)
    options = AlignOptions(
        group=arguments.group,
        pairs=arguments.pairs,
        synchronization=arguments.synchronization,
        refine=not arguments.no_refine,
        sampling=SamplingOptions(num_points=arguments.points),
        embedding=EmbeddingOptions(kind=arguments.embedding),
    )
    with tempfile.TemporaryDirectory() as folder:
        posed = pose_collection(dataset, rng.permutation(len(dataset))[: arguments.num], Path(folder), rng)
        start_s = time.perf_counter()
        collection = align_collection(folder, options=options, run=RunOptions(jobs=arguments.jobs))
        report(collection, posed, time.perf_counter() - start_s)


if __name__ == "__main__":
    main()
