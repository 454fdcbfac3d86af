"""The tight relaxation and branch and bound: exactness, time against CVXPY + SCS, proven optima, teeth, validity.

    python -m tests.benchmarks.bench_tight exactness --num 100 --points 20 --noise 0.05
    python -m tests.benchmarks.bench_tight speed --num 3 --points 20 --noise 0.05
    python -m tests.benchmarks.bench_tight certified --num 5 --points 10 20 50 --noise 0 0.05 0.1 0.2
    python -m tests.benchmarks.bench_tight teeth --num 20 --points 20 --data ../shared/data/teeth_pnas116
    python -m tests.benchmarks.bench_tight validity --num 500

Problems are uniform points in the unit cube and their noisy, rotated, shuffled copy. Times are processor seconds of one thread
(set OPENBLAS_NUM_THREADS=1), so that other work on the machine hardly changes them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.datasets import read_teeth
from data_tools.sampling import farthest_points
from data_tools.shape import Shape
from pairwise.branch_and_bound import prove
from pairwise.problem import Problem
from pairwise.status import Status
from pairwise.tight_problem import energy_scale
from pairwise.tight_reference import solve_tight_reference
from pairwise.tight_solver import solve_tight
from pairwise.verify import verify_certificate
from tests.oracles import brute_force
from tests.tight_problems import planted_cube, small_problem


def timed(function: Callable[..., Any], *args: Any, **options: Any) -> tuple[Any, float]:
    """The result and the processor seconds."""
    started = time.process_time()
    return function(*args, **options), time.process_time() - started


def exactness(num: int, points: list[int], noises: list[float], limit_s: float) -> None:
    """Share of the optimum that the relaxations prove; the optimum is that of branch and bound."""
    print("points noise | problems | tight: exact to 1e-4, mean share, median s | plain tight | quaternion")
    for n in points:
        for noise in noises:
            rows = [_proven_shares(n, noise, seed, limit_s) for seed in range(num)]
            shares, times = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
            cells = [
                f"{(share >= 1 - 1e-4).mean():5.0%} {share.mean():.3f} {np.median(spent):.2f} s"
                for share, spent in zip(shares.T, times.T, strict=True)
            ]
            print(f"{n:4d} {noise:5.2f} | {num} | " + " | ".join(cells), flush=True)


def _proven_shares(n: int, noise: float, seed: int, limit_s: float) -> tuple[list[float], list[float]]:
    problem = Problem.from_user(*planted_cube(n, noise, seed))
    optimum = prove(problem, time_limit_s=60).candidate.energy
    variants = ({}, {"eliminate": False, "tol": 5e-5}, {"form": "quaternion", "eliminate": False, "tol": 1e-3})
    runs = [timed(solve_tight, problem, time_limit_s=limit_s, **variant) for variant in variants]
    return [r.lower_bound / optimum for r, _ in runs], [spent for _, spent in runs]


def speed(num: int, points: list[int], noises: list[float], limit_s: float) -> None:
    """Time of the splitting against CVXPY + SCS (eps 1e-4) on the same relaxation, CVXPY's set-up included."""
    for n in points:
        for noise in noises:
            ratios = []
            for seed in range(num):
                problem = Problem.from_user(*planted_cube(n, noise, seed))
                own, own_s = timed(solve_tight, problem, tol=1e-3)
                plain, plain_s = timed(solve_tight, problem, tol=1e-3, eliminate=False)
                (value, status), scs_s = timed(solve_tight_reference, problem, tol=1e-4, time_limit_s=limit_s)
                ratios.append(scs_s / own_s)
                print(
                    f"n {n} noise {noise} seed {seed}: {own_s:.2f} s (bound {own.lower_bound:.5f}), without dropping "
                    f"{plain_s:.2f} s ({plain.lower_bound:.5f}), SCS {scs_s:.1f} s ({value:.5f}, {status.name})",
                    flush=True,
                )
            print(f"n {n} noise {noise}: SCS takes {np.median(ratios):.0f} times as long (median)")


def certified(num: int, points: list[int], noises: list[float], limit_s: float) -> None:
    """Proven gap and time of branch and bound."""
    print("points noise | proven | largest gap | processor s median, max | cells median")
    for n in points:
        for noise in noises:
            problems = [Problem.from_user(*planted_cube(n, noise, seed)) for seed in range(num)]
            print(f"{n:4d} {noise:5.2f} | {_certify_all(problems, limit_s)}", flush=True)


def teeth(num: int, points: list[int], folder: Path, limit_s: float) -> None:
    """Pairs of teeth, Euclidean farthest points, unit scale: the relaxations' share, and branch and bound in SO and O."""
    shapes = read_teeth(folder)
    for n in points:
        rng = np.random.default_rng(0)
        pairs = [rng.choice(len(shapes), 2, replace=False) for _ in range(num)]
        clouds = {i: _samples(shapes.shape(i), n) for i in sorted({int(i) for pair in pairs for i in pair})}
        for group in ("SO", "O"):
            problems = [Problem.from_user(clouds[int(a)], clouds[int(b)], group=group) for a, b in pairs]
            print(f"teeth n {n} group {group} | {_certify_all(problems, limit_s)}", flush=True)


def _samples(shape: Shape, num: int) -> FloatArray:
    chosen = shape.vertices[farthest_points(shape, num, metric="euclidean")]
    centred = chosen - chosen.mean(axis=0)
    return centred / np.linalg.norm(centred)


def _certify_all(problems: list[Problem], limit_s: float) -> str:
    proofs = [timed(prove, problem, tol=1e-3, time_limit_s=limit_s) for problem in problems]
    proven = np.mean([proof.status is Status.PROVEN_OPTIMAL for proof, _ in proofs])
    gaps = [
        (proof.candidate.energy - proof.lower_bound) / max(proof.candidate.energy, 1e-9 * energy_scale(problem))
        for problem, (proof, _) in zip(problems, proofs, strict=True)
    ]
    times = [spent for _, spent in proofs]
    mirrors = [proof.is_chirality_proven for proof, _ in proofs]
    return (
        f"{len(problems)} problems, {proven:.0%} proven | {max(gaps):.1e} | {np.median(times):.2f} s, {max(times):.2f} s | "
        f"{int(np.median([proof.num_cells for proof, _ in proofs]))} cells | mirror decisions proven {np.mean(mirrors):.0%}"
    )


def validity(num: int) -> None:
    """No bound above the brute-force optimum, every certificate verified; random and degenerate, k = n and k < n."""
    worst = {"tight": -np.inf, "quaternion": -np.inf, "branch and bound": -np.inf}
    for seed in range(num):
        problem = small_problem(seed)
        optimum, scale = brute_force(problem).energy, energy_scale(problem)
        bounds = {"branch and bound": prove(problem, time_limit_s=20).lower_bound}
        for form in ("tight", "quaternion"):
            result = solve_tight(problem, form=form, max_iterations=400, tol=1e-3)
            bounds[form] = max(
                result.lower_bound, verify_certificate(problem.target, problem.source, result.certificate)
            )
        worst = {name: max(worst[name], (bound - optimum) / scale) for name, bound in bounds.items()}
    print(f"{num} problems; largest (bound - optimum) / scale:", {name: f"{w:.1e}" for name, w in worst.items()})


def main() -> None:
    """Run one of the measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", choices=["exactness", "speed", "certified", "teeth", "validity"])
    parser.add_argument("--num", type=int, default=5)
    parser.add_argument("--points", type=int, nargs="+", default=[20])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.1])
    parser.add_argument("--limit-s", type=float, default=60.0)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/teeth_pnas116"))
    args = parser.parse_args()
    if args.what == "validity":
        validity(args.num)
    elif args.what == "teeth":
        teeth(args.num, args.points, args.data, args.limit_s)
    else:
        {"exactness": exactness, "speed": speed, "certified": certified}[args.what](
            args.num, args.points, args.noise, args.limit_s
        )


if __name__ == "__main__":
    main()
