"""A match on dense points: ranked by both energies, and without a proof that is not the answer's."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import blob, crown
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import outward_normals
from pairwise import MatchOptions
from pairwise.dense import DenseMatcher, DensePoints, ranked_on_dense, refine_pose
from pairwise.matching import match_problem
from pairwise.problem import Problem
from pairwise.results import Candidate, MatchResult, Status


def some_shape(num=300):
    shape = crown(np.random.default_rng(0), num_vertices=num)
    return shape.vertices, outward_normals(shape)


@pytest.mark.parametrize("mirrored", [False, True])
def test_exact_pose_scale_and_shift_are_recovered(mirrored, rng):
    points, normals = some_shape()
    turn = random_rotation(rng) @ (np.diag([1.0, 1.0, -1.0]) if mirrored else np.eye(3))
    source = DensePoints.from_user(2.5 * (points @ turn) + [1.0, 2.0, 3.0], normals @ turn)
    start = turn @ Rotation.from_rotvec([0.1, -0.08, 0.05]).as_matrix()
    refined = refine_pose(DensePoints.from_user(points, normals), source, start)
    assert rotation_angle_deg(refined.pose.rotation, turn) < 0.01
    assert refined.pose.scale == pytest.approx(0.4)
    assert refined.energy < 1e-8
    moved = refined.pose.scale * source.points @ refined.pose.rotation.T + refined.pose.shift
    assert np.allclose(moved, points, atol=1e-4)


def test_far_start_ends_elsewhere():
    """The recovery test can fail: from half a turn away the answer is another one."""
    points, _ = some_shape()
    shape = DensePoints.from_user(points)
    refined = refine_pose(shape, shape, np.diag([-1.0, -1.0, 1.0]))
    assert rotation_angle_deg(refined.pose.rotation) > 30


def test_bad_input_is_refused():
    points, _ = some_shape(100)
    shape = DensePoints.from_user(points)
    with pytest.raises(InputError, match="one place"):
        DensePoints.from_user(np.ones((5, 3)))
    with pytest.raises(InputError, match="normals"):
        DensePoints.from_user(points, points[:5])
    with pytest.raises(InputError, match="not orthogonal"):
        refine_pose(shape, shape, 2 * np.eye(3))
    with pytest.raises(InputError, match="invariants"):
        refine_pose(shape, DensePoints.from_user(points, invariants=points[:, :1]), np.eye(3))
    for wrong in ({"normal_weight": -1.0}, {"max_iterations": 0}):
        with pytest.raises(OptionsError, match=next(iter(wrong))):
            refine_pose(shape, shape, np.eye(3), **wrong)


def test_the_spacing_is_that_of_places():
    square = np.array([[0.0, 0.0], [0.0, 2.0], [2.0, 0.0], [2.0, 2.0]])
    for points in (square, np.concatenate([square, square])):
        assert DensePoints.from_user(points).spacing == pytest.approx(2.0)


def test_nearest_neighbours_in_slabs_are_those_of_trees_wherever_the_source_moves(rng, monkeypatch):
    points, normals = some_shape()
    source = DensePoints.from_user(rng.permutation(points)[:200])
    matcher = DenseMatcher(DensePoints.from_user(points, normals), source)
    monkeypatch.setattr("pairwise.dense._CHUNK_ENTRIES", 7_000)
    for turn in Rotation.from_rotvec(
        np.outer([3.0, 0.1, 0.11, 0.111, 0.5, 0.5], [0.6, 0.0, 0.8])
    ).as_matrix():
        pose = Similarity(rotation=turn, scale=1.1, shift=0.1 * turn[0])
        of_target, of_source = matcher.pair_up(pose)
        np.testing.assert_array_equal(
            of_target[:200], cKDTree(points).query(pose.apply(source.points))[1]
        )
        np.testing.assert_array_equal(
            of_source[200:], cKDTree(pose.apply(source.points)).query(points)[1]
        )


def test_invariants_count_and_decide(rng):
    """A box looks the same from both ends; a scalar along it tells them apart, and its cost is part of the energy."""
    points = rng.random((200, 3)) * [3.0, 1.0, 1.0]
    points = np.concatenate(
        [points, points * [-1, 1, -1], points * [-1, -1, 1], points * [1, -1, -1]]
    )
    plain = DensePoints.from_user(points)
    marked = DensePoints.from_user(points, invariants=points[:, :1])
    half_turn = np.diag([-1.0, -1.0, 1.0])
    assert refine_pose(plain, plain, half_turn).energy == pytest.approx(0.0, abs=1e-12)
    assert refine_pose(marked, marked, np.eye(3)).energy == pytest.approx(0.0, abs=1e-12)
    assert refine_pose(marked, marked, half_turn).energy > 0.1


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
