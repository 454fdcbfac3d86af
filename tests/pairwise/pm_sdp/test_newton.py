"""A Newton step against the equations that it solves: linearised by differences, not by the solver's own formulas."""

from dataclasses import fields

import numpy as np
import pytest

from pairwise.pm_sdp import newton_blocks
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.interior_point import _InteriorPoint
from pairwise.pm_sdp.moment_basis import cauchy_factors
from pairwise.pm_sdp.newton import NewtonSystem
from pairwise.pm_sdp.steps import aim, longest_dual, longest_primal
from pairwise.pm_sdp.variables import Direction, move_dual, move_primal
from pairwise.problem.problem import Problem

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


def symmetric(matrices):
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))


def complementarity(data, primal, dual):
    """Return what a central point has equal to mu, or to zero: it is linear in each of both points."""
    bent = np.swapaxes(dual.F @ np.swapaxes(primal.B, 1, 2), 1, 2) - primal.x[..., None] * dual.w
    return {
        "products": np.where(data.valid, primal.x * dual.s, 0.0),
        "slacks": np.where(data.equality, 0.0, -primal.slack * dual.beta),
        "ratio": np.where(data.valid[..., None], bent, 0.0),
    }


def along(solver, step, size):
    moved = (
        move_primal(solver.data, solver.primal, step, size),
        move_dual(solver.data, solver.dual, step, size),
    )
    assert moved[0] is not None
    assert moved[1] is not None
    return complementarity(solver.data, *moved)


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


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_step_solves_the_linearised_equations(point, share):
    data, primal, dual, basis = point.data, point.primal, point.dual, point.basis
    mu, size = share * point._complementarity(), 1e-5
    step = NewtonSystem(data, basis, primal, dual).solve(aim(data, primal, dual, mu))
    here, ahead, behind = (along(point, step, t) for t in (0.0, size, -size))
    wanted = {"products": mu * data.valid, "slacks": mu * ~data.equality, "ratio": 0.0}
    for name, value in here.items():
        slope = (ahead[name] - behind[name]) / (2.0 * size)
        np.testing.assert_allclose(
            value + slope, wanted[name], atol=1e-5 * np.abs(value).max(initial=1e-3)
        )
    targets = aim(data, primal, dual, mu)
    b = np.concatenate([np.where(data.valid, 1.0, 0.0)[..., None], dual.mean], axis=2)
    means = np.concatenate([b[..., :1], primal.mean], axis=2)
    H = np.einsum("kc,kca,kcb->kab", primal.x, means, means)
    H[:, 1:, 1:] += 0.5 * primal.G
    E, delta, moments = np.zeros_like(H), np.zeros_like(H), np.zeros(H.shape[1:])
    E[:, 1:, 1:] = dual.inverse
    delta[:, 0, 0], delta[:, 0, 1:], delta[:, 1:, 0], delta[:, 1:, 1:] = (
        -step.alpha,
        step.u,
        step.u,
        step.F,
    )
    moments[0, 1:], moments[1:, 0], moments[1:, 1:] = step.R, step.R, step.C
    left = H @ delta @ E + E @ delta @ H - np.einsum("kc,kca,kcb->kab", step.x, b, b) + moments
    shifts = np.concatenate(
        [np.zeros((*step.x.shape, 1)), step.g[data.index] @ dual.inverse], axis=2
    )
    left += 2.0 * symmetric(np.einsum("kc,kca,kcb->kab", primal.x, means, shifts))
    np.testing.assert_allclose(left, targets.moments, atol=1e-8 * np.abs(targets.moments).max())
    turned = data.lifted.quaternion_change(step.R) + symmetric(dual.Y_inverse @ step.Y @ primal.Y)
    np.testing.assert_allclose(primal.Y + turned, mu * dual.Y_inverse, atol=1e-8)


def test_a_full_step_makes_up_for_what_linear_constraints_miss(point):
    data, primal, dual, basis = point.data, point.primal, point.dual, point.basis
    step = NewtonSystem(data, basis, primal, dual).solve(aim(data, primal, dual, 0.0))
    np.testing.assert_allclose((primal.x + step.x).sum(axis=1), 1.0, atol=1e-8)
    np.testing.assert_allclose(
        data.row_sums(primal.x + step.x) + primal.slack + step.slack, 1.0, atol=1e-7
    )
    np.testing.assert_allclose(
        (primal.B + step.B).sum(axis=1), np.tile(primal.R + step.R, (len(primal.B), 1)), atol=1e-7
    )
    rows = data.row_sums(primal.B + step.B)[data.tied]
    np.testing.assert_allclose(rows, np.tile(primal.R + step.R, (len(rows), 1)), atol=1e-7)
    moments = np.block([[np.zeros((1, 1)), step.R[None]], [step.R[:, None], step.C]])
    np.testing.assert_allclose(
        np.einsum("mab,ab->m", data.lifted.equations, moments), 0.0, atol=1e-8
    )
    sums = basis.sum_of_points(
        data.lifted, dual.F + step.F, dual.u + step.u, dual.g + step.g, dual.Y + step.Y
    )
    np.testing.assert_allclose(basis.split(sums)[1], 0.0, atol=1e-6 * np.abs(dual.F).max())


def test_slacks_of_matches_change_along_a_step_as_it_says(point):
    data, dual = point.data, point.dual
    step = NewtonSystem(data, point.basis, point.primal, dual).solve(
        aim(data, point.primal, dual, 0.0)
    )
    size = 0.5 * point._sizes(step)[1]
    solved = np.linalg.solve(dual.F + size * step.F, np.swapaxes(step.bend, 1, 2))
    expected = (
        dual.s + size * step.ds - size**2 * (np.swapaxes(solved, 1, 2) * step.bend).sum(axis=2)
    )
    found = move_dual(data, dual, step, size)
    assert found is not None
    np.testing.assert_allclose(
        found.s[data.valid], expected[data.valid], atol=1e-9 * np.abs(dual.s).max()
    )


def test_terms_of_second_order_of_a_former_step_are_made_up_for(point):
    data, primal, dual = point.data, point.primal, point.dual
    plain = aim(data, primal, dual, 0.0)
    former = NewtonSystem(data, point.basis, primal, dual).solve(plain)
    corrected = aim(data, primal, dual, 0.0, former, 0.5)
    here, ahead, behind = (along(point, former, t) for t in (0.0, 1e-3, -1e-3))
    for name, value in here.items():
        bend = (ahead[name] + behind[name] - 2.0 * value) / (2.0 * 1e-3**2)
        change = np.where(np.isfinite(bend), getattr(corrected, name) - getattr(plain, name), 0.0)
        keep = bend != 0.0
        np.testing.assert_allclose(
            change[keep], -0.5 * bend[keep], atol=1e-3 * np.abs(bend).max(initial=1e-3)
        )


@pytest.mark.parametrize("case", [0, 1, 2, 3])
@pytest.mark.parametrize("crossed", [False, True])
def test_the_first_point_satisfies_the_equations_of_rotations(case, crossed):
    data = RelaxationData.from_problem(problem_of(case), cross_products=crossed)
    start = _InteriorPoint(data, 1e-6, 100, None)
    primal = start.primal
    moments = np.block([[np.ones((1, 1)), primal.R[None]], [primal.R[:, None], primal.C]])
    np.testing.assert_allclose(
        np.einsum("mab,ab->m", start.data.lifted.equations, moments), 0.0, atol=1e-9
    )
    if not crossed:  # what their equations move R by, the first steps make up for
        np.testing.assert_allclose(
            primal.B.sum(axis=1), np.tile(primal.R, (len(primal.B), 1)), atol=1e-9
        )
    np.testing.assert_allclose(primal.x.sum(axis=1), 1.0)


def test_how_many_numbers_are_formed_at_a_time_does_not_matter(point, monkeypatch):
    targets = aim(point.data, point.primal, point.dual, 0.0)
    steps = []
    for entries in (1, 2**15):
        monkeypatch.setattr(newton_blocks, "_CHUNK_ENTRIES", entries)
        steps.append(NewtonSystem(point.data, point.basis, point.primal, point.dual).solve(targets))
    np.testing.assert_allclose(steps[0].x, steps[1].x, atol=1e-9)
    np.testing.assert_allclose(steps[0].F, steps[1].F, atol=1e-9 * np.abs(steps[1].F).max())


def test_factors_of_cauchy_matrices_are_exact_and_short():
    values = np.logspace(-3.0, 0.0, 79)
    sizes, factor = np.sqrt(2.0 * values)[:, None], cauchy_factors(values[None])[0]
    expected = sizes * sizes.T / np.add.outer(values, values)
    np.testing.assert_allclose(sizes * (factor @ factor.T) * sizes.T, expected, atol=1e-13)
    assert factor.shape[1] < 40
