"""Times PM-SDP's dual solver against CVXPY with SCS: ``python -m experiments.pairs.solver_times``.

Uniform points in the unit cube, noise 0.1, several problems at 20 and at 30 points, one thread, CPU time of
this process (so that other users of the machine count less). The dual's is the least time of three; SCS runs at
1e-4, and the set-up of CVXPY and the certificate count. Both solve the relaxation as published, and the dual with
the row sums as well.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from experiments.figures.planted import planted_problem
from pairwise.relaxations import solve_pm_sdp

#: Gap asked for; the figures ask for values within 1e-5.
TOL = 4e-6
NUM_POINTS, NUM_SEEDS = (20, 30), 5


def seconds(solve: Callable[[], object]) -> float:
    """Return the CPU time that a call takes."""
    started = time.process_time()
    solve()
    return time.process_time() - started


def main() -> None:
    """Print a line for each size."""
    solve_pm_sdp(
        planted_problem(np.random.default_rng(0), 5, 5, 3)
    )  # imports and the look-up of thread pools
    for num in NUM_POINTS:
        ratios, times, tighter = [], [], []
        for seed in range(NUM_SEEDS):
            problem = planted_problem(np.random.default_rng(seed), num, num, 3)
            times.append(
                min(
                    seconds(partial(solve_pm_sdp, problem, row_sums=False, tol=TOL))
                    for _ in range(3)
                )
            )
            tighter.append(seconds(partial(solve_pm_sdp, problem, tol=TOL)))
            scs_s = seconds(partial(solve_pm_sdp, problem, row_sums=False, solver="scs", tol=1e-4))
            ratios.append(scs_s / times[-1])
        print(
            f"n = {num}: dual {min(times):.3f} to {max(times):.3f} s, "
            f"SCS / dual {min(ratios):.1f} to {max(ratios):.1f} over {NUM_SEEDS} problems, "
            f"dual with row sums {min(tighter):.3f} to {max(tighter):.3f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
