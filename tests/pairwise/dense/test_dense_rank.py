"""A match on dense points: ranked by both energies, and without a proof that is not the answer's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.sampling import farthest_points
from data_tools.rotations import random_rotation
from pairwise import DensePoints, MatchOptions
from pairwise.dense.refine import ranked_on_dense
from pairwise.matching import match_problem
from pairwise.problem.problem import Problem
from pairwise.results import Candidate, MatchResult
from pairwise.status import Status


@pytest.fixture(scope="module")
def shape():
    return blob(np.random.default_rng(4), num_vertices=500)


def given(*poses):
    """A result of these rotations and energies, the first one its proven answer."""
    candidates = [
        Candidate(
            R_target_source=turn,
            map_target_source=np.arange(3),
            energy=energy,
            reflected=False,
            origin="start",
        )
        for turn, energy in poses
    ]
    return MatchResult(
        R_target_source=poses[0][0],
        map_target_source=np.arange(3),
        energy=poses[0][1],
        lower_bound=poses[0][1],
        candidates=tuple(candidates),
        status=Status.PROVEN_OPTIMAL,
    )


def test_dense_points_decide_between_candidates(shape, rng):
    """A wrong pose of slightly less energy on the samples comes second; what was proven of it is of no other pose."""
    turn = random_rotation(rng)
    dense = DensePoints.from_user(shape.vertices), DensePoints.from_user(shape.vertices @ turn)
    problem = Problem.from_user(shape.vertices[:3], shape.vertices[:3] @ turn)
    wrong = turn @ Rotation.from_rotvec([np.pi, 0, 0]).as_matrix()
    ranked, refined = ranked_on_dense(given((wrong, 0.9), (turn, 1.0)), problem, dense)
    assert [c.energy for c in ranked.candidates] == [1.0, 0.9]
    assert refined[0].energy < 1e-9 < refined[1].energy
    assert (ranked.energy, ranked.lower_bound, ranked.status) == (1.0, 0.9, Status.LOCAL_OPTIMUM)
    np.testing.assert_array_equal(ranked.R_target_source, turn)
    same, _ = ranked_on_dense(given((turn, 0.9), (wrong, 1.0)), problem, dense)
    assert (same.energy, same.status) == (0.9, Status.PROVEN_OPTIMAL)


def test_the_samples_count_as_well(shape, monkeypatch):
    """Where the dense points see no difference, the order by the samples stays; the test above can fail so."""
    dense = DensePoints.from_user(shape.vertices), DensePoints.from_user(shape.vertices)
    problem = Problem.from_user(shape.vertices[:3], shape.vertices[:3])
    wiggle = Rotation.from_rotvec([0.0, 1e-3, 0]).as_matrix()
    monkeypatch.setattr("pairwise.dense.refine._MAX_ITERATIONS", 1)
    order = [(wiggle, 0.5), (wiggle.T, 5.0)]
    for poses in (order, order[::-1]):
        assert [c.energy for c in ranked_on_dense(given(*poses), problem, dense)[0].candidates] == [
            0.5,
            5.0,
        ]


def test_every_pose_is_refined_and_keeps_its_chirality(shape, rng):
    """The rotation of space alone is refined, the other coordinates of the samples stay as they are."""
    turn = random_rotation(rng) @ np.diag([1.0, 1.0, -1.0])
    target = shape.vertices[farthest_points(shape, 12, metric="euclidean")]
    more = rng.standard_normal((12, 2))
    problem = Problem.from_user(
        np.hstack([target, more]),
        np.hstack([target @ turn, more]),
        rotation_pattern=(3, 2),
        group="O",
    )
    dense = DensePoints.from_user(shape.vertices), DensePoints.from_user(shape.vertices @ turn)
    plain = match_problem(problem, MatchOptions())
    result, refined = ranked_on_dense(plain, problem, dense)
    assert {c.energy for c in result.candidates} == {c.energy for c in plain.candidates}
    products = [c.energy * pose.energy for c, pose in zip(result.candidates, refined, strict=True)]
    assert products == sorted(products)
    np.testing.assert_allclose(refined[0].pose.rotation, turn, atol=1e-3)
    assert {c.reflected for c in result.candidates} == {False, True}
    for c, pose in zip(result.candidates, refined, strict=True):
        assert (np.linalg.det(pose.pose.rotation) < 0) == c.reflected
