"""After a match: every candidate is refined on dense points, and both energies rank the candidates.

The samples' energy knows that a match is one-to-one but sees few points; the dense points' energy (closest points
both ways, invariants included) sees the whole shape but lets points share a counterpart. Each is a sum of squares
whose noise level is unknown and differs from shape to shape, so each says by its *logarithm* how likely a pose is
(the profile likelihood of the noise level), and the two together by the sum of the logarithms: the candidates are
ranked by the product of both energies. On rigid shapes (teeth) and on bent ones (ants, teddy bears) the product picks
the right pose more often than the samples' energy alone; the dense energy alone loses on bent shapes.
"""

from __future__ import annotations

from dataclasses import replace

from pairwise.dense.points import DensePoints
from pairwise.dense.refine import RefinedPose, refine_pose
from pairwise.problem.problem import Problem
from pairwise.results import Candidate, MatchResult
from pairwise.status import Status

#: Normals pull bent limbs off the pose that most of a shape agrees on; more steps than these let bent shapes drift.
_NORMAL_WEIGHT, _MAX_ITERATIONS = 0.0, 8


def ranked_on_dense(
    result: MatchResult, problem: Problem, dense: tuple[DensePoints, DensePoints]
) -> tuple[MatchResult, tuple[RefinedPose, ...]]:
    """Return a match whose candidates are ranked by the product of both energies, and their refined poses.

    Parameters
    ----------
    result : MatchResult
        Bound, certificate and energies stay about the samples; proven is the answer only where it is of the same
        energy as before.
    problem : Problem
    dense : pair of DensePoints
        Of target and source, in the coordinates of the rotation block and the units of the samples.
    """
    poses = [_refined_on_dense(candidate, problem, dense) for candidate in result.candidates]
    # Exact matches of the samples differ on the dense points at most.
    both = zip(result.candidates, poses, strict=True)
    pairs = sorted(both, key=lambda pair: (pair[0].energy * pair[1].energy, pair[1].energy))
    best = pairs[0][0]
    is_other = best.energy > result.energy
    ranked = replace(
        result,
        R_target_source=best.R_target_source,
        map_target_source=best.map_target_source,
        energy=best.energy,
        candidates=tuple(candidate for candidate, _ in pairs),
        status=Status.LOCAL_OPTIMUM if is_other and result.status is Status.PROVEN_OPTIMAL else result.status,
    )
    return ranked, tuple(pose for _, pose in pairs)


def _refined_on_dense(candidate: Candidate, problem: Problem, dense: tuple[DensePoints, DensePoints]) -> RefinedPose:
    block = problem.pattern.rotation_block
    return refine_pose(
        *dense,
        candidate.R_target_source[:block, :block],
        estimate_scale=False,
        normal_weight=_NORMAL_WEIGHT,
        max_iterations=_MAX_ITERATIONS,
    )
