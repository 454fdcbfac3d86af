"""Options of :func:`pairwise.match` and of its stage on dense points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from data_tools.checks import check_choice, check_count, check_number
from data_tools.errors import OptionsError
from pairwise.local.freedom import RIGID, Freedom

Strategy = Literal["search", "relaxation", "portfolio"]
RefinementMethod = Literal["nearest", "assignment", "point-to-plane"]


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
    num_rotations: int = 0
    """Rotations that the search tries; 0 sets it by the number of points and the dimension."""
    num_draws: int = 64
    """Poses drawn from the solution of the relaxation."""
    num_extreme_draws: int = 0
    """Extreme points of the relaxation's nearly optimal set (theorem 3) that are rounded as well; each costs about as
    much as the relaxation, and they seldom find what the other draws miss."""
    max_candidates: int = 8
    """Distinct poses kept per pair; with reflections, per chirality."""
    candidate_factor: float = 2.0
    """Keep poses whose energy is at most this many times the best one."""
    candidate_angle_deg: float = 15.0
    """Poses closer than this, in degrees, count as the same."""
    estimate_scale: bool = False
    """Estimate a scale factor of the source as well; no bound is known then."""
    scale_range: tuple[float, float] = (0.5, 2.0)
    """Limits of the estimated scale."""
    estimate_translation: bool = False
    """Estimate a shift of the source as well, as partial overlap needs; with ``certify`` it is proven as well, which
    takes minutes for more than about 20 points."""
    seed: int = 0
    """Seed of the random draws."""

    @property
    def freedom(self) -> Freedom:
        """What a pose may do beside turning."""
        return Freedom(
            scale_range=self.scale_range if self.estimate_scale else None, translate=self.estimate_translation
        )

    def __post_init__(self) -> None:
        check_choice("strategy", self.strategy, get_args(Strategy))
        for name, least in (
            ("num_rotations", 0),
            ("num_draws", 0),
            ("num_extreme_draws", 0),
            ("max_candidates", 1),
            ("seed", 0),
        ):
            check_count(name, getattr(self, name), lower=least)
        if self.candidate_factor != np.inf:
            check_number("candidate_factor", self.candidate_factor, lower=1.0)
        check_number("candidate_angle_deg", self.candidate_angle_deg, upper=180.0)
        if not 0 < self.gap_tol < 1:
            raise OptionsError(f"gap_tol: expected a number between 0 and 1, got {self.gap_tol}")
        if self.time_limit_s is not None and not self.time_limit_s > 0:
            raise OptionsError(f"time_limit_s: expected more than 0, got {self.time_limit_s}")
        low, high = self.scale_range
        if not (0 < low <= 1 <= high and np.isfinite(high)):
            raise OptionsError(f"scale_range: expected limits around 1, got {self.scale_range}")
        if self.freedom != RIGID and self.strategy == "relaxation":
            raise OptionsError("estimate_scale, estimate_translation: the relaxation's bounds are for rotations only")
        if self.estimate_scale and self.certify:
            raise OptionsError("estimate_scale: no bounds are known for scales; certify without it")


@dataclass(frozen=True, kw_only=True)
class DenseOptions:
    """How the poses of a pair are refined and ranked on dense points.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    method: RefinementMethod = "nearest"
    """Each point with the nearest of the other shape, both ways; or a one-to-one assignment; or point-to-plane by
    Open3D, for surfaces with normals."""

    normal_weight: float = 0.0
    """Weight of normals beside positions. They pull bent limbs off the pose that most of the shape agrees on, so they
    are left out by default."""

    max_iterations: int = 8
    """Steps per pose. More of them settle rigid shapes to the last digit, but let bent ones drift."""

    def __post_init__(self) -> None:
        check_choice("method", self.method, get_args(RefinementMethod))
        check_number("normal_weight", self.normal_weight)
        check_count("max_iterations", self.max_iterations, lower=1)
