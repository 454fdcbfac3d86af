"""The stage on dense points: ranks by both energies, reports both, and claims no proof that is not the answer's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError, OptionsError
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.normals import outward_normals
from data_tools.surface.shape import Shape
from pairwise import DensePoints, MatchOptions, match
from pairwise.dense.rank import refine_candidates
from pairwise.matching import match_problem
from pairwise.problem.problem import Problem
from pairwise.results import Candidate
from pairwise.status import Status
from tests.oracles import check_pose


@pytest.fixture(scope="module")
def shape() -> Shape:
    return blob(np.random.default_rng(4), num_vertices=500)


def sampled(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Farthest points, and the same ones disturbed."""
    points = shape.vertices[farthest_points(shape, 14, metric="euclidean")]
    return points, points + 0.05 * rng.standard_normal(points.shape)


def candidate(rotation: np.ndarray, energy: float) -> Candidate:
    return Candidate(
        R_target_source=rotation,
        map_target_source=np.arange(3),
        energy=energy,
        reflected=False,
        origin="start",
    )


def test_dense_points_decide_between_candidates(shape: Shape, rng: np.random.Generator) -> None:
    """A wrong pose of slightly less energy on the samples comes second, and keeps its own energy."""
    turn = random_rotation(rng)
    dense = DensePoints.from_user(shape.vertices), DensePoints.from_user(shape.vertices @ turn)
    problem = Problem.from_user(shape.vertices[:3], shape.vertices[:3] @ turn)
    wrong = turn @ Rotation.from_rotvec([np.pi, 0, 0]).as_matrix()
    ranked = refine_candidates([candidate(wrong, 0.9), candidate(turn, 1.0)], problem, dense)
    assert [c.energy for c in ranked] == [1.0, 0.9]
    first, second = (c.refined for c in ranked)
    assert first is not None
    assert second is not None
    assert first.energy < 1e-9 < second.energy <= second.initial_energy


def test_the_samples_count_as_well(shape: Shape, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the dense points see no difference, the order by the samples stays; the test above can fail so."""
    dense = DensePoints.from_user(shape.vertices), DensePoints.from_user(shape.vertices)
    problem = Problem.from_user(shape.vertices[:3], shape.vertices[:3])
    wiggle = Rotation.from_rotvec([0.0, 1e-3, 0]).as_matrix()
    monkeypatch.setattr("pairwise.dense.rank._MAX_ITERATIONS", 1)
    order = [candidate(wiggle, 0.5), candidate(wiggle.T, 5.0)]
    for given in (order, order[::-1]):
        assert [c.energy for c in refine_candidates(given, problem, dense)] == [0.5, 5.0]


def test_the_result_says_both_energies_and_the_samples_stay_consistent(
    shape: Shape, rng: np.random.Generator
) -> None:
    target, source = sampled(shape, rng)
    turn = random_rotation(rng)
    dense = (
        (shape.vertices, outward_normals(shape)),
        DensePoints.from_user(shape.vertices @ turn, outward_normals(shape) @ turn),
    )
    plain = match(target, source @ turn)
    result = match(target, source @ turn, dense=dense)
    assert {c.energy for c in result.candidates} == {c.energy for c in plain.candidates}
    products = [c.energy * c.refined.energy for c in result.candidates if c.refined is not None]
    assert len(products) == len(result.candidates)
    assert products == sorted(products)
    best = result.candidates[0]
    assert result.refined is best.refined
    assert result.energy == best.energy
    problem = Problem.from_user(target, source @ turn)
    for c in result.candidates:
        assert not check_pose(problem, c.R_target_source, c.map_target_source, c.energy)
    assert result.times_s["refinement"] > 0
    assert rotation_angle_deg(result.refined.pose.rotation, turn) < 0.1
    assert plain.refined is None
    assert plain.candidates[0].refined is None


def test_chirality_is_searched_and_kept(shape: Shape, rng: np.random.Generator) -> None:
    turn = random_rotation(rng) @ np.diag([1.0, 1.0, -1.0])
    target = shape.vertices[farthest_points(shape, 12, metric="euclidean")]
    result = match(target, target @ turn, group="O", dense=(shape.vertices, shape.vertices @ turn))
    assert np.linalg.det(result.refined.pose.rotation) == pytest.approx(-1.0)
    assert {c.reflected for c in result.candidates} == {False, True}
    for c in result.candidates:
        assert (np.linalg.det(c.refined.pose.rotation) < 0) == c.reflected


def test_a_proof_is_not_claimed_for_another_pose(shape: Shape, rng: np.random.Generator) -> None:
    """The dense points are those of another pose than the samples': the answer changes, bound and candidates stay."""
    target = shape.vertices[farthest_points(shape, 8, metric="euclidean")]
    noisy = target + 0.05 * rng.standard_normal(target.shape)
    problem = Problem.from_user(target, noisy)
    options = MatchOptions(certify=True, candidate_factor=50.0)
    plain = match_problem(problem, options)
    assert plain.status is Status.PROVEN_OPTIMAL
    assert len(plain.candidates) > 1
    other = plain.candidates[1].R_target_source
    dense = DensePoints.from_user(shape.vertices), DensePoints.from_user(shape.vertices @ other)
    result = match_problem(problem, options, dense=dense)
    assert result.energy == plain.candidates[1].energy
    assert result.status is Status.LOCAL_OPTIMUM
    assert result.lower_bound == plain.lower_bound <= min(c.energy for c in result.candidates)
    same = match_problem(problem, options, dense=(dense[0], dense[0]))
    assert same.status is Status.PROVEN_OPTIMAL
    assert same.energy == plain.energy


def test_only_the_rotation_of_space_is_refined(shape: Shape, rng: np.random.Generator) -> None:
    target = np.hstack([shape.vertices[:12], rng.standard_normal((12, 2))])
    result = match(target, target, rotation_pattern=(3, 2), dense=(shape.vertices, shape.vertices))
    assert result.R_target_source.shape == (5, 5)
    assert result.refined.pose.rotation.shape == (3, 3)


def test_bad_input_is_refused(shape: Shape) -> None:
    points = shape.vertices[:10]
    with pytest.raises(OptionsError, match="pair"):
        match(points, points, dense=points)
    with pytest.raises(InputError, match="source: expected 3 columns, got 2"):
        match(points, points, dense=(points, points[:, :2]))
    with pytest.raises(InputError, match="invariants"):
        match(points, points, dense=(DensePoints.from_user(points, invariants=points), points))
