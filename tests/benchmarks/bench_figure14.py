"""Figure 14 of Maron et al. 2016: time against d, against n, and against the full lifted relaxation.

``python -m tests.benchmarks.bench_figure14 --out FOLDER [--panels abc] [--quick]`` prints the times and writes
figure14.png. Settings of the paper: R 5-diagonal and 30 % candidates per point; (a) k = 50, n = 100, d = 3 to 20;
(b) d = 10, n = 2k up to 100; (c) d = 10, k = n = 5 to 25.

The paper's own curves are known here at these points only: 30 to 35 minutes at d = 17 in the setting of (a) (its
section 6.1, Mosek), and that its full relaxation stops at 17 points in (c).
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pairwise.full_lifted import solve_full_lifted
from pairwise.problem import Problem
from pairwise.solve import solve_pm_sdp
from tests.benchmarks.bench_relaxation import uniform

#: (d, seconds) of the paper in the setting of panel (a).
PAPER_A = [(17, 30 * 60.0), (17, 35 * 60.0)]

#: The largest number of points of the paper's full relaxation in panel (c).
PAPER_FULL_LIMIT = 17

Curve = list[tuple[int, float]]


def banded(num_target: int, num_source: int, dim: int) -> Problem:
    num = max(2, round(0.3 * num_target))
    return uniform(num_target, num_source, dim, num_candidates=num, rotation_pattern=2, group="O")


def seconds(problem: Problem) -> float:
    started = time.process_time()
    solve_pm_sdp(problem, tol=1e-3)
    return time.process_time() - started


def full_seconds(problem: Problem, limit_s: float) -> float:
    """Time of the full lifted relaxation, infinite beyond the limit."""
    started = time.process_time()
    solve_full_lifted(problem, time_limit_s=limit_s)
    spent = time.process_time() - started
    return spent if spent < limit_s else np.inf


def curve(name: str, sizes: list[int], measure) -> Curve:
    points: Curve = []
    for size in sizes:
        spent = measure(size)
        print(f"{name} {size:3d}: {spent:.3f} s", flush=True)
        if not np.isfinite(spent):
            break
        points.append((size, spent))
    return points


def panels(names: str, quick: bool, full_limit_s: float) -> dict[str, dict[str, Curve]]:
    result: dict[str, dict[str, Curve]] = {}
    if "a" in names:
        sizes = [3, 5, 8] if quick else [3, 5, 8, 11, 14, 17, 20]
        result["a"] = {"dual solver": curve("(a) d =", sizes, lambda d: seconds(banded(100, 50, d)))}
    if "b" in names:
        sizes = [20, 40] if quick else [20, 40, 60, 80, 100]
        result["b"] = {"dual solver": curve("(b) n =", sizes, lambda n: seconds(banded(n, n // 2, 10)))}
    if "c" in names:
        sizes = [5, 7] if quick else [5, 9, 13, 17, 21, 25]
        result["c"] = {
            "PM-SDP, dual solver": curve("(c) PM-SDP n =", sizes, lambda n: seconds(banded(n, n, 10))),
            "full lifted, CVXPY": curve(
                "(c) full n =", sizes, lambda n: full_seconds(banded(n, n, 10), full_limit_s)
            ),
        }
    return result


def plot(results: dict[str, dict[str, Curve]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, all_axes = plt.subplots(1, len(results), figsize=(4.5 * len(results), 3.8), squeeze=False)
    labels = {"a": "d  (k = 50, n = 100)", "b": "n  (k = n / 2, d = 10)", "c": "n = k  (d = 10)"}
    for axes, (panel, curves) in zip(all_axes[0], results.items(), strict=True):
        for name, points in curves.items():
            axes.semilogy(*np.array(points or [(np.nan, np.nan)]).T, "o-", label=name)
        if panel == "a":
            axes.semilogy(*np.array(PAPER_A).T, "x", label="paper, Mosek (published: 30-35 min)")
        if panel == "c":
            axes.axvline(PAPER_FULL_LIMIT, linestyle=":", label="paper: full relaxation stops")
        axes.set_xlabel(labels[panel])
        axes.set_ylabel("seconds, one thread")
        axes.set_title(f"({panel})")
        axes.legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for figure14.png")
    parser.add_argument("--panels", default="abc")
    parser.add_argument("--quick", action="store_true", help="the smallest sizes only")
    parser.add_argument("--full-limit", type=float, default=120.0, help="seconds for one full relaxation")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    results = panels(arguments.panels, arguments.quick, arguments.full_limit)
    plot(results, arguments.out / "figure14.png")


if __name__ == "__main__":
    main()
