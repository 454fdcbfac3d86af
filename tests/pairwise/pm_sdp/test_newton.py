"""Where Newton steps begin, how far they go and how they are formed; what they lead to is compared elsewhere."""

from dataclasses import fields

import numpy as np
import pytest

from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.interior_point import _InteriorPoint
from pairwise.pm_sdp.moment_basis import cauchy_factors
from pairwise.pm_sdp.newton import NewtonSystem
from pairwise.pm_sdp.steps import aim, longest_dual, longest_primal
from pairwise.pm_sdp.variables import Direction
from pairwise.problem import Problem

#: Points of target and source, coordinates, and options; the fourth has more matches than moments.
CASES = [
    (5, 5, 3, {}),
    (6, 4, 3, {"allowed": True}),
    (5, 4, 4, {"rotation_pattern": (3, 1), "invariants": True}),
    (17, 3, 2, {"group": "O"}),
    (6, 6, 5, {"rotation_pattern": 1, "group": "O"}),
]


def problem_of(case):
    n, k, d, given = CASES[case]
    rng = np.random.default_rng(case)
    options = dict(given)
    if options.pop("allowed", False):
        options["allowed"] = (rng.random((n, k)) < 0.6) | np.eye(n, k, dtype=bool)
    if options.pop("invariants", False):
        options["invariants"] = rng.random((n, 2)), rng.random((k, 2))
    return Problem.from_user(rng.random((n, d)), rng.random((k, d)), **options)


@pytest.fixture(params=range(len(CASES)))
def point(request):
    """A point inside all cones, some steps from the first one."""
    solver = _InteriorPoint(RelaxationData.from_problem(problem_of(request.param)), 1e-6, 100, None)
    for _ in range(3):
        solver._measure()
        assert solver._advance()
    return solver


def share_of_primal(solver, step, size):
    """Return the least share of its distance to the boundary that anything of the primal point keeps."""
    data, point = solver.data, solver.primal
    x, B = point.x + size * step.x, point.B + size * step.B
    weighted = np.where(data.valid, 1.0 / np.where(data.valid, x, 1.0), 0.0)[..., None] * B
    G = point.C + size * step.C - np.swapaxes(B, 1, 2) @ weighted
    Y = point.Y + size * data.lifted.quaternion_change(step.R)
    shares = [x[data.valid] / point.x[data.valid]]
    shares.append(
        1.0 + size * (step.slack / np.where(data.equality, 1.0, point.slack))[~data.equality]
    )
    shares += [
        np.linalg.eigvals(np.linalg.solve(*pair)).real.ravel()
        for pair in ((point.G, G), (point.Y, Y))
    ]
    return float(np.concatenate(shares).min())


def share_of_dual(solver, step, size):
    """Return the same of the dual point."""
    data, point = solver.data, solver.dual
    change = step.u[:, None] + step.g[data.index]
    F, w = point.F + size * step.F, point.w - size * np.where(data.valid[..., None], change, 0.0)
    potentials = point.alpha[:, None] + point.beta[data.index]
    potentials += size * (step.alpha[:, None] + step.beta[data.index])
    bent = (np.swapaxes(np.linalg.solve(F, np.swapaxes(w, 1, 2)), 1, 2) * w).sum(axis=2)
    shares = [((data.cost - potentials - bent) / point.s)[data.valid]]
    shares.append(
        1.0 + size * (step.beta / np.where(data.equality, 1.0, point.beta))[~data.equality]
    )
    pairs = (point.F, F), (point.Y, point.Y + size * step.Y)
    shares += [np.linalg.eigvals(np.linalg.solve(*pair)).real.ravel() for pair in pairs]
    return float(np.concatenate(shares).min())


@pytest.mark.parametrize("stretch", [0.01, 1.0, 30.0])
def test_longest_steps_keep_the_share_and_no_longer_ones_do(point, stretch):
    data, primal, dual, least = point.data, point.primal, point.dual, 0.05
    found = NewtonSystem(data, point.basis, primal, dual).solve(aim(data, primal, dual, 0.0))
    step = Direction(*(stretch * getattr(found, one.name) for one in fields(found)))
    sizes = longest_primal(data, primal, step, least), longest_dual(data, dual, step, least)
    for size, share_of in zip(sizes, (share_of_primal, share_of_dual), strict=True):
        assert share_of(point, step, size) >= least - 1e-9
        assert size == 1.0 or share_of(point, step, 1.02 * size) < least
    assert stretch != 30.0 or max(sizes) < 1.0
    assert stretch != 0.01 or min(sizes) == 1.0


def test_factors_of_cauchy_matrices_are_exact_and_short():
    values = np.logspace(-3.0, 0.0, 79)
    sizes, factor = np.sqrt(2.0 * values)[:, None], cauchy_factors(values[None])[0]
    expected = sizes * sizes.T / np.add.outer(values, values)
    np.testing.assert_allclose(sizes * (factor @ factor.T) * sizes.T, expected, atol=1e-13)
    assert factor.shape[1] < 40
