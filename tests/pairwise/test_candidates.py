"""Candidates: ranking, the best of each chirality, and poses that are found later."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pairwise.matching import match
from pairwise.options import MatchOptions
from pairwise.portfolio import rank_candidates, with_better
from pairwise.problem import Problem
from pairwise.results import Candidate
from tests.data_tools.test_poses import about_z

PROBLEM = Problem.from_user(np.eye(3), np.eye(3), group="O")


def pose(angle_deg, energy, *, reflected=False):
    rotation = about_z(angle_deg) * [1.0, 1.0, -1.0 if reflected else 1.0]
    return Candidate(
        R_target_source=rotation,
        map_target_source=np.arange(3),
        energy=energy,
        reflected=reflected,
        origin="test",
    )


def energies(candidates):
    return [c.energy for c in candidates]


def test_far_worse_poses_are_dropped_but_the_best_of_each_chirality_stays():
    poses = [
        pose(0, 3.0),
        pose(40, 1.0),
        pose(80, 1.9),
        pose(0, 9.0, reflected=True),
        pose(50, 10.0, reflected=True),
    ]
    ranked = rank_candidates(poses, MatchOptions(candidate_factor=2.0))
    assert energies(ranked) == [1.0, 1.9, 9.0]
    assert ranked[-1].reflected


def test_a_better_pose_replaces_those_it_is_not_distinct_from():
    ranked = rank_candidates(
        [pose(0, 1.0), pose(60, 1.2), pose(0, 1.1, reflected=True)], MatchOptions()
    )
    better = with_better(ranked, pose(5, 0.9), PROBLEM, MatchOptions())
    assert energies(better) == [0.9, 1.1, 1.2]
    elsewhere = with_better(ranked, pose(120, 0.9), PROBLEM, MatchOptions())
    assert energies(elsewhere) == [0.9, 1.0, 1.1, 1.2]


@pytest.mark.parametrize("energy", [1.0, 1.5])
def test_a_pose_that_is_no_better_changes_nothing(energy):
    ranked = rank_candidates([pose(0, 1.0), pose(60, 1.2)], MatchOptions())
    assert with_better(ranked, pose(30, energy), PROBLEM, MatchOptions()) is ranked


def test_copies_of_a_box_fit_in_four_poses_whatever_their_rounding_errors_say():
    corners = np.array(
        [[x, y, z] for x in (-1.0, 1.0) for y in (-2.0, 2.0) for z in (-3.0, 3.0)]
    ) / np.sqrt(112.0)
    turn = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
    found = match(corners, corners @ turn).candidates
    assert len(found) == 4
    assert max(energies(found)) < 1e-20
    better = with_better(
        found, pose(10.0, 0.0), Problem.from_user(corners, corners @ turn), MatchOptions()
    )
    assert len(better) == 5
