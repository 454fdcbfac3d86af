"""Measures the matcher on public collections: `python -m tests.benchmarks.bench_match {energies,table,partial} ...`.

``energies``: best energy and time of :func:`pairwise.match` against 1000 random starts with exact assignment.
``table``: share of pairs whose best pose, and whose candidates, are within 20 degrees of the landmarks' rotation.
``partial``: two-way partial matching of neighbouring range scans, against their known poses.
Every shape is put into a random pose. Times are processor time of this process.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray
from data_tools.datasets import Dataset, read_range_scans, read_shrec07_class, read_teeth
from data_tools.embedding import Samples, sample_shape
from data_tools.experiments.exhaustive import minimise_each
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from pairwise import MatchOptions
from pairwise.local_search import minimise
from pairwise.match import match_problem
from pairwise.portfolio import relax
from pairwise.problem import Problem
from pairwise.results import MatchResult
from pairwise.search import of_chirality
from pairwise.starts import random_rotations

RIGHT_DEG = 20.0
MIN_OVERLAP = 0.3
CLASSES = ("glasses", "ant", "chair", "teddy")


@dataclass(frozen=True)
class PosedPair:
    """A pair of samples, the source in a random pose, and the true rotation there."""

    problem: Problem
    truth: FloatArray

    def error_deg(self, rotation: FloatArray) -> float:
        """Degrees between a pose and the truth; 180 where the chirality is wrong."""
        return float(np.nan_to_num(rotation_angle_deg(rotation[:3, :3], self.truth), nan=180.0))


def posed_pair(
    target: Samples, source: Samples, truth: FloatArray, group: str, rng: np.random.Generator
) -> PosedPair:
    """Turn the source's positions at random; ``truth`` is the rotation before."""
    turn = random_rotation(rng)
    coordinates = source.coordinates.copy()
    coordinates[:, :3] = coordinates[:, :3] @ turn.T
    problem = Problem.from_user(
        target.coordinates,
        coordinates,
        group=group,
        rotation_pattern=target.block_sizes,
        invariants=(target.invariants, source.invariants),
    )
    return PosedPair(problem, truth @ turn.T)


def read_collection(data: Path, name: str) -> tuple[Dataset, str]:
    """A collection by name, and the group that it needs; ``teeth-left`` are the teeth of one chirality."""
    if name.startswith("teeth"):
        return read_teeth(data / "teeth_pnas116"), "SO" if name == "teeth-left" else "O"
    return read_shrec07_class(data / "shrec07_dev" / name), "SO"


def posed_pairs(
    data: Path,
    name: str,
    sampling: SamplingOptions,
    embedding: EmbeddingOptions,
    *,
    num_shapes: int,
    num_pairs: int,
    seed: int,
) -> Iterator[PosedPair]:
    """Pairs drawn by the seed among shapes drawn by the seed."""
    dataset, group = read_collection(data, name)
    rng = np.random.default_rng(seed)
    eligible = np.arange(len(dataset))
    if group == "SO" and dataset.chirality is not None:
        eligible = np.flatnonzero(dataset.chirality == 1)
    chosen = np.sort(rng.permutation(eligible)[:num_shapes])
    samples = {int(i): sample_shape(dataset.shape(int(i)), sampling, embedding) for i in chosen}
    pairs = list(itertools.combinations(samples, 2))
    for position in np.sort(rng.permutation(len(pairs))[:num_pairs]):
        i, j = pairs[position]
        yield posed_pair(samples[i], samples[j], dataset.rotation(i, j, group=group), group, rng)


def random_search(problem: Problem, num_starts: int, rng: np.random.Generator, *, merged: bool) -> float:
    """The least energy that random starts lead to, shared between the chiralities that the group has.

    ``merged`` stops runs that meet another one, as the matcher does.
    """
    chiralities = (False,) if problem.pattern.special_blocks else (False, True)
    energies = []
    for reflected in chiralities:
        part = of_chirality(problem, reflected=reflected)
        starts = np.tile(np.eye(problem.dim), (num_starts // len(chiralities), 1, 1))
        starts[:, :3, :3] = random_rotations(3, len(starts), rng)
        starts = part.pattern.project(starts)
        found = minimise(part, starts).energies if merged else minimise_each(part, starts)
        energies.append(float(found.min()))
    return min(energies)


def run_energies(options: argparse.Namespace, sampling: SamplingOptions, embedding: EmbeddingOptions) -> None:
    """Print how often the matcher is no worse than the random search, and at which share of its time."""
    for name in options.collections:
        worse = better = count = 0
        seconds = np.zeros(3)
        sizes = {"num_shapes": options.shapes, "num_pairs": options.pairs, "seed": options.seed}
        for number, pair in enumerate(posed_pairs(options.data, name, sampling, embedding, **sizes)):
            before = time.process_time()
            found = match_problem(pair.problem, MatchOptions()).energy
            between = time.process_time()
            random = random_search(pair.problem, options.starts, np.random.default_rng(number), merged=True)
            after = time.process_time()
            random_search(pair.problem, options.starts, np.random.default_rng(number), merged=False)
            seconds += (between - before, after - between, time.process_time() - after)
            worse += found > random * (1 + 1e-6)
            better += found < random * (1 - 1e-6)
            count += 1
        print(
            f"{name:8s} k {sampling.num_points:3d}: {count} pairs, no worse {100 * (1 - worse / count):.1f} %, "
            f"better {100 * better / count:.1f} %, {1e3 * seconds[0] / count:.1f} ms a pair, "
            f"{seconds[0] / seconds[2]:.3f} of the time of {options.starts} random starts each by itself, "
            f"{seconds[0] / seconds[1]:.3f} where runs that meet are merged",
            flush=True,
        )


def run_table(options: argparse.Namespace, sampling: SamplingOptions, embedding: EmbeddingOptions) -> None:
    """Print one row per collection: right pairs, coverage by the candidates, bound over energy."""
    for name in options.collections:
        errors, coverage, ratios = [], [], []
        mirrored = 0
        seconds = 0.0
        sizes = {"num_shapes": options.shapes, "num_pairs": options.pairs, "seed": options.seed}
        for number, pair in enumerate(posed_pairs(options.data, name, sampling, embedding, **sizes)):
            before = time.process_time()
            result = match_problem(pair.problem, MatchOptions())
            seconds += time.process_time() - before
            errors.append(pair.error_deg(result.R_target_source))
            mirrored += (np.linalg.det(result.R_target_source[:3, :3]) > 0) != (np.linalg.det(pair.truth) > 0)
            coverage.append(min(pair.error_deg(c.R_target_source) for c in top(result, 8)))
            if number < options.bounds:
                ratios.append(relax(pair.problem, MatchOptions()).value / result.energy)
        within = [np.mean(np.array(e) <= RIGHT_DEG) for e in (errors, coverage)]
        print(
            f"{name:8s} {embedding.kind:15s} {sampling.metric:9s} k {sampling.num_points:3d}: {len(errors)} pairs, "
            f"best right {100 * within[0]:.1f} %, among 8 candidates {100 * within[1]:.1f} %, "
            f"median {np.median(errors):.1f} deg, wrong chirality {100 * mirrored / len(errors):.1f} %, "
            f"{1e3 * seconds / len(errors):.0f} ms a pair"
            + (f", PM-SDP / energy {np.mean(ratios):.2f}" if ratios else ""),
            flush=True,
        )


def top(result: MatchResult, num: int) -> list:
    """The candidates of least energy, of either chirality."""
    return list(result.candidates[:num])


def run_partial(options: argparse.Namespace, sampling: SamplingOptions) -> None:
    """Print the rotation error of every pair of range scans that overlap, from samples and refined on dense ones.

    Points farther apart than the samples' spacing stay unmatched; the scans' scale is known, their poses are not.
    """
    dataset = read_range_scans(options.data / "stanford_bunny_scans")
    sampling = replace(sampling, metric="euclidean", normalisation="none", num_dense_points=400)
    samples = [sample_shape(dataset.shape(i), sampling, EmbeddingOptions(kind="xyz")) for i in range(len(dataset))]
    rng = np.random.default_rng(options.seed)
    found = MatchOptions(estimate_translation=True)
    for i, j in itertools.combinations(range(len(samples)), 2):
        overlap = overlap_share(dataset, samples, i, j)
        if overlap < MIN_OVERLAP:
            continue
        turn = random_rotation(rng)
        source, dense = samples[j].positions @ turn.T, samples[j].dense_positions @ turn.T
        before = time.process_time()
        result = match_problem(_open_problem(samples[i].positions, source), found)
        seconds = time.process_time() - before
        refined = minimise(
            _open_problem(samples[i].dense_positions, dense),
            result.R_target_source[None],
            freedom=found.freedom,
            shifts=result.translation[None],
        )
        truth = dataset.rotation(i, j) @ turn.T
        poses = (result.R_target_source, refined.rotations[0], *(c.R_target_source for c in result.candidates))
        errors = rotation_angle_deg(np.stack(poses), truth)
        print(
            f"{dataset.names[i]:9s} {dataset.names[j]:9s} overlap {100 * overlap:3.0f} %: {errors[0]:6.1f} deg, "
            f"refined {errors[1]:6.1f} deg, best of {len(errors) - 2} candidates {errors[2:].min():6.1f} deg, "
            f"{seconds:.1f} s",
            flush=True,
        )


def _open_problem(target: FloatArray, source: FloatArray) -> Problem:
    """Partial matching at a penalty of the squared spacing of the target's points."""
    spacing = np.median(cKDTree(target).query(target, k=2)[0][:, 1])
    return Problem.from_user(target, source, unmatched_penalty=float(spacing**2))


def overlap_share(dataset: Dataset, samples: list[Samples], i: int, j: int) -> float:
    """Share of the dense samples of both scans that have a counterpart in the other, at the known poses."""
    clouds = [
        (samples[s].dense_positions * samples[s].scale + samples[s].offset) @ dataset.rotations[s].T
        + dataset.translations[s]
        for s in (i, j)
    ]
    spacing = np.median(cKDTree(clouds[0]).query(clouds[0], k=2)[0][:, 1])
    near = [cKDTree(a).query(b)[0] <= spacing for a, b in (clouds, clouds[::-1])]
    return float(np.concatenate(near).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("energies", "table", "partial"))
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / ".." / "shared" / "data")
    parser.add_argument("--collections", nargs="+", default=["teeth", *CLASSES])
    parser.add_argument("--points", nargs="+", type=int, default=[20, 64])
    parser.add_argument("--embeddings", nargs="+", default=["xyz+invariants"])
    parser.add_argument("--metrics", nargs="+", default=["auto"])
    parser.add_argument("--shapes", type=int, default=20)
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--bounds", type=int, default=0, help="pairs whose relaxation is solved as well")
    parser.add_argument("--starts", type=int, default=1000, help="random starts of the comparison")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for kind, metric, k in itertools.product(options.embeddings, options.metrics, options.points):
        sampling = SamplingOptions(num_points=k, metric=metric, num_dense_points=0)
        if options.what == "partial":
            run_partial(options, sampling)
            continue
        run = run_energies if options.what == "energies" else run_table
        run(options, sampling, EmbeddingOptions(kind=kind))


if __name__ == "__main__":
    main()
