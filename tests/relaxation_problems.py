"""Small problems of every variant of PM-SDP, drawn by Hypothesis, and their comparison with the CVXPY reference."""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from pairwise.certificates.verify import verify_certificate
from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from tests.oracles import check_relaxation

#: Patterns of R by dimension: full, diagonal, band, blocks with the rotation block first.
PATTERNS = {
    2: [None, 0],
    3: [None, None, 0, 1, [2, 1]],
    4: [0, 1, [3, 1], [2, 2]],
    5: [0, 1, [3, 2]],
}


@dataclass(frozen=True, eq=False)
class Variant:
    """A problem and the option of the relaxation."""

    problem: Problem
    cross_products: bool
    row_sums: bool
    description: str


@st.composite
def variants(draw, max_points=7):
    """Draw the shape of a problem from Hypothesis and its numbers from a seeded generator."""
    dim = draw(st.sampled_from([2, 3, 3, 3, 4, 5]))
    pattern = draw(st.sampled_from(PATTERNS[dim]))
    group = draw(st.sampled_from(["SO", "O"]))
    num_source = draw(st.integers(1, max_points))
    num_target = draw(st.integers(num_source, max_points))
    masked, weighted, invariant, cross, tied = (draw(st.booleans()) for _ in range(5))
    noise = draw(st.sampled_from([0.05, 0.3]))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    target = rng.random((num_target, dim))
    matched = rng.permutation(num_target)[:num_source]
    source = target[matched] + noise * rng.standard_normal((num_source, dim))
    allowed = None
    if masked:
        allowed = rng.random((num_target, num_source)) < 0.5
        allowed[matched, np.arange(num_source)] = True
    problem = Problem.from_user(
        target,
        source,
        group=group,
        rotation_pattern=pattern,
        allowed=allowed,
        weights=rng.random(num_source) + 0.2 if weighted else None,
        invariants=(0.3 * rng.random((num_target, 2)), 0.3 * rng.random((num_source, 2)))
        if invariant
        else None,
    )
    words = (
        f"d={dim} {group} pattern={pattern} n={num_target} k={num_source} noise={noise} seed={seed}"
    )
    flags = (
        f" masked={masked} weighted={weighted} invariant={invariant} cross={cross} row_sums={tied}"
    )
    return Variant(problem, cross, tied, words + flags)


@dataclass(frozen=True)
class Comparison:
    """Differences over the problem's scale sum_j w_j |p_j|^2.

    ``excess`` is the built-in solver's value minus the reference's, ``gap`` its value minus its verified bound,
    ``reference_gap`` its value minus that of the reference. ``others`` says what else is wrong with the reference.
    """

    excess: float
    gap: float
    reference_gap: float = 0.0
    others: tuple[str, ...] = ()

    def faults(self, tol):
        """Return what is wrong, in words; nothing where both solvers agree."""
        faults = [*self.others]
        if abs(self.excess) > tol:
            faults.append(f"value differs from the reference's by {self.excess:.1e}")
        for bound, gap in (("bound", self.gap), ("reference's bound", self.reference_gap)):
            if not -1e-9 * (bound != "bound") <= gap <= tol:
                faults.append(f"the {bound} is {gap:.1e} below the value")
        return faults


def compare_with_reference(variant):
    """Solve a problem with the built-in solver and with Clarabel, and verify the certificates of both."""
    problem = variant.problem
    equations = {"cross_products": variant.cross_products, "row_sums": variant.row_sums}
    reference = solve_pm_sdp(problem, solver="clarabel", tol=1e-9, **equations)
    result = solve_pm_sdp(problem, **equations)
    bounds = [
        verify_certificate(problem.target, problem.source, one.certificate, problem=problem)
        for one in (result, reference)
    ]
    scale = float((problem.weights * (problem.source**2).sum(axis=1)).sum()) + 1e-6
    return Comparison(
        (result.value - reference.value) / scale,
        *((result.value - bound) / scale for bound in bounds),
        tuple(check_relaxation(problem, reference, 1e-5, row_sums=False)),
    )
