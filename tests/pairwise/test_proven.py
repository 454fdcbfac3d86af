"""When a pose counts as proven: never without its bound, and never by more than was asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pairwise.matching import _proven
from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import Candidate, Status


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(3)
    return Problem.from_user(rng.random((6, 3)), rng.random((6, 3)))


def judged(problem, bound, energy):
    """What is said about a pose of that energy once a relaxation has that bound."""
    relaxation = replace(solve_pm_sdp(problem, max_iterations=1), lower_bound=bound)
    pose = Candidate(
        R_target_source=np.eye(3),
        map_target_source=np.arange(6),
        energy=energy,
        reflected=False,
        origin="test",
    )
    return _proven(problem, relaxation, pose)


def test_a_pose_is_proven_to_the_tolerance_and_not_beyond(problem):
    assert judged(problem, 0.9995, 1.0)[1] is Status.PROVEN_OPTIMAL
    assert judged(problem, 0.998, 1.0)[1] is Status.LOCAL_OPTIMUM
    assert judged(problem, 0.95, 1.0)[1] is Status.LOCAL_OPTIMUM
    assert judged(problem, 0.0, 1.0)[1] is Status.LOCAL_OPTIMUM
    assert judged(problem, float("nan"), 1.0)[1] is Status.LOCAL_OPTIMUM


def test_only_rounding_is_forgiven_beside_the_tolerance(problem):
    size = float((problem.source**2).sum() + (problem.target**2).sum())
    assert judged(problem, 0.0, 1e-10 * size)[1] is Status.PROVEN_OPTIMAL
    assert judged(problem, 0.0, 1e-4 * size)[1] is Status.LOCAL_OPTIMUM


def test_bounds_are_reported_between_zero_and_the_energy(problem):
    assert judged(problem, -3.0, 1.0)[0] == 0.0
    assert judged(problem, 0.4, 1.0)[0] == 0.4
    assert judged(problem, 1.0 + 1e-9, 1.0)[0] == 1.0


def test_banded_patterns_have_no_bound_for_their_poses():
    rng = np.random.default_rng(4)
    banded = Problem.from_user(
        rng.random((6, 3)), rng.random((6, 3)), rotation_pattern=1, group="O"
    )
    bound, status = judged(banded, 1.0, 1.0)
    assert np.isnan(bound)
    assert status is Status.LOCAL_OPTIMUM
