"""The tight relaxation and branch and bound: exactness, time against CVXPY + SCS, proven optima, teeth, validity.

    python -m tests.benchmarks.bench_tight exactness --num 100 --points 20 --noise 0.05
    python -m tests.benchmarks.bench_tight speed --num 3 --points 20 --noise 0.05
    python -m tests.benchmarks.bench_tight certified --num 5 --points 10 20 50 --noise 0 0.05 0.1 0.2
    python -m tests.benchmarks.bench_tight teeth --num 20 --points 20 --data ../shared/data/teeth_pnas116
    python -m tests.benchmarks.bench_tight validity --num 500
    python -m tests.benchmarks.bench_tight lists --num 2000

Problems are uniform points in the unit cube and their noisy, rotated, shuffled copy. Times are processor seconds of
one thread (set OPENBLAS_NUM_THREADS=1), so that other work on the machine changes them little.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.datasets.public import read_teeth
from data_tools.embedding.sampling import farthest_points
from data_tools.surface.shape import Shape
from pairwise.branch_and_bound.poses import list_poses
from pairwise.branch_and_bound.prove import prove
from pairwise.certificates.verify import verify_certificate
from pairwise.problem.problem import Problem
from pairwise.status import Status
from pairwise.tight.problem import energy_scale
from pairwise.tight.solve import solve_tight
from tests.oracles import brute_force
from tests.pairwise.branch_and_bound.test_poses import missed_poses
from tests.tight_problems import planted_cube, rigid_problem, small_problem
from tests.tight_reference import solve_tight_reference


def timed(function: Callable[..., Any], *args: Any, **options: Any) -> tuple[Any, float]:
    """The result and the processor seconds."""
    started = time.process_time()
    return function(*args, **options), time.process_time() - started


#: What ``exactness`` measures, with the options of ``solve_tight``.
VARIANTS: dict[str, dict[str, Any]] = {
    "tight": {},
    "plain": {"eliminate": False, "tol": 5e-5},
    "quaternion": {"form": "quaternion", "eliminate": False, "tol": 1e-3},
}


def exactness(num: int, points: list[int], noises: list[float], limit_s: float, variants: list[str]) -> None:
    """Share of the optimum that the relaxations prove; the optimum is that of branch and bound."""
    for n in points:
        for noise in noises:
            problems = [Problem.from_user(*planted_cube(n, noise, seed)) for seed in range(num)]
            optima = np.array([prove(problem, time_limit_s=60).candidate.energy for problem in problems])
            for name in variants:
                runs = [timed(solve_tight, problem, time_limit_s=limit_s, **VARIANTS[name]) for problem in problems]
                shares = np.array([result.lower_bound for result, _ in runs]) / optima
                times = [spent for _, spent in runs]
                print(
                    f"n {n} noise {noise} {name}: {num} problems, exact to 1e-4 {(shares >= 1 - 1e-4).mean():.0%}, "
                    f"mean share {shares.mean():.4f}, least {shares.min():.3f}, {np.median(times):.2f} s median",
                    flush=True,
                )


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
                    f"n {n} noise {noise} seed {seed}: {own_s:.2f} s (bound {own.lower_bound:.5f}), "
                    f"without dropping {plain_s:.2f} s ({plain.lower_bound:.5f}), "
                    f"SCS {scs_s:.1f} s ({value:.5f}, {status.name})",
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
    """Pairs of teeth, Euclidean farthest points, unit scale: proven gap and time, and the relaxation's share."""
    shapes = read_teeth(folder)
    for n in points:
        rng = np.random.default_rng(0)
        pairs = [rng.choice(len(shapes), 2, replace=False) for _ in range(num)]
        clouds = {i: _samples(shapes.shape(i), n) for i in sorted({int(i) for pair in pairs for i in pair})}
        for group in ("SO", "O"):
            problems = [Problem.from_user(clouds[int(a)], clouds[int(b)], group=group) for a, b in pairs]
            print(f"teeth n {n} group {group} | {_certify_all(problems, limit_s)}", flush=True)
        shares, times = [], []
        for a, b in pairs:
            problem = Problem.from_user(clouds[int(a)], clouds[int(b)])
            result, spent = timed(solve_tight, problem, tol=1e-3, eliminate=False, time_limit_s=limit_s)
            shares.append(result.lower_bound / prove(problem, time_limit_s=limit_s).candidate.energy)
            times.append(spent)
        print(
            f"teeth n {n} tight: share {np.mean(shares):.3f} mean, {min(shares):.3f} least, {np.median(times):.2f} s"
        )


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
        f"{len(problems)} problems, {proven:.0%} proven | {max(gaps):.1e}"
        f" | {np.median(times):.2f} s, {max(times):.2f} s"
        f" | {int(np.median([proof.num_cells for proof, _ in proofs]))} cells"
        f" | mirror decisions proven {np.mean(mirrors):.0%}"
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


def lists(num: int) -> None:
    """Of rigid problems of all kinds and scales: no bound above the optimum, and no pose of a list missed."""
    worst, certified, missed, unresolved = -np.inf, -np.inf, 0, 0
    for seed in range(num):
        problem = rigid_problem(seed, max_target=7)
        poses = list_poses(problem, resolution_deg=15.0, time_limit_s=1.0, record=True)
        optimum, scale = brute_force(problem).energy, energy_scale(problem)
        worst = max(worst, (poses.proof.lower_bound - optimum) / scale)
        verified = verify_certificate(problem.target, problem.source, poses.proof.certificate, problem=problem)
        certified = max(certified, (verified - optimum) / scale)
        missed += len(missed_poses(problem, poses))
        unresolved += not poses.is_resolved
        if (seed + 1) % 100 == 0:
            print(
                f"{seed + 1} problems; largest (bound - optimum) / scale {worst:.1e}, of certificates "
                f"{certified:.1e}; {missed} poses missed; {unresolved} lists not resolved within a second",
                flush=True,
            )


def main() -> None:
    """Run one of the measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", choices=["exactness", "speed", "certified", "teeth", "validity", "lists"])
    parser.add_argument("--num", type=int, default=5)
    parser.add_argument("--points", type=int, nargs="+", default=[20])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.1])
    parser.add_argument("--limit-s", type=float, default=60.0)
    parser.add_argument("--variants", nargs="+", choices=list(VARIANTS), default=["tight"])
    parser.add_argument("--data", type=Path, default=Path("../shared/data/teeth_pnas116"))
    args = parser.parse_args()
    if args.what == "validity":
        validity(args.num)
    elif args.what == "lists":
        lists(args.num)
    elif args.what == "exactness":
        exactness(args.num, args.points, args.noise, args.limit_s, args.variants)
    elif args.what == "teeth":
        teeth(args.num, args.points, args.data, args.limit_s)
    else:
        {"speed": speed, "certified": certified}[args.what](args.num, args.points, args.noise, args.limit_s)


if __name__ == "__main__":
    main()
