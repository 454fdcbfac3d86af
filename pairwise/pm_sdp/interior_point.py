"""A structured primal-dual interior-point method for PM-SDP: Mehrotra's predictor and corrector, HKM scaling.

The iterates are feasible for every conic and moment equation from the start (see :mod:`pairwise.pm_sdp.variables`),
so the difference of the two objectives is the gap; only the row sums of X and B may be violated at first. All of the
cost is in :mod:`pairwise.pm_sdp.newton`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.threads import one_blas_thread
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis
from pairwise.pm_sdp.newton import NewtonSystem
from pairwise.pm_sdp.steps import SHORTEST_STEP, aim, longest_dual, longest_primal, starting_points
from pairwise.pm_sdp.variables import Direction, DualPoint, PrimalPoint, move_dual, move_primal
from pairwise.results import Status

#: Share of the distance to the cones' boundary that every step keeps.
_LEAST_SLACK = 0.05

#: A predictor that can be taken this far is corrected by all of its second-order terms.
_FULL_CORRECTION = 0.4

#: Smallest share of the gap that a predictor is trusted to leave.
_SMALLEST_SHARE = 1e-3

#: A corrected step that can be taken this far is not corrected again.
_LONG_STEP = 0.99

#: Where a corrected step is shorter than this, one that only centres is tried as well.
_SHORT_STEP = 0.2

#: Iterations without a better point after which the method has stalled.
_PATIENCE = 8

#: Share of the constant sum_j w_j |p_j|^2 that counts as scale of the gap in addition to the value itself.
_CONSTANT_SHARE = 1e-2

#: Largest violation of a linear constraint of the scaled problem at convergence.
_VIOLATION_TOL = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class DualSolution:
    """Where the interior-point method ended, in the units of the problem.

    Attributes
    ----------
    primal, dual : PrimalPoint, DualPoint
        The last iterates.
    equation_multipliers : ndarray, shape (e,)
        y of the moment equations.
    value, dual_value : float
        Primal and dual objectives, the constant included.
    status : Status
    """

    primal: PrimalPoint
    dual: DualPoint
    equation_multipliers: FloatArray
    value: float
    dual_value: float
    status: Status


@one_blas_thread()
def solve_dual(
    data: RelaxationData,
    *,
    tol: float = 1e-6,
    max_iterations: int = 100,
    time_limit_s: float | None = None,
) -> DualSolution:
    """Solve a relaxation given as arrays.

    Parameters
    ----------
    data : RelaxationData
        With :meth:`RelaxationData.from_problem`, also with a row for points that stay unmatched.
    tol : float
        Stop when the gap is below ``tol`` times (the value plus a hundredth of ``data.constant``).
    max_iterations : int
    time_limit_s : float, optional
        No iteration is begun that would end later, going by the one before it; the first is given up in the middle.

    Returns
    -------
    DualSolution
        Whatever the status, both points are strictly inside their cones. Needs s >= 1 variables.
    """
    return _InteriorPoint(data, tol, max_iterations, time_limit_s).run()


class _InteriorPoint:
    """The loop and its bookkeeping, on the problem scaled to unit vectors."""

    def __init__(
        self, data: RelaxationData, tol: float, max_iterations: int, time_limit_s: float | None
    ) -> None:
        self.deadline = np.inf if time_limit_s is None else time.perf_counter() + time_limit_s
        self.tol, self.max_iterations = tol, max_iterations
        size = float(np.sqrt((data.vectors**2).sum(axis=2)).max(initial=0.0))
        self.scale = max(size, 1e-3 * float(np.abs(data.cost).max(initial=0.0))) or 1.0
        self.data = _scaled(data, 1.0 / self.scale)
        self.basis = MomentBasis(data.lifted.num_variables, data.lifted.equations)
        self.primal, self.dual = starting_points(self.data, self.basis)

    def run(self) -> DualSolution:
        """Iterate until converged or stopped, and return the best points met."""
        self._measure()
        best, best_error, best_iteration = self._solution(), self._error(), 0
        status = Status.ITERATION_LIMIT
        began = time.perf_counter()
        for iteration in range(1, self.max_iterations + 1):
            last_s, began = time.perf_counter() - began, time.perf_counter()
            if best_error <= 1.0 or began + last_s > self.deadline:
                status = Status.TIME_LIMIT
                break
            try:
                moved = iteration - best_iteration <= _PATIENCE and self._advance()
            except TimeoutError:
                status = Status.TIME_LIMIT
                break
            if not moved:
                status = Status.STALLED
                break
            self._measure()
            if self._error() < best_error:
                best, best_error, best_iteration = self._solution(), self._error(), iteration
        return replace(best, status=Status.CONVERGED if best_error <= 1.0 else status)

    def _measure(self) -> None:
        """Compute both objectives and the violations of the scaled problem."""
        data, primal, dual = self.data, self.primal, self.dual
        self.dual_value, self.multipliers, outside = self._dual_objective(dual)
        self.dual_value += data.constant
        self.value = self._primal_objective(primal) + data.constant
        rows = data.row_sums(primal.x) + primal.slack - 1.0
        misses = [rows, primal.x.sum(axis=1) - 1.0, primal.B.sum(axis=1) - primal.R]
        if data.tied.any():
            misses.append(data.row_sums(primal.B)[data.tied] - primal.R)
        self.violation = max(float(np.abs(miss).max()) for miss in misses)
        self.violation = max(self.violation, outside / (1.0 + float(np.abs(dual.F).max())))

    def _primal_objective(self, point: PrimalPoint | Direction) -> float:
        """Return the linear objective of a primal point or step."""
        return float((self.data.cost * point.x).sum() - 2.0 * (self.data.vectors * point.B).sum())

    def _dual_objective(self, point: DualPoint | Direction) -> tuple[float, FloatArray, float]:
        """Return the objective of a dual point or step, the multipliers y, and what lies outside their span."""
        data, basis = self.data, self.basis
        multipliers, outside = basis.split(
            basis.sum_of_points(data.lifted, point.F, point.u, point.g, point.Y)
        )
        traces = float(np.einsum("qaa->", point.Y))
        value = (
            float(point.alpha.sum() + point.beta.sum() + multipliers @ basis.constants)
            - 0.25 * traces
        )
        return value, multipliers, float(np.abs(outside).max(initial=0.0))

    def _error(self) -> float:
        """Return the gap and the violations over what is asked for: at most one at convergence."""
        reference = abs(self.value) + _CONSTANT_SHARE * abs(self.data.constant) + 1e-9
        gap = abs(self.value - self.dual_value) / reference
        return max(gap / self.tol, self.violation / _VIOLATION_TOL)

    def _advance(self) -> bool:
        """Take one predictor-corrector step; False where arithmetic allows none."""
        data, primal, dual = self.data, self.primal, self.dual
        try:
            step, sizes = self._corrected_step()
        except np.linalg.LinAlgError:
            return False
        new_primal, new_dual = (
            move_primal(data, primal, step, sizes[0]),
            move_dual(data, dual, step, sizes[1]),
        )
        if new_primal is None or new_dual is None or max(sizes) < SHORTEST_STEP:
            return False
        self.primal, self.dual = new_primal, new_dual
        return True

    def _corrected_step(self) -> tuple[Direction, tuple[float, float]]:
        """Return the predictor, corrected and centred, and how far both points may go along it."""
        system = NewtonSystem(self.data, self.basis, self.primal, self.dual, self.deadline)
        predictor = system.solve(aim(self.data, self.primal, self.dual, 0.0))
        sizes = self._sizes(predictor)
        mu = self._complementarity()
        target = mu * self._remaining_share(predictor, sizes) ** 2
        step, sizes = self._corrected(system, target, predictor, sizes)
        if min(sizes) < _LONG_STEP:
            again = self._corrected(system, target, step, sizes)
            if min(again[1]) > min(sizes):
                step, sizes = again
        if min(sizes) < _SHORT_STEP:
            centring = system.solve(aim(self.data, self.primal, self.dual, mu))
            centring_sizes = self._sizes(centring)
            if min(centring_sizes) > min(sizes):
                return centring, centring_sizes
        return step, sizes

    def _corrected(
        self, system: NewtonSystem, mu: float, former: Direction, sizes: tuple[float, float]
    ) -> tuple[Direction, tuple[float, float]]:
        """Return the step to mu with the second-order terms of a former step, and how far it may go."""
        weight = min(1.0, min(sizes) / _FULL_CORRECTION)
        step = system.solve(aim(self.data, self.primal, self.dual, mu, former, weight))
        return step, self._sizes(step)

    def _sizes(self, step: Direction) -> tuple[float, float]:
        """Return how far the primal and the dual point may go along a step."""
        primal = longest_primal(self.data, self.primal, step, _LEAST_SLACK)
        return primal, longest_dual(self.data, self.dual, step, _LEAST_SLACK)

    def _remaining_share(self, step: Direction, sizes: tuple[float, float]) -> float:
        """Return the share of the gap that is left after a step."""
        gap = self.value - self.dual_value
        change = sizes[0] * self._primal_objective(step) - sizes[1] * self._dual_objective(step)[0]
        share = 1.0 + change / gap if gap > 0.0 else 1.0
        return float(np.clip(share, _SMALLEST_SHARE, 1.0))

    def _complementarity(self) -> float:
        """Return mu: the barrier's complementarity per degree."""
        data, primal, dual = self.data, self.primal, self.dual
        total = float((primal.x * dual.s).sum() + (primal.G * dual.F).sum())
        total -= float(primal.slack @ np.where(data.equality, 0.0, dual.beta))
        total += float((primal.Y * dual.Y).sum())
        degree = data.valid.sum() + dual.u.size + (~data.equality).sum() + 4 * len(dual.Y)
        return total / float(degree)

    def _solution(self) -> DualSolution:
        return DualSolution(
            primal=self.primal,
            dual=_unscaled(self.dual, self.scale),
            equation_multipliers=self.multipliers * self.scale,
            value=self.value * self.scale,
            dual_value=self.dual_value * self.scale,
            status=Status.STALLED,
        )


def _scaled(data: RelaxationData, factor: float) -> RelaxationData:
    return replace(
        data,
        cost=data.cost * factor,
        vectors=data.vectors * factor,
        constant=data.constant * factor,
    )


def _unscaled(dual: DualPoint, scale: float) -> DualPoint:
    """Return the point in the units of the problem."""
    return DualPoint(
        alpha=dual.alpha * scale,
        beta=dual.beta * scale,
        F=dual.F * scale,
        u=dual.u * scale,
        g=dual.g * scale,
        Y=dual.Y * scale,
        factor=dual.factor * np.sqrt(scale),
        root=dual.root / np.sqrt(scale),
        inverse=dual.inverse / scale,
        w=dual.w * scale,
        mean=dual.mean,
        s=dual.s * scale,
        Y_inverse=dual.Y_inverse / scale,
    )
