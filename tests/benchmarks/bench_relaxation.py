"""Times PM-SDP's dual solver against CVXPY with SCS: ``python -m tests.benchmarks.bench_relaxation [case ...]``.

Uniform points in the unit cube, noise 0.1, one thread, processor time of this process (so that other users of the
machine count less). SCS runs at 1e-4; the set-up of CVXPY is not counted. Without arguments everything but SCS at 50
points runs, which takes minutes by itself; ``growth`` also writes a plot with ``--plot``, and ``seeds`` prints both
ends of the ratio at 20 and 30 points over several problems, the dual's least time of three beside the wanted one.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from experiments.figures.planted import planted_problem
from pairwise.problem.problem import Problem
from pairwise.reference.pm_sdp import solve_reference
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import RelaxationResult

#: Gap asked for; the figures ask for values within 1e-5, and 1e-3 for the largest case.
TOL = 4e-6


#: Processor seconds wanted at (3, n).
WANTED_S = {20: 0.03, 30: 0.06}
NUM_SEEDS = 5


def uniform(num_target: int, num_source: int, dim: int, *, seed: int = 0, **options) -> Problem:
    """Noisy turned points, the same ones for a seed."""
    return planted_problem(np.random.default_rng(seed), num_target, num_source, dim, **options)


CASES: dict[str, Callable[[], Problem]] = {
    "d3-n20": lambda: uniform(20, 20, 3),
    "d3-n30": lambda: uniform(30, 30, 3),
    "d3-n50": lambda: uniform(50, 50, 3),
    "d3-n120": lambda: uniform(120, 120, 3),
    "d7-n20": lambda: uniform(20, 20, 7, rotation_pattern=[3, 4]),
    "d30-diagonal": lambda: uniform(100, 50, 30, num_candidates=30, rotation_pattern=0, group="O"),
    "d17-band": lambda: uniform(100, 50, 17, num_candidates=30, rotation_pattern=2, group="O"),
}

#: (case, reference case, factor): the case is to take less than the reference's SCS time over the factor.
FIGURES = [
    ("d3-n20", "d3-n20", 40.0),
    ("d3-n30", "d3-n30", 150.0),
    ("d3-n50", "d3-n50", 600.0),
    ("d3-n120", "d3-n20", 1.0),
    ("d7-n20", "d3-n20", 5.0),
    ("d30-diagonal", "d3-n20", 1.0),
    ("d17-band", "d3-n30", 1.0),
]


def timed(solve: Callable[[], RelaxationResult]) -> tuple[float, RelaxationResult]:
    started = time.process_time()
    result = solve()
    return time.process_time() - started, result


def dual_time(name: str) -> float:
    """Print how the dual solver did, certificate included, and return its processor time."""
    problem = CASES[name]()
    tol = 1e-3 if name == "d17-band" else TOL
    seconds, result = min(
        (timed(lambda: solve_pm_sdp(problem, tol=tol)) for _ in range(3 if "n20" in name else 1)),
        key=lambda run: run[0],
    )
    gap = (result.value - result.lower_bound) / abs(result.value)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{name:13s} dual {seconds:8.3f} s  {result.iterations:3d} iterations  value {result.value:.7f}"
        f"  certified gap {gap:.1e}  peak memory {memory:.2f} GiB  {result.status.name}",
        flush=True,
    )
    return seconds


def scs_time(name: str) -> float:
    """Print how SCS did and return its processor time."""
    problem = CASES[name]()
    seconds, result = timed(lambda: solve_reference(problem, solver="scs", tol=1e-4))
    print(f"{name:13s} SCS  {seconds:8.3f} s  value {result.value:.7f}  {result.status.name}", flush=True)
    return seconds


def accuracy() -> None:
    """Print the difference from Clarabel at 20 points."""
    problem = CASES["d3-n20"]()
    reference = solve_reference(problem, solver="clarabel", tol=1e-9).value
    value = solve_pm_sdp(problem, tol=TOL).value
    print(f"d3-n20: relative difference from Clarabel's value {abs(value - reference) / abs(reference):.1e}")


def seeds() -> None:
    """Print how the times at 20 and 30 points, and their ratios to those of SCS, differ between problems."""
    for num, wanted_s in WANTED_S.items():
        ratios, times = [], []
        for seed in range(NUM_SEEDS):
            problem = uniform(num, num, 3, seed=seed)
            dual = min(timed(lambda problem=problem: solve_pm_sdp(problem, tol=TOL))[0] for _ in range(3))
            scs = timed(lambda problem=problem: solve_reference(problem, solver="scs", tol=1e-4))[0]
            times.append(dual)
            ratios.append(scs / dual)
        reached = "reached" if max(times) <= wanted_s else "missed"
        print(
            f"n = {num}: dual {min(times):.3f} to {max(times):.3f} s (figure: {wanted_s:g} s, {reached}), "
            f"SCS / dual {min(ratios):.1f} to {max(ratios):.1f} over {NUM_SEEDS} problems",
            flush=True,
        )


def growth(plot: str | None) -> None:
    """Fit the exponent of time against n at d = 3."""
    sizes = np.array([20, 30, 50, 80, 120, 160, 200])
    times = np.array([timed(lambda n=n: solve_pm_sdp(uniform(n, n, 3), tol=TOL))[0] for n in sizes])
    exponent, offset = np.polyfit(np.log(sizes), np.log(times), 1)
    for n, seconds in zip(sizes, times, strict=True):
        print(f"growth: n = {n:3d}  {seconds:.3f} s")
    print(f"growth: exponent {exponent:.2f}")
    if plot:
        import matplotlib

        matplotlib.use("Agg")
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(figsize=(5, 4))
        axes.loglog(sizes, times, "o", label="dual solver, d = 3")
        axes.loglog(sizes, np.exp(offset) * sizes**exponent, "-", label=f"exponent {exponent:.2f}")
        axes.set_xlabel("points n = k")
        axes.set_ylabel("seconds, one thread")
        axes.legend()
        figure.tight_layout()
        figure.savefig(plot, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    choices = [*CASES, "accuracy", "growth", "seeds"]
    default = [name for name in choices if name != "d3-n50"]
    parser.add_argument("cases", nargs="*", default=default, metavar="case", help=", ".join(choices))
    parser.add_argument("--plot", help="file for the plot of the growth")
    arguments = parser.parse_args()
    solve_pm_sdp(uniform(5, 5, 3))  # imports and the look-up of thread pools
    dual = {name: dual_time(name) for name in CASES if name in arguments.cases}
    needed = [(case, base, factor) for case, base, factor in FIGURES if case in dual]
    scs = {base: scs_time(base) for base in dict.fromkeys(base for _, base, _ in needed)}
    for case, base, factor in needed:
        ratio = scs[base] / dual[case]
        verdict = "reached" if ratio >= factor else "missed"
        print(f"{case:13s} SCS at {base} / dual = {ratio:8.1f}  (figure: {factor:g}) {verdict}")
    if "accuracy" in arguments.cases:
        accuracy()
    if "growth" in arguments.cases:
        growth(arguments.plot)
    if "seeds" in arguments.cases:
        seeds()


if __name__ == "__main__":
    main()
