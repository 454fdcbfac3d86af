"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pairwise.branch_and_bound.pose_lists import PoseList, PoseRegion, all_poses
    from pairwise.branch_and_bound.prove import Proof, prove
    from pairwise.certificates.certificate import Certificate
    from pairwise.certificates.verify import verify_certificate
    from pairwise.dense.points import DensePoints
    from pairwise.dense.refine import refine_pose
    from pairwise.matching import match
    from pairwise.options import MatchOptions
    from pairwise.problem.problem import Problem
    from pairwise.relaxations import solve_relaxation
    from pairwise.status import Status

__all__ = [
    "Certificate",
    "DensePoints",
    "MatchOptions",
    "PoseList",
    "PoseRegion",
    "Problem",
    "Proof",
    "Status",
    "all_poses",
    "match",
    "prove",
    "refine_pose",
    "solve_relaxation",
    "verify_certificate",
]

#: Imported when first asked for: options alone are there in a third of the time.
_HOMES = {
    "Certificate": "pairwise.certificates.certificate",
    "DensePoints": "pairwise.dense.points",
    "MatchOptions": "pairwise.options",
    "PoseList": "pairwise.branch_and_bound.pose_lists",
    "PoseRegion": "pairwise.branch_and_bound.pose_lists",
    "Problem": "pairwise.problem.problem",
    "Proof": "pairwise.branch_and_bound.prove",
    "Status": "pairwise.status",
    "all_poses": "pairwise.branch_and_bound.pose_lists",
    "match": "pairwise.matching",
    "prove": "pairwise.branch_and_bound.prove",
    "refine_pose": "pairwise.dense.refine",
    "solve_relaxation": "pairwise.relaxations",
    "verify_certificate": "pairwise.certificates.verify",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
