"""Options of :func:`pairwise.match`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from data_tools.checks import check_choice, check_count, check_number
from data_tools.errors import OptionsError

Strategy = Literal["search", "relaxation", "portfolio"]


@dataclass(frozen=True, kw_only=True)
class MatchOptions:
    """How a pair is matched.

    Raises
    ------
    OptionsError
        If a value is impossible, or two exclude each other.
    """

    strategy: Strategy = "portfolio"
    """`search` tries rotations, `relaxation` rounds PM-SDP, `portfolio` searches, and solves the relaxation as well
    where the rotation block has more than three dimensions, which no set of rotations covers."""
    certify: bool = False
    """Try to prove that no better pose exists."""
    time_limit_s: float | None = None
    """Seconds for the relaxation and the proof of one pair; none by default."""
    gap_tol: float = 1e-3
    """Relative gap between energy and bound at which a pose counts as proven."""
    num_draws: int = 64
    """Poses drawn from the solution of the relaxation."""
    max_candidates: int = 8
    """Distinct poses kept per pair; with reflections, per chirality."""
    candidate_factor: float = 2.0
    """Keep poses whose energy is at most this many times the best one."""
    seed: int = 0
    """Seed of the random draws."""

    def __post_init__(self) -> None:
        check_choice("strategy", self.strategy, get_args(Strategy))
        for name, least in (
            ("num_draws", 0),
            ("max_candidates", 1),
            ("seed", 0),
        ):
            check_count(name, getattr(self, name), lower=least)
        if self.candidate_factor != np.inf:
            check_number("candidate_factor", self.candidate_factor, lower=1.0)
        if not 0 < self.gap_tol < 1:
            raise OptionsError(f"gap_tol: expected a number between 0 and 1, got {self.gap_tol}")
        if self.time_limit_s is not None and not self.time_limit_s > 0:
            raise OptionsError(f"time_limit_s: expected more than 0, got {self.time_limit_s}")
