"""Mixed folders in parts, and turning a solution as a whole."""

import numpy as np
import pytest

from collalign.options import AlignOptions
from collalign.stages.poses.agreement import resolve_pair
from collalign.stages.poses.placement import rotated_solution
from collalign.stages.poses.synchronize import synchronize_pairs
from data_tools.datasets.synthetic_shapes import chair
from data_tools.embedding.embedding import sample_shape
from data_tools.errors import OptionsError
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from tests.products import pair_of
from tests.synchronization_problems import mixed_collection

SIZES = (9, 7)


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


def test_impossible_options_of_frames_and_kinds_are_refused():
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
