"""A structured primal-dual interior-point method for PM-SDP: Mehrotra's predictor and corrector, HKM scaling.

The iterates are feasible for every conic and moment equation from the start (see :mod:`pairwise.dual_points`), so the
difference of the two objectives is the gap; only the row sums of X may be violated at first. All of the cost is in
:mod:`pairwise.dual_newton`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from data_tools.arrays import BoolArray, FloatArray
from pairwise.dual_basis import MomentBasis
from pairwise.dual_newton import NewtonSystem, Targets, data_row_sums
from pairwise.dual_points import (
    Direction,
    DualPoint,
    PrimalPoint,
    dual_point,
    move_dual,
    move_primal,
    primal_point,
)
from pairwise.relaxation import RelaxationData
from pairwise.status import Status

_Point = TypeVar("_Point", PrimalPoint, DualPoint)

#: Share of the way to the boundary of the cones that a step may go.
_BOUNDARY_SHARE = 0.95

#: Factor between two trial steps.
_BACKTRACK = 0.85

#: A step shorter than this is no progress.
_SHORTEST_STEP = 1e-4


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
    iterations : int
    residuals : dict of str to float
        ``"primal"``, ``"dual"``, ``"gap"``.
    times_s : dict of str to float
        ``"setup"``, ``"solve"``.
    """

    primal: PrimalPoint
    dual: DualPoint
    equation_multipliers: FloatArray
    value: float
    dual_value: float
    status: Status
    iterations: int
    residuals: dict[str, float]
    times_s: dict[str, float]


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
        Stop when the gap is below ``tol`` times (the value plus a thousandth of the constant).
    max_iterations : int
    time_limit_s : float, optional

    Returns
    -------
    DualSolution
        Whatever the status, both points are strictly inside their cones. Needs s >= 1 variables.
    """
    with _thread_pools().limit(limits=1):
        return _InteriorPoint(data, tol, max_iterations, time_limit_s).run()


@cache
def _thread_pools() -> ThreadpoolController:
    """Look up the BLAS libraries once: that takes longer than solving a small problem."""
    return ThreadpoolController()


class _InteriorPoint:
    """The loop and its bookkeeping, on the problem scaled to unit vectors."""

    def __init__(self, data: RelaxationData, tol: float, max_iterations: int, time_limit_s: float | None) -> None:
        self.started = time.perf_counter()
        self.deadline = np.inf if time_limit_s is None else self.started + time_limit_s
        self.tol, self.max_iterations = tol, max_iterations
        size = float(np.sqrt((data.vectors**2).sum(axis=2)).max(initial=0.0))
        self.scale = max(size, 1e-3 * float(np.abs(data.cost).max(initial=0.0))) or 1.0
        self.original = data
        self.data = _scaled(data, 1.0 / self.scale)
        self.basis = MomentBasis(data.lifted.num_variables, data.lifted.equations)
        self.primal, self.dual = _start(self.data, self.basis)
        self.degree = _barrier_degree(self.data)
        self.set_up = time.perf_counter()

    def run(self) -> DualSolution:
        status, iterations = Status.ITERATION_LIMIT, 0
        for iterations in range(self.max_iterations + 1):
            measures = self._measure()
            if self._converged(measures):
                status = Status.CONVERGED
                break
            if time.perf_counter() > self.deadline:
                status = Status.TIME_LIMIT
                break
            if iterations == self.max_iterations:
                break
            if not self._advance():
                status = Status.STALLED
                break
        return self._solution(status, iterations, measures)

    def _measure(self) -> dict[str, float]:
        """Return both objectives and the violations of the scaled problem."""
        data, primal, dual = self.data, self.primal, self.dual
        total = np.zeros((self.basis.size + 1, self.basis.size + 1))
        total[1:, 1:] = dual.F.sum(axis=0)
        total[0, 1:] = dual.u.sum(axis=0)
        for Y, (_, slopes) in zip(dual.Y, data.lifted.quaternion_blocks, strict=True):
            total[0, 1:] += 0.5 * np.tensordot(slopes, Y, 2)
        packed = self.basis.pack(total)
        self.multipliers = self.basis.multipliers(packed)
        rows = data_row_sums(data, primal.x) + primal.slack - data.capacity
        violation = max(
            np.abs(rows).max(),
            np.abs(primal.x.sum(axis=1) - 1.0).max(),
            np.abs(primal.B.sum(axis=1) - primal.R).max(),
        )
        value = (data.cost * primal.x).sum() - 2.0 * (data.vectors * primal.B).sum() + data.constant
        traces = sum(np.trace(Y) for Y in dual.Y)
        dual_value = dual.alpha.sum() + data.capacity @ dual.beta - 0.25 * traces + data.constant
        dual_value += self.multipliers @ self.basis.constants
        return {
            "value": float(value),
            "dual_value": float(dual_value),
            "primal": float(violation),
            "dual": float(np.abs(self.basis.reduce(packed)).max(initial=0.0) / (1.0 + np.abs(packed).max())),
        }

    def _converged(self, measures: dict[str, float]) -> bool:
        reference = abs(measures["value"]) + 1e-3 * abs(self.data.constant) + 1e-9
        gap = abs(measures["value"] - measures["dual_value"])
        return gap <= self.tol * reference and max(measures["primal"], measures["dual"]) <= 1e-6

    def _advance(self) -> bool:
        """Take one predictor-corrector step; False where arithmetic allows none."""
        try:
            system = NewtonSystem(self.data, self.basis, self.primal, self.dual)
        except np.linalg.LinAlgError:
            return False
        mu = self._complementarity(self.primal, self.dual)
        predictor = system.solve(_targets(self.data, self.primal, self.dual, 0.0, None))
        primal, dual, sizes = self._step(predictor, 1.0)
        share = self._complementarity(primal, dual) / mu
        centring = float(np.clip(share, 1e-4, 1.0)) ** 3 if min(sizes) > 0.0 else 1.0
        corrector = system.solve(_targets(self.data, self.primal, self.dual, centring * mu, predictor))
        self.primal, self.dual, sizes = self._step(corrector, _BOUNDARY_SHARE)
        return max(sizes) > _SHORTEST_STEP

    def _step(self, step: Direction, share: float) -> tuple[PrimalPoint, DualPoint, tuple[float, float]]:
        """Move both points as far as the cones allow, times ``share``."""
        data, primal, dual = self.data, self.primal, self.dual
        open_rows = ~data.equality
        primal_size = 1.0 / max(
            share,
            float((-step.x / np.where(data.valid, primal.x, 1.0)).max()),
            _ratio(step.slack, primal.slack, open_rows),
        )
        dual_size = 1.0 / max(share, _ratio(step.beta, dual.beta, open_rows))
        new_primal, primal_size = _backtrack(lambda a: move_primal(data, primal, step, a), primal_size, share, primal)
        new_dual, dual_size = _backtrack(lambda a: move_dual(data, dual, step, a), dual_size, share, dual)
        return new_primal, new_dual, (primal_size, dual_size)

    def _complementarity(self, primal: PrimalPoint, dual: DualPoint) -> float:
        """Return mu: the barrier's complementarity per degree."""
        total = (primal.x * dual.s).sum() + (primal.G * dual.F).sum()
        total -= primal.slack @ np.where(self.data.equality, 0.0, dual.beta)
        total += sum((a * b).sum() for a, b in zip(primal.Y, dual.Y, strict=True))
        return float(total) / self.degree

    def _solution(self, status: Status, iterations: int, measures: dict[str, float]) -> DualSolution:
        value, dual_value = measures["value"] * self.scale, measures["dual_value"] * self.scale
        now = time.perf_counter()
        return DualSolution(
            primal=self.primal,
            dual=_unscaled(self.dual, self.scale),
            equation_multipliers=self.multipliers * self.scale,
            value=value,
            dual_value=dual_value,
            status=status,
            iterations=iterations,
            residuals={
                "primal": measures["primal"],
                "dual": measures["dual"],
                "gap": abs(value - dual_value) / (abs(value) + 1e-3 * abs(self.original.constant) + 1e-300),
            },
            times_s={"setup": self.set_up - self.started, "solve": now - self.set_up},
        )


def _ratio(change: FloatArray, at: FloatArray, where: BoolArray) -> float:
    """Return the fastest relative decrease."""
    if not where.any():
        return 0.0
    return float((-change[where] / at[where]).max())


def _backtrack(
    move: Callable[[float], _Point | None], size: float, share: float, current: _Point
) -> tuple[_Point, float]:
    """Shrink until the point lies inside; then keep ``share`` of the size (where convex cones stay inside)."""
    while size > _SHORTEST_STEP:
        if move(size) is not None:
            accepted = min(size * share, 1.0)
            point = move(accepted)
            return (current, 0.0) if point is None else (point, accepted)
        size *= _BACKTRACK
    return current, 0.0


def _scaled(data: RelaxationData, factor: float) -> RelaxationData:
    return replace(data, cost=data.cost * factor, vectors=data.vectors * factor, constant=data.constant * factor)


def _unscaled(dual: DualPoint, scale: float) -> DualPoint:
    """Return the point in the units of the problem; F^-1 and the conditional means stay consistent."""
    return DualPoint(
        alpha=dual.alpha * scale,
        beta=dual.beta * scale,
        F=dual.F * scale,
        u=dual.u * scale,
        Y=tuple(Y * scale for Y in dual.Y),
        factor=dual.factor * np.sqrt(scale),
        inverse=dual.inverse / scale,
        w=dual.w * scale,
        mean=dual.mean,
        s=dual.s * scale,
    )


def _barrier_degree(data: RelaxationData) -> int:
    k, s = len(data.index), data.lifted.num_variables
    return int(data.valid.sum() + k * s + (~data.equality).sum() + 4 * len(data.lifted.quaternion_blocks))


def _start(data: RelaxationData, basis: MomentBasis) -> tuple[PrimalPoint, DualPoint]:
    """Return strictly feasible points near the central path: uniform X, F a large multiple of the identity."""
    lifted = data.lifted
    k, s = len(data.index), lifted.num_variables
    x = data.valid / data.valid.sum(axis=1, keepdims=True)
    means = np.einsum("jc,jca->ja", x, data.vectors)
    u = means - means.mean(axis=0)
    spread = np.where(data.valid[..., None], data.vectors - u[:, None, :], 0.0)
    counts = np.bincount(lifted.variable[lifted.variable > 0], minlength=s + 1)[1:].astype(np.float64)
    moments = lifted.interior_moments
    size = 2.0 * max(float(np.sqrt((spread**2).sum(axis=2)).max()), 1e-3) / np.sqrt(np.diag(moments).min())
    slack = np.where(data.equality, 0.0, np.maximum(data.capacity - data_row_sums(data, x), 0.5))
    while True:
        F = np.tile(size * np.diag(counts), (k, 1, 1))
        mu = size * float((counts * np.diag(moments)).mean())
        R = means.mean(axis=0) / (size * counts)
        M = np.zeros((s + 1, s + 1))
        M[0, 0], M[0, 1:], M[1:, 0], M[1:, 1:] = 1.0, R, R, moments
        M = M + basis.unpack(basis.correction(-np.einsum("mab,ab->m", lifted.equations, M)))
        B = x[..., None] * spread / (size * counts)
        primal = primal_point(data, x, B, M[1:, 1:], M[0, 1:], slack)
        beta = -np.divide(mu, slack, out=np.zeros_like(slack), where=~data.equality)
        quad = (spread**2 / (size * counts)).sum(axis=2)
        alpha = np.where(data.valid, data.cost - beta[data.index] - quad, np.inf).min(axis=1)
        alpha = alpha - mu * data.valid.sum(axis=1)
        Y = tuple(4.0 * mu * np.eye(4) for _ in lifted.quaternion_blocks)
        dual = dual_point(data, alpha, beta, F, u, Y)
        if primal is not None and dual is not None:
            return primal, dual
        size *= 2.0


def _symmetrised(matrices: FloatArray) -> FloatArray:
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))


def _targets(
    data: RelaxationData, primal: PrimalPoint, dual: DualPoint, mu: float, predictor: Direction | None
) -> Targets:
    """Return the right hand sides that aim at mu, with second-order terms of the predictor where there is one."""
    k, s = primal.G.shape[:2]
    ratio = primal.x[..., None] * dual.w - primal.B @ dual.F
    products = np.where(data.valid, mu - primal.x * dual.s, 0.0)
    slacks = mu + primal.slack * dual.beta
    gram = mu * dual.inverse - primal.G
    quaternions = [mu * np.linalg.inv(Y) - P for Y, P in zip(dual.Y, primal.Y, strict=True)]
    if predictor is not None:
        dw = -predictor.u[:, None, :]
        ratio = ratio + predictor.x[..., None] * dw - predictor.B @ predictor.F
        bend = np.where(data.valid[..., None], dw - dual.mean @ predictor.F, 0.0)
        quad = np.einsum("jca,jca->jc", bend @ dual.inverse, bend)
        products = products + np.where(
            data.valid, primal.x * quad - predictor.x * _slack_change(data, dual, predictor), 0.0
        )
        slacks = slacks + predictor.slack * predictor.beta
        gram = gram + _second_order_gram(data, primal, dual, predictor)
        slopes = [m for _, m in data.lifted.quaternion_blocks]
        quaternions = [
            q - _symmetrised(np.linalg.inv(Y) @ dY @ np.tensordot(predictor.R, m, 1))
            for q, Y, dY, m in zip(quaternions, dual.Y, predictor.Y, slopes, strict=True)
        ]
    solved = ratio @ dual.inverse
    moments = np.zeros((k, s + 1, s + 1))
    moments[:, 0, 0] = primal.x.sum(axis=1) - 1.0
    moments[:, 0, 1:] = solved.sum(axis=1) - (primal.R - primal.B.sum(axis=1))
    moments[:, 1:, 0] = moments[:, 0, 1:]
    moments[:, 1:, 1:] = gram + 2.0 * _symmetrised(np.swapaxes(solved, 1, 2) @ primal.mean)
    return Targets(moments, products, slacks, tuple(quaternions), ratio)


def _slack_change(data: RelaxationData, dual: DualPoint, step: Direction) -> FloatArray:
    """Return the linear change of every match's slack."""
    curved = np.einsum("jca,jca->jc", dual.mean @ step.F, dual.mean)
    tilted = 2.0 * (dual.mean @ step.u[:, :, None])[..., 0]
    return curved + tilted - step.alpha[:, None] - step.beta[data.index]


def _second_order_gram(data: RelaxationData, primal: PrimalPoint, dual: DualPoint, step: Direction) -> FloatArray:
    """Return the second-order terms of ``F G = mu I`` with ``G = C - sum B B^T / x``."""
    bend = step.B - primal.mean * step.x[..., None]
    linear = np.swapaxes(step.B, 1, 2) @ primal.mean
    weighted = primal.mean * step.x[..., None]
    change = step.C - 2.0 * _symmetrised(linear) + np.swapaxes(weighted, 1, 2) @ primal.mean
    x_safe = np.where(data.valid, primal.x, 1.0)
    curvature = np.swapaxes(bend / x_safe[..., None], 1, 2) @ bend
    return curvature - _symmetrised(dual.inverse @ step.F @ change)
