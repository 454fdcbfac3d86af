"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""

from pairwise.branch_and_bound import Proof, prove
from pairwise.certificate import Certificate
from pairwise.dense_points import DensePoints
from pairwise.exact_solutions import exact_solutions
from pairwise.match import match
from pairwise.options import DenseOptions, MatchOptions
from pairwise.problem import Problem
from pairwise.refine import refine_pose
from pairwise.solve import solve_relaxation
from pairwise.status import Status
from pairwise.tight_recovery import optimal_rotations
from pairwise.verify import verify_certificate

__all__ = [
    "Certificate",
    "DenseOptions",
    "DensePoints",
    "MatchOptions",
    "Problem",
    "Proof",
    "Status",
    "exact_solutions",
    "match",
    "optimal_rotations",
    "prove",
    "refine_pose",
    "solve_relaxation",
    "verify_certificate",
]
