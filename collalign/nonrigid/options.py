"""Options of non-rigid matching, with the paper's settings named where there are any."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from data_tools.checks import check_choice, check_count, check_number
from data_tools.errors import OptionsError

#: How the initial matches are found; see :class:`NonrigidOptions`.
Strategy = Literal["portfolio", "paper", "fast"]
#: Which descriptor restricts the matches of each sample.
Mask = Literal["wks", "agd", "none"]
#: Which refinement ends the match.
Refinement = Literal["zoomout", "icp"]
#: Which Laplace-Beltrami operator is used.
Operator = Literal["auto", "graph"]
#: Whether the mirror image of the map is acceptable.
Orientation = Literal["preserving", "any"]


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions:
    """How one shape is prepared: eigenfunctions, samples, descriptors."""

    num_functions: int = 120
    """Laplace-Beltrami eigenfunctions computed; refinement ends with all of them."""

    num_samples: int = 100
    """Geodesic farthest points, starting at extrema of the average geodesic distance; the paper's n."""

    num_dense: int = 1000
    """Euclidean farthest points on which candidates are refined and judged."""

    max_faces: int = 50_000
    """Larger meshes are decimated for the computation; the map still covers all vertices of the file."""

    operator: Operator = "auto"
    """auto: cotangents on good meshes, the tufted Laplacian on poor ones and on point clouds; graph: the paper's
    operator for FAUST, from geodesics of the dense samples (20 nearest neighbours, Gaussian weights)."""

    def __post_init__(self) -> None:
        check_count("num_functions", self.num_functions, lower=20)
        check_count("num_samples", self.num_samples, lower=8)
        check_count("num_dense", self.num_dense, lower=2 * self.num_functions)
        check_count("max_faces", self.max_faces, lower=1000)
        check_choice("operator", self.operator, get_args(Operator))


@dataclass(frozen=True, kw_only=True)
class NonrigidOptions:
    """How two prepared shapes are matched."""

    strategy: Strategy = "portfolio"
    """portfolio: several ways to start, refined and judged by evidence other than the energy; paper: PM-SDP with a
    5-diagonal R in 17 functions, then 30, then functional-map ICP (Maron et al. 2016, section 6.1); fast: its version
    with a diagonal R in 30 functions."""

    num_source: int = 50
    """Samples of the source that are matched to all samples of the target; the paper's k."""

    mask: Mask | None = None
    """Descriptor that restricts the matches of each sample: wave kernel signature, average geodesic distance or none;
    by default agd for the strategies of the paper, wks for the portfolio."""

    mask_share: float | None = None
    """Share of the target's samples that each sample may match; 0.3 for agd and 0.15 for wks by default."""

    mask_threshold: float | None = None
    """Largest difference of descriptors instead of a share (agd in units of sqrt(area))."""

    bandwidth: int = 2
    """Half-width of the band of R in the strategy paper: 0 diagonal, 1 tridiagonal, 2 the paper's 5-diagonal."""

    refinement: Refinement | None = None
    """icp is the paper's, in 30 functions over all vertices; zoomout ends with all functions. By default icp for the
    strategies of the paper, zoomout for the portfolio."""

    use_relaxation: bool = False
    """Add roundings of PM-SDP to the portfolio: a second a pair with bandwidth 0, about a minute with 2."""

    orientation: Orientation = "preserving"
    """preserving: of symmetric candidates take one that keeps left and right, where normals tell; any: take the best
    candidate, mirrored or not."""

    num_candidates: int = 6
    """Distinct candidates that are kept and reported, the chosen one among them."""

    time_limit_s: float | None = None
    """Limit for the relaxation alone."""

    seed: int = 0
    """Of the draws from the relaxation."""

    def __post_init__(self) -> None:
        check_choice("strategy", self.strategy, get_args(Strategy))
        check_choice("orientation", self.orientation, get_args(Orientation))
        if self.mask is not None:
            check_choice("mask", self.mask, get_args(Mask))
        if self.refinement is not None:
            check_choice("refinement", self.refinement, get_args(Refinement))
        check_count("num_source", self.num_source, lower=4)
        check_count("num_candidates", self.num_candidates, lower=1)
        check_count("bandwidth", self.bandwidth, lower=0)
        check_count("seed", self.seed, lower=0)
        if self.mask_share is not None:
            check_number("mask_share", self.mask_share, upper=1.0, positive=True)
        if self.mask_threshold is not None:
            check_number("mask_threshold", self.mask_threshold, positive=True)
        if self.mask_share is not None and self.mask_threshold is not None:
            raise OptionsError("mask_share and mask_threshold exclude each other: give one of them")
        if self.time_limit_s is not None:
            check_number("time_limit_s", self.time_limit_s, positive=True)

    @property
    def is_portfolio(self) -> bool:
        """Whether the strategy is the portfolio."""
        return self.strategy == "portfolio"

    @property
    def ends_with_icp(self) -> bool:
        """Whether the last refinement is the paper's ICP."""
        return self.refinement == "icp" or (self.refinement is None and not self.is_portfolio)
