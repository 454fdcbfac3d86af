"""Options of non-rigid matching."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypedDict, get_args

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
        Larger meshes are decimated for the computation; vertices in between go where their neighbours do. Five pairs
        of bodies, armadillos and ants err .026 with 12 000 as with 24 000, and take 5.0 instead of 7.7 s of CPU time.
    """

    num_functions: int = 120
    num_samples: int = 100
    num_dense: int = 1000
    max_faces: int = 12_000

    def __post_init__(self) -> None:
        check_count("num_functions", self.num_functions, lower=20)
        check_count("num_samples", self.num_samples, lower=8)
        check_count("num_dense, at least twice num_functions", self.num_dense, lower=2 * self.num_functions)
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
