import numpy as np
import pytest

from data_tools.errors import OptionsError
from pairwise import verify_certificate
from pairwise.branch_and_bound.prove import _proof, can_certify, prove, searches_of
from pairwise.problem import Problem, chiralities, energy_scale
from pairwise.results import Status
from tests.oracles import brute_force, check_pose
from tests.rigid_problems import is_pointed, planted_cube, rigid_problem


@pytest.mark.parametrize("seed", range(42))
def test_small_problems_are_proven_and_agree_with_brute_force(seed):
    problem = rigid_problem(seed)
    limit_s = None if is_pointed(problem) else 0.3
    proof = prove(problem, tol=1e-4, time_limit_s=limit_s, record=True)
    optimum, scale = brute_force(problem).energy, energy_scale(problem)
    assert proof.status is Status.PROVEN_OPTIMAL or not is_pointed(problem)
    assert proof.lower_bound <= optimum + 1e-12 * scale
    assert proof.candidate.energy == pytest.approx(optimum, rel=2e-4, abs=1e-8 * scale)
    pose = proof.candidate
    for mirrored, part in chiralities(problem):
        bound = proof.reflected_bound if mirrored else proof.proper_bound
        assert proof.lower_bound <= bound <= brute_force(part).energy + 1e-12 * scale
    assert check_pose(problem, pose.R_target_source, pose.map_target_source, pose.energy) == []
    if proof.is_chirality_proven:
        assert problem.pattern.special_blocks == ()
        worse = [p for mirrored, p in chiralities(problem) if mirrored != pose.reflected]
        assert brute_force(worse[0]).energy > pose.energy
    verified = verify_certificate(
        problem.target, problem.source, proof.certificate, problem=problem
    )
    assert proof.lower_bound - 1e-8 * scale <= verified <= optimum + 1e-12 * scale


def test_a_proof_needs_both_chiralities_and_a_mirror_decision_the_whole_energy():
    problem = Problem.from_user(*planted_cube(8, 0.3, 1), group="O")
    searches = sorted(searches_of(problem, None, 1e-3), key=lambda search: search.reflected)
    best = min(search.energy for search in searches)

    def judged(proper, reflected):
        for search, bound in zip(searches, (proper, reflected), strict=True):
            search._open.bounds[:] = bound * best
        return _proof(searches)

    is_reflected = searches[1].energy == best
    own, other = (1, 0) if is_reflected else (0, 1)
    for of_own, of_other, is_proven, is_decided in [
        (0.9995, 1.01, True, True),
        (0.998, 1.01, False, True),
        (0.9, 2.0, False, True),
        (0.9995, 0.9995, False, False),
        (0.9995, 0.6, False, False),
        (2.0, 0.6, False, False),
    ]:
        bounds = np.empty(2)
        bounds[[own, other]] = of_own, of_other
        proof = judged(*bounds)
        assert (proof.status is Status.PROVEN_OPTIMAL) == is_proven
        assert proof.is_chirality_proven == is_decided
        assert proof.lower_bound == pytest.approx(min(of_own, of_other) * best)
        assert (proof.proper_bound, proof.reflected_bound) == pytest.approx(tuple(bounds * best))


def test_known_poses_are_used_and_the_time_limit_keeps_bounds_valid():
    problem = Problem.from_user(*planted_cube(16, 0.3, 2))
    full = prove(problem)
    short = prove(problem, [full.candidate], time_limit_s=1e-3)
    assert short.status is Status.TIME_LIMIT
    assert short.candidate.energy <= full.candidate.energy * (1 + 1e-9)
    assert 0.0 <= short.lower_bound < (1 - 1e-3) * full.candidate.energy


def test_what_cannot_be_certified_is_refused():
    target, source = planted_cube(6, 0.1, 0)
    problem = Problem.from_user(target, source)
    assert can_certify(problem)
    four = Problem.from_user(np.eye(4), np.eye(4))
    assert not can_certify(four)
    with pytest.raises(OptionsError, match="dimension 2 or 3"):
        prove(four)
    with pytest.raises(OptionsError, match="tol"):
        prove(problem, tol=0.0)
    with pytest.raises(OptionsError, match="time_limit_s"):
        prove(problem, time_limit_s=-1.0)
