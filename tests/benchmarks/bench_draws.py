"""What each way of drawing finds above three dimensions: `python -m tests.benchmarks.bench_draws draws`.

Pairs of SHREC07 or SCAPE shapes by their Laplace-Beltrami coordinates (Rustamov 2007): positions and four
eigenfunctions with O(4) free (d = 7), and eigenfunctions alone with a diagonal or banded R. Each way ends in local
minimisation. A way has found the best when its energy is the least of all ways. Times are processor time; a way that
rounds the relaxation includes its solution.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from experiments.datasets import Dataset, read_registered_archive, read_shrec07_class
from pairwise import MatchOptions
from pairwise.local.local_search import minimise
from pairwise.local.rotation_sets import random_rotations, sign_rotations
from pairwise.pm_sdp.rounding import appendix_starts, draw_rotations, extreme_starts
from pairwise.portfolio import relax
from pairwise.problem.problem import Problem
from pairwise.results import RelaxationResult
from tests.problems import search

CLASSES = ("glasses", "ant", "chair", "teddy")
#: Name, number of eigenfunctions, half-width of the band; None for positions and eigenfunctions with a free block.
FORMS = {
    "d7": (4, None),
    "diagonal10": (10, 0),
    "diagonal17": (17, 0),
    "banded10": (10, 1),
    "banded17": (17, 1),
}
NUM_STARTS = 64


def read_collection(data: Path, name: str) -> Dataset:
    """A SHREC07 class by name, or ``scape``."""
    if name == "scape":
        return read_registered_archive(data / "scape71")
    return read_shrec07_class(data / "shrec07_dev" / name)


def problems(
    data: Path, name: str, num_points: int, num_shapes: int, num_pairs: int, seed: int
) -> Iterator[dict[str, Problem]]:
    """The problems of each form, for pairs drawn by the seed; positions are turned at random."""
    dataset = read_collection(data, name)
    rng = np.random.default_rng(seed)
    chosen = np.sort(rng.permutation(len(dataset))[:num_shapes])
    sampling = SamplingOptions(num_points=num_points, num_dense_points=0)
    most = max(num for num, _ in FORMS.values())
    embedding = EmbeddingOptions(kind="xyz+lb", num_eigenfunctions=most)
    coordinates = [sample_shape(dataset.shape(int(i)), sampling, embedding).coordinates for i in chosen]
    pairs = list(itertools.combinations(range(len(chosen)), 2))
    for position in np.sort(rng.permutation(len(pairs))[:num_pairs]):
        target, source = (coordinates[i].copy() for i in pairs[position])
        source[:, :3] = source[:, :3] @ random_rotation(rng).T
        yield {form: problem_of(form, target, source) for form in FORMS}


def problem_of(form: str, target: FloatArray, source: FloatArray) -> Problem:
    """One pair in one form, from positions and all eigenfunctions."""
    num, band = FORMS[form]
    if band is None:
        used = slice(0, 3 + num)
        return Problem.from_user(target[:, used], source[:, used], rotation_pattern=(3, num))
    used = slice(3, 3 + num)
    return Problem.from_user(target[:, used], source[:, used], rotation_pattern=band, group="O")


def ways(num_extreme: int) -> dict[str, Callable[[Problem, RelaxationResult, np.random.Generator], FloatArray]]:
    """Starts of each way, as matrices to project."""
    return {
        "random": lambda p, _, rng: random_rotations(p.dim, NUM_STARTS, rng),
        "signs": lambda p, _, rng: both_signs(p, int(rng.integers(2**31))),
        "appendix": lambda p, r, _: appendix_starts(p, r),
        "draws (R, C)": lambda p, r, rng: draw_rotations(p, r, NUM_STARTS, rng),
        "extreme": lambda p, r, rng: extreme_starts(p, r, num_extreme, rng),
    }


def both_signs(problem: Problem, seed: int) -> FloatArray:
    """Random diagonal sign matrices, half of each determinant."""
    signs = sign_rotations(problem.dim, NUM_STARTS // 2, seed=seed)
    mirrored = signs.copy()
    mirrored[:, 0, 0] *= -1.0
    return np.concatenate([signs, mirrored])


def run_draws(options: argparse.Namespace) -> None:
    """Print how often each way finds the best energy, how often it alone does, and its time."""
    energies: dict[str, list[list[float]]] = {form: [] for form in FORMS}
    seconds: dict[str, list[list[float]]] = {form: [] for form in FORMS}
    names = [*ways(options.extreme), "search"]
    for name in options.collections:
        sizes = (options.points, options.shapes, options.pairs, options.seed)
        for number, forms in enumerate(problems(options.data, name, *sizes)):
            for form in options.forms:
                row, times = measured(forms[form], options.extreme, np.random.default_rng([options.seed, number]))
                energies[form].append(row)
                seconds[form].append(times)
    for form in options.forms:
        found = np.array(energies[form])
        hit = found <= found.min(axis=1, keepdims=True) * (1 + 1e-6)
        alone = hit & (hit.sum(axis=1, keepdims=True) == 1)
        print(f"{form}: {len(found)} pairs, {options.points} points")
        for way, h, a, s in zip(
            names, hit.mean(axis=0), alone.mean(axis=0), np.mean(seconds[form], axis=0), strict=True
        ):
            print(f"  {way:14s} best {100 * h:5.1f} %, alone {100 * a:5.1f} %, {1e3 * s:7.1f} ms", flush=True)


def measured(problem: Problem, num_extreme: int, rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """The least energy and the time of each way."""
    begin = time.process_time()
    relaxation = relax(problem, MatchOptions())
    relaxed = time.process_time() - begin
    energies, times = [], []
    for way, starts_of in ways(num_extreme).items():
        begin = time.process_time()
        starts = problem.pattern.project(starts_of(problem, relaxation, rng))
        energies.append(float(minimise(problem, starts).energies[0]))
        solved = 0.0 if way in ("random", "signs") else relaxed
        times.append(time.process_time() - begin + solved)
    begin = time.process_time()
    energies.append(float(search(problem).energies[0]))
    times.append(time.process_time() - begin)
    return energies, times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("draws",))
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / ".." / "shared" / "data")
    parser.add_argument("--collections", nargs="+", default=[*CLASSES, "scape"])
    parser.add_argument("--forms", nargs="+", default=list(FORMS), choices=list(FORMS))
    parser.add_argument("--points", type=int, default=30)
    parser.add_argument("--shapes", type=int, default=6)
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--extreme", type=int, default=4, help="extreme points drawn per pair")
    parser.add_argument("--seed", type=int, default=0)
    run_draws(parser.parse_args())


if __name__ == "__main__":
    main()
