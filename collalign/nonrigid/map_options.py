"""Options of non-rigid matching, and every number that the search for maps was tuned by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypedDict, get_args

from data_tools.checks import check_choice, check_count

#: Whether the mirror image of the map is acceptable.
Orientation = Literal["preserving", "any"]


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions:
    """How one shape is prepared: eigenfunctions, samples, descriptors.

    Parameters
    ----------
    num_functions : int
        Laplace-Beltrami eigenfunctions computed; refinement ends with all of them.
    num_samples : int
        Geodesic farthest points, starting at extrema of the average geodesic distance; the paper's n.
    num_dense : int
        Euclidean farthest points on which candidates are refined and judged.
    max_faces : int
        Larger meshes are decimated for the computation; vertices in between go where their neighbours do.
    """

    num_functions: int = 120
    num_samples: int = 100
    num_dense: int = 1000
    max_faces: int = 12_000

    def __post_init__(self) -> None:
        check_count("num_functions", self.num_functions, lower=20)
        check_count("num_samples", self.num_samples, lower=8)
        check_count(
            "num_dense, at least twice num_functions", self.num_dense, lower=2 * self.num_functions
        )
        check_count("max_faces", self.max_faces, lower=1000)


@dataclass(frozen=True, kw_only=True)
class NonrigidOptions:
    """How two prepared shapes are matched.

    Parameters
    ----------
    orientation : {"preserving", "any"}
        preserving: of symmetric candidates take one that keeps left and right, where normals tell; any: take the best
        candidate, mirrored or not.
    num_candidates : int
        Distinct candidates that are kept and reported, the chosen one among them.
    """

    orientation: Orientation = "preserving"
    num_candidates: int = 6

    def __post_init__(self) -> None:
        check_choice("orientation", self.orientation, get_args(Orientation))
        check_count("num_candidates", self.num_candidates, lower=1)


class NonrigidKeywords(TypedDict, total=False):
    """The fields of :class:`NonrigidOptions` as keywords."""

    orientation: Orientation
    num_candidates: int


class MapTuning(NamedTuple):
    """Numbers of the portfolio: what starts a map, what is screened, and what is one map.

    Chosen while looking at SCAPE, the classes of SHREC07, and some pairs of TOSCA's centaur.
    """

    num_source: int = 50
    """Samples of the source that are matched to all samples of the target where a search starts."""
    wave_share: float = 0.15
    """Share of the target's samples that each source sample may match, by the wave kernel signature."""
    num_signs: int = 8
    """Functions whose signs are enumerated: 2^8 combinations."""
    descent_sizes: tuple[int, ...] = (12, 17)
    """Functions in which the maps that the signs give are improved, one after the other."""
    num_kept: int = 96
    """Maps that go from one descent to the next."""
    same_start: float = 1.0
    """Starts closer than this (Frobenius norm) are one ..."""
    num_start_compared: int = 8
    """... in so many of the lowest functions."""
    num_screened: int = 12
    """Distinct starts that are refined on few samples, ..."""
    num_screen_samples: int = 400
    """... so few, ..."""
    screen_last: int = 60
    """... up to this number of functions."""
    same_map: float = 1.2
    """Refined maps closer than this are one: front and back differ in few of the lowest functions, ..."""
    num_compared: int = 20
    """... which so many are."""
    num_posed: int = 6
    """Candidates from poses, and of those that are smooth from the start, that are refined with all samples."""
    tip_side_weight: float = 0.3
    """Weight of the sides of limbs relative to closeness to tips; the shares of either sum to one."""
    num_tipped: int = 10
    """Candidates that matched tips start, of 32 matches, that are refined with all samples."""
    posed_handicap: float = 0.7
    """How much better the score of maps that only poses lead to must be than that of maps from within: chosen on the
    60 pairs of SHREC07's ants, teddy bears and glasses on which maps are published."""
    likely_lead: float = 2.0
    """Candidates with scores less than this above the best one's are refined with all samples: as good as all. With
    .5 and two settling rounds a pair takes a third less time, humans and armadillos err .127, not .108."""
    num_shell: int = 20
    """Functions in which surfaces are laid onto each other first, ..."""
    shell_position: float = 2.0
    """... the weight of positions, of surfaces of unit area, relative to embeddings, ..."""
    shell_normal: float = 0.3
    """... and that of unit normals."""
    curvature_weight: float = 0.3
    """Root mean square weight of a curvature relative to one eigenfunction in nearest neighbours."""
    num_oriented: int = 11
    """Functions, the constant one included, that start a map of chosen orientation."""


#: The numbers in use.
TUNED = MapTuning()
