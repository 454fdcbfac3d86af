"""What can be imported from ``pairwise``: the package reads this list."""

from .branch_and_bound.pose_lists import PoseList as PoseList
from .branch_and_bound.pose_lists import PoseRegion as PoseRegion
from .branch_and_bound.pose_lists import all_poses as all_poses
from .branch_and_bound.prove import Proof as Proof
from .branch_and_bound.prove import prove as prove
from .certificates.certificate import Certificate as Certificate
from .certificates.verify import verify_certificate as verify_certificate
from .dense import DensePoints as DensePoints
from .features.overlap import LocalPoses as LocalPoses
from .features.overlap import evaluate_poses as evaluate_poses
from .features.overlap import match_overlapping as match_overlapping
from .matching import match as match
from .options import MatchOptions as MatchOptions
from .options import PairOptions as PairOptions
from .problem import Problem as Problem
from .problem import with_unmatched as with_unmatched
from .reexported import InputError as InputError
from .reexported import LocalSurface as LocalSurface
from .reexported import OptionsError as OptionsError
from .reexported import SolveFailed as SolveFailed
from .relaxations import solve_relaxation as solve_relaxation
from .results import Candidate as Candidate
from .results import MatchResult as MatchResult
from .results import RelaxationResult as RelaxationResult
from .results import Status as Status
from .rotation_pattern import RotationPattern as RotationPattern
from .surface_fit import SurfaceFit as SurfaceFit
from .surface_fit import fit_surfaces as fit_surfaces

__all__: list[str]
