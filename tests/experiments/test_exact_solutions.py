"""Theorem 3: every symmetry of an exactly symmetric shape is found, as often as backtracking finds it."""

import numpy as np
import pytest

from experiments.figures.exact_solutions import exact_solutions
from pairwise.results import Status
from tests.oracles import check_pose, isometries
from tests.problems import catalogue, planted

EXACT = [
    known
    for known in catalogue()
    if known.num_solutions > 0 and known.name not in ("weights", "blocks", "diagonal", "repeated")
]


def group_of(known):
    return "SO" if known.problem.pattern.special_blocks else "O"


@pytest.mark.parametrize("known", EXACT, ids=lambda known: known.name)
def test_all_exact_solutions_are_found(known):
    found = exact_solutions(
        known.problem.target, known.problem.source, group=group_of(known), patience=6
    )
    assert found.status is Status.CONVERGED
    assert len(found.solutions) == known.num_solutions
    assert found.is_group
    for pose in found.solutions:
        assert (
            check_pose(known.problem, pose.R_target_source, pose.map_target_source, pose.energy)
            == []
        )
        assert pose.energy < 1e-12


@pytest.mark.parametrize(("group", "order"), [("SO", 12), ("O", 24)])
def test_tetrahedron(group, order, rng):
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    problem = planted(rng, corners, group=group)
    found = exact_solutions(corners, problem.source, group=group, patience=6)
    assert len(found.solutions) == order
    assert found.is_group
    maps = {tuple(pose.map_target_source) for pose in found.solutions}
    assert maps <= {tuple(m) for m in isometries(corners, problem.source)}
    assert len(maps) == order
