"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""

from pairwise.branch_and_bound.poses import PoseList, PoseRegion, all_poses
from pairwise.branch_and_bound.prove import Proof, prove
from pairwise.certificates.certificate import Certificate
from pairwise.certificates.verify import verify_certificate
from pairwise.dense.points import DensePoints
from pairwise.dense.refine import refine_pose
from pairwise.match import match
from pairwise.options import DenseOptions, MatchOptions
from pairwise.pm_sdp.symmetries import exact_solutions
from pairwise.problem.problem import Problem
from pairwise.relaxations import solve_relaxation
from pairwise.status import Status
from pairwise.tight.symmetries import optimal_rotations

__all__ = [
    "Certificate",
    "DenseOptions",
    "DensePoints",
    "MatchOptions",
    "PoseList",
    "PoseRegion",
    "Problem",
    "Proof",
    "Status",
    "all_poses",
    "exact_solutions",
    "match",
    "optimal_rotations",
    "prove",
    "refine_pose",
    "solve_relaxation",
    "verify_certificate",
]
