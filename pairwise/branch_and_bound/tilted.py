"""The least of a pair's energy less a linear function of the rotation: min over R of F(R) - <L, R>.

With ``L / 2 = sum_a s_a u_a v_a^T`` and ``p_a = g sqrt(s_a) v_a``, ``q_a = sqrt(s_a) u_a / g`` one has
``sum_a |R p_a - q_a|^2 = (g^2 + 1 / g^2) sum_a s_a - <L, R>``. So the linear term is d more points of the source,
each of which may go to one more point of the target only, and all that is known about matching problems holds:
search, quasi-bounds, certificates. The factor g makes both added sets as large as their shapes, which keeps what the
quasi-bound loses least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.prove import deadline_of, depths_of, finish, searches_of
from pairwise.local_search import MatchingCosts, energies_of, minimise
from pairwise.problem import Problem

#: Most rotations that are returned.
_MOST_ROTATIONS = 8
#: Relative rounding of the linear term and of the constant that is taken off again.
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltedProof:
    """What was found about a tilted energy F(R) - <L, R>.

    Attributes
    ----------
    lower_bound : float
        It is nowhere smaller.
    rotations : ndarray, shape (m, d, d)
        Where it is small, the least first.
    energies : ndarray, shape (m,)
        F, without the linear term, at each of them.
    depths : ndarray of int, shape (c,)
        Of the cells that prove the bound, in the order of their paths. As the cells tile, these say which cells they
        are. Empty where nothing was proven.
    num_cells : ndarray of int, shape (s,)
        How many of them are of rotations and, over O(d), how many of reflections.
    """

    lower_bound: float
    rotations: Annotated[FloatArray, Holds(shape="m d d", rotations=True)]
    energies: Annotated[FloatArray, Holds(shape="m")]
    depths: Annotated[IntArray, Holds(shape="_")]
    num_cells: Annotated[IntArray, Holds(shape="_")]


@one_blas_thread()
def prove_tilted(
    problem: Problem,
    tilt: FloatArray,
    known: FloatArray,
    *,
    gap: float,
    time_limit_s: float | None = None,
) -> TiltedProof:
    """Bound a tilted energy F(R) - <tilt, R> from below over the problem's group, or only descend to small values.

    Parameters
    ----------
    problem : Problem
        In dimension 2 or 3.
    tilt : ndarray, shape (d, d)
    known : ndarray, shape (m, d, d)
        At least one pose to descend from.
    gap : float
        How far the bound may stay below the least value found, in units of the energy; with 0 nothing is proven.
    time_limit_s : float, optional
        Stop about then; what is proven by then is returned.
    """
    tilted, offset = with_tilt(problem, tilt)
    found, bound, depths = minimise(tilted, known), -np.inf, [np.zeros(0, dtype=np.int64)]
    if gap:
        tol = min(1.0, gap / max(float(found.energies[0]), gap))
        deadline = deadline_of(tol, time_limit_s)
        searches = searches_of(tilted, found.rotations, tol)
        proof = finish(searches, deadline)
        slack = _ROUNDING * (abs(proof.lower_bound) + offset + float(np.linalg.norm(tilt)))
        bound, depths = proof.lower_bound - offset - slack, depths_of(searches)
        found = minimise(
            tilted, np.concatenate([proof.candidate.R_target_source[None], found.rotations])
        )
    rotations = found.rotations[:_MOST_ROTATIONS]
    return TiltedProof(
        lower_bound=bound,
        rotations=read_only(rotations),
        energies=read_only(least_energies(problem, rotations)),
        depths=read_only(np.concatenate(depths)),
        num_cells=read_only(np.array([len(some) for some in depths])),
    )


def with_tilt(problem: Problem, tilt: FloatArray) -> tuple[Problem, float]:
    """Return a problem with a tilted energy, less <tilt, R>, tilt (d, d), plus a constant, and the constant."""
    dim, (n, k) = problem.dim, problem.allowed.shape
    left, strengths, right = np.linalg.svd(0.5 * tilt)
    sizes = [
        np.linalg.norm(points)
        for points in (problem.weights[:, None] * problem.source, problem.target)
    ]
    factor = float(np.sqrt(sizes[0] / sizes[1])) if min(sizes) > 0.0 else 1.0
    roots = np.sqrt(strengths)[:, None]
    allowed, costs = np.zeros((n + dim, k + dim), dtype=bool), np.zeros((n + dim, k + dim))
    allowed[:n, :k], costs[:n, :k] = problem.allowed, problem.constant_cost
    allowed[n + np.arange(dim), k + np.arange(dim)] = True
    tilted = replace(
        problem,
        target=np.concatenate([problem.target, roots * left.T / factor]),
        source=np.concatenate([problem.source, roots * right * factor]),
        allowed=allowed,
        weights=np.append(problem.weights, np.ones(dim)),
        constant_cost=costs,
    )
    return tilted, float((factor**2 + factor**-2) * strengths.sum())


def least_energies(problem: Problem, rotations: FloatArray) -> FloatArray:
    """Return F, the least energy of any map, at rotations (m, d, d), shape (m,)."""
    return energies_of(problem, rotations, MatchingCosts(problem).assign(rotations))
