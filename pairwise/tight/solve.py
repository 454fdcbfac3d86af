"""The tight relaxation of Procrustes matching over rotations, and its cheaper quaternion form.

PM-SDP couples the points only through R and its second moments. Here every match (i, j) carries its own lifted
rotation M_ij, "M = E[z z^T] times the event that j goes to i":

    minimise    sum_ij <W_ij, M_ij>            W_ij: the matrix of w_j |R p_j - q_i|^2 + c_ij
    subject to  M_ij PSD and with every quadratic identity of SO(d), likewise M, with M_00 = 1
                sum_i M_ij = M,  sum_j M_ij = M (k = n)  or  M - sum_j M_ij of the same kind (k < n)

The quaternion form has 4 x 4 blocks without identities. ``docs/tight_relaxation.md`` says what is proven about both.
"""

from __future__ import annotations

import math
import time

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.errors import OptionsError
from data_tools.threads import one_blas_thread
from pairwise.problem.problem import Problem
from pairwise.results import RelaxationResult
from pairwise.status import Status
from pairwise.tight.certify import make_certificate
from pairwise.tight.lift import make_lift
from pairwise.tight.problem import chiralities, mirror
from pairwise.tight.run import TightRun


@one_blas_thread()
def solve_tight(
    problem: Problem,
    *,
    form: str = "tight",
    tol: float = 1e-4,
    max_iterations: int = 3000,
    time_limit_s: float | None = None,
    eliminate: bool = True,
) -> RelaxationResult:
    """Solve the tight relaxation over SO(2), SO(3), or O(2), O(3) as the lower of the two chiralities.

    Parameters
    ----------
    problem : Problem
        Points in dimension 2 or 3 and a full R; k <= n, allowed matches, weights and constant costs as you like.
    form : {"tight", "quaternion"}
        10 x 10 blocks (3 x 3 for d = 2), or the cheaper and weaker 4 x 4 (2 x 2) ones.
    tol : float
        Relative gap between value and bound at which to stop.
    max_iterations : int
        Most steps of the splitting per chirality.
    time_limit_s : float, optional
        Stop at the next look at the bound after this time.
    eliminate : bool
        Drop matches that provably belong to no optimal solution: faster, and the bound may then exceed the plain
        relaxation's value. ``False`` solves the plain relaxation.

    Returns
    -------
    RelaxationResult
        ``lower_bound`` is proven by ``certificate``. ``moments`` is E[(1, [R]) (1, [R])^T], (10, 10) for d = 3 and
        (5, 5) for d = 2; the quaternion form determines R only, and there it is that of the spectral measure of its
        4 x 4 block, one measure with that R. Over O(d) the primal arrays are those of the chirality with the lower
        value, on a tie with the better pose. The dual residual is 0 because every multiplier gives a feasible dual
        point.

    Raises
    ------
    OptionsError
        If the form is unknown, a tolerance or limit is not positive, or the problem is of another kind.
    """
    runs = run_tight(
        problem, form=form, tol=tol, max_iterations=max_iterations, time_limit_s=time_limit_s, eliminate=eliminate
    )
    return _result(problem, form, runs)


def run_tight(
    problem: Problem,
    *,
    form: str,
    tol: float,
    max_iterations: int,
    time_limit_s: float | None,
    eliminate: bool,
) -> list[tuple[bool, TightRun]]:
    """Solve every chirality that the group allows, ``(reflected, run)``, the one with the better pose first.

    The other one stops once its bound exceeds that pose's energy.
    """
    for name, number in (("tol", tol), ("max_iterations", max_iterations), ("time_limit_s", time_limit_s or 1.0)):
        if not number > 0:
            raise OptionsError(f"{name}: expected a positive number, got {number}")
    started = time.monotonic()
    lift = make_lift(form, problem.dim)
    runs = [
        (reflected, TightRun(problem=part, lift=lift, tol=tol, eliminate=eliminate))
        for reflected, part in chiralities(problem)
    ]
    runs.sort(key=lambda item: item[1].upper)
    limit = math.inf if time_limit_s is None else time_limit_s
    for number, (_, run) in enumerate(runs, start=1):
        run.cutoff = math.inf if number == 1 else runs[0][1].upper
        run.solve(max_iterations, started + limit * number / len(runs))
    return runs


def _result(problem: Problem, form: str, runs: list[tuple[bool, TightRun]]) -> RelaxationResult:
    is_lower = runs[-1][1].value < runs[0][1].value - runs[0][1].gap_tol
    reflected, run = runs[-1 if is_lower else 0]
    signs = mirror(problem.dim) if reflected else np.ones(problem.dim)
    columns = np.repeat(signs, problem.dim)
    moments = run.lift.full_moments(run.mean_block())
    moments *= np.outer(np.append(1.0, columns), np.append(1.0, columns))
    x, b = _matches(run)
    bound = max(min(part.bound for _, part in runs), 0.0)
    statuses = [part.status for _, part in runs]
    return RelaxationResult(
        value=min(part.value for _, part in runs),
        lower_bound=bound,
        R=read_only(run.lift.mean_rotations(run.mean_block()) * signs),
        X=read_only(x),
        C=read_only(moments[1:, 1:].copy()),
        B=read_only(b * columns[:, None]),
        status=next((s for s in statuses if s is not Status.CONVERGED), Status.CONVERGED),
        iterations=sum(part.iterations for _, part in runs),
        residuals={
            "primal": 0.0 if run.is_settled else run.splitting.residual,
            "dual": 0.0,
            "gap": abs(run.value - run.bound) / max(run.upper, 1e-3 * run.scale),
        },
        times_s={"setup": sum(part.setup_s for _, part in runs), "solve": sum(part.solve_s for _, part in runs)},
        certificate=make_certificate(problem, form, [(mirrored, part.proof) for mirrored, part in runs], bound),
        moments=read_only(moments),
    )


def _matches(run: TightRun) -> tuple[FloatArray, FloatArray]:
    """Return X (n, k) and B (k, d * d, n), ``B[j, :, i] = X_ij E[[R] | j -> i]``."""
    n, k = run.problem.num_target, run.problem.num_source
    if run.is_settled:
        rows, cols = run.map, np.arange(k)
        masses, rotations = np.ones(k), np.broadcast_to(run.rotation, (k, *run.rotation.shape))
    else:
        blocks = run.splitting.blocks
        matches = blocks.cols < k
        rows, cols, x = blocks.rows[matches], blocks.cols[matches], run.splitting.x[matches]
        masses = x @ run.lift.one
        rotations = run.lift.mean_rotations((x @ run.lift.flat_basis.T).reshape(-1, run.lift.size, run.lift.size))
    probabilities = np.zeros((n, k))
    probabilities[rows, cols] = masses
    b = np.zeros((k, run.problem.dim**2, n))
    b[cols, :, rows] = np.swapaxes(rotations, -1, -2).reshape(len(rows), -1)
    return probabilities, b
