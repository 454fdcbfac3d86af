"""Mixed folders in parts, and turning a solution as a whole."""

import numpy as np
import pytest

from collalign.options import AlignOptions
from collalign.products.shapes import Constraints
from collalign.stages.poses.agreement import resolve_pair
from collalign.stages.poses.parts import join_parts, split_shapes
from collalign.stages.poses.placement import rotated_solution
from collalign.stages.poses.synchronize import synchronize_pairs, synchronize_shapes
from data_tools.datasets.synthetic_shapes import chair
from data_tools.embedding.embedding import sample_shape
from data_tools.errors import CollectionError, OptionsError
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from tests.notes import codes
from tests.products import pair_of, samples_at
from tests.synchronization_problems import mixed_collection, pose_errors_deg

SIZES = (9, 7)
NONE = Constraints()


@pytest.fixture
def labels_and_truth():
    problem, labels = mixed_collection(np.random.default_rng(4), SIZES, wrong=0.1)
    return labels, problem.truth


@pytest.fixture
def pairs():
    problem, _ = mixed_collection(np.random.default_rng(4), SIZES, wrong=0.1)
    assert problem.energies is not None
    return [
        pair_of(rotations, 1e-6 * energies, target=int(i), source=int(j), num_samples=6)
        for (i, j), rotations, energies in zip(
            problem.edges, problem.rotations, problem.energies, strict=True
        )
    ]


@pytest.fixture
def samples(rng):
    return [
        samples_at(points, name=str(i))
        for i, points in enumerate(rng.standard_normal((sum(SIZES), 6, 3)))
    ]


def solve(samples, pairs, clusters, constraints=NONE):
    options = AlignOptions(group="SO", clusters=clusters)
    split, linked = split_shapes(options, samples, pairs)
    solution = synchronize_shapes(options, samples, linked, constraints)
    merged, solution = join_parts(options, split, pairs, linked, solution, constraints)
    assert [(pair.target, pair.source) for pair in merged] == [
        (pair.target, pair.source) for pair in pairs
    ]
    return solution


@pytest.mark.parametrize("clusters", [0, 2])
def test_a_mixed_folder_is_split_and_each_part_is_right(clusters, samples, pairs, labels_and_truth):
    labels, truth = labels_and_truth
    solution = solve(samples, pairs, clusters)
    assert {tuple(part) for part in solution.parts} == {
        tuple(np.flatnonzero(labels == label)) for label in (0, 1)
    }
    for part in solution.parts:
        assert pose_errors_deg(solution.rotations[part], truth[part]).max() < 20
    assert np.allclose(solution.rotations[0], np.eye(3))
    assert len(solution.edge_choice) == len(solution.edge_inlier) == len(pairs)
    assert codes(solution.warnings) == ["different-parts"]
    assert solution.warnings[0].values["num"] == 2


def test_poses_set_by_hand_stay(samples, pairs, rng):
    fixed = random_rotation(rng)
    solution = solve(samples, pairs, 2, Constraints(fixed={3: fixed}))
    assert np.allclose(solution.rotations[3], fixed)


def test_parts_of_one_shape_each_are_refused(samples, pairs):
    with pytest.raises(CollectionError, match="ask for fewer"):
        solve(samples, pairs, sum(SIZES))
    with pytest.raises(OptionsError, match="clusters"):
        AlignOptions(clusters=2, synchronization="spectral")
    with pytest.raises(OptionsError, match="reference"):
        AlignOptions(gauge="axes", reference="a")


def test_a_turn_moves_poses_and_alternatives_together(pairs, rng):
    before = synchronize_pairs(AlignOptions(group="SO"), sum(SIZES), pairs)
    turn = random_rotation(rng)
    after = rotated_solution(before, np.tile(turn, (sum(SIZES), 1, 1)))
    assert np.allclose(after.rotations, turn @ before.rotations)
    for poses, others in zip(after.alternatives, before.alternatives, strict=True):
        assert all(
            np.allclose(p.rotation, turn @ o.rotation) for p, o in zip(poses, others, strict=True)
        )


def test_eigenfunctions_follow_the_map_that_positions_give_a_pair_that_is_solved_again():
    rng = np.random.default_rng(2)
    options = EmbeddingOptions(kind="xyz+lb")
    shape = chair(rng, resolution=1)
    turn = random_rotation(rng)
    sampling = SamplingOptions(num_points=16, num_dense_points=60)
    moved = Shape.from_arrays(shape.vertices @ turn.T, shape.faces, name="b")
    one, other = (sample_shape(each, sampling, options) for each in (shape, moved))
    found = resolve_pair(one, other, "SO", turn.T)
    assert one.coordinates.shape[1] > 3
    assert found["energies"][0] < 1e-6
    np.testing.assert_array_equal(found["maps"][0], np.arange(16))
