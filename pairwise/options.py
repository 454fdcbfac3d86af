"""Options of :func:`pairwise.match`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np

from data_tools.checks import check_count, check_kinds, check_number

Strategy = Literal["search", "relaxation", "portfolio"]
Solver = Literal["built-in", "clarabel", "scs"]
#: The solver that needs no other package.
BUILT_IN: Literal["built-in"] = "built-in"


@dataclass(frozen=True, kw_only=True)
class PairOptions:
    """How pairs are matched, in addition to what is set for all of them together.

    Parameters
    ----------
    strategy : {"search", "relaxation", "portfolio"}
        `search` tries rotations, `relaxation` rounds PM-SDP, `portfolio` searches, and solves the relaxation as well
        where the rotation block has more than seven dimensions, of which no search finds enough.
    row_sums : bool
        Use the equations of target points that are always matched in the relaxation; without them it is PM-SDP as
        published, looser and faster.
    solver : {"built-in", "clarabel", "scs"}
        What solves the relaxation: the interior-point method of this package, or Clarabel or SCS through CVXPY, which
        are slower and need ``pip install 'collalign[cvxpy]'``.
    time_limit_s : float, optional
        Seconds for search and relaxation of one pair, and for a proof of :func:`pairwise.match`; none by default. The
        search itself takes a second or two at most and is not stopped.
    num_draws : int
        Poses drawn from the solution of the relaxation.
    max_candidates : int
        Distinct poses kept per pair; with reflections, per chirality.
    candidate_factor : float
        Keep poses whose energy is at most this many times the best one.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    strategy: Strategy = "portfolio"
    row_sums: bool = True
    solver: Solver = BUILT_IN
    time_limit_s: float | None = None
    num_draws: int = 64
    max_candidates: int = 8
    candidate_factor: float = 2.0

    def __post_init__(self) -> None:
        check_kinds(self)
        check_count("num_draws", self.num_draws, lower=0)
        check_count("max_candidates", self.max_candidates, lower=1)
        if self.candidate_factor != np.inf:
            check_number("candidate_factor", self.candidate_factor, lower=1.0)
        if self.time_limit_s not in (None, np.inf):
            check_number("time_limit_s", self.time_limit_s, positive=True)


class PairKeywords(TypedDict, total=False):
    """The fields of :class:`PairOptions` as keywords."""

    strategy: Strategy
    row_sums: bool
    solver: Solver
    time_limit_s: float | None
    num_draws: int
    max_candidates: int
    candidate_factor: float


@dataclass(frozen=True, kw_only=True)
class MatchOptions(PairOptions):
    """How a pair is matched by itself: the options of :class:`PairOptions`, and these.

    Parameters
    ----------
    certify : bool
        Try to prove that no better pose exists.
    seed : int
        Seed of the random draws.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    certify: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_count("seed", self.seed, lower=0)
