"""What neighbourhoods say of whole shapes: mismatch of candidates, and rotations that they propose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.whole_pairs.local_evidence import (
    local_evidence,
    proposed_rotations,
    rigid_overlap,
)
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.embedding import sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from tests.products import samples_at

MIRROR = np.diag([-1.0, 1.0, 1.0])
TURN = random_rotation(np.random.default_rng(12))


def sampled(vertices, faces):
    shape = Shape.from_arrays(vertices, faces, name="s")
    return sample_shape(
        shape, SamplingOptions(num_points=16, num_dense_points=0), EmbeddingOptions()
    )


@pytest.fixture(scope="module")
def shapes():
    """A blob, the same moved, and its mirror image moved, which lie on the first one at TURN."""
    whole = blob(np.random.default_rng(7), num_vertices=700)
    moved = whole.vertices @ TURN
    return (
        sampled(whole.vertices, whole.faces),
        sampled(2.0 * moved + 3.0, whole.faces),
        sampled(moved @ MIRROR, whole.faces[:, ::-1]),
    )


def test_neighbourhoods_match_at_the_right_rotation_alone(shapes, rng):
    rotations = np.stack([TURN, *(random_rotation(rng) for _ in range(4)), TURN @ MIRROR])
    mismatch, overlap = local_evidence(shapes[0], shapes[1], rotations)
    assert mismatch[0] < mismatch[1:].min() - 0.15
    assert overlap[0] > 0.9 > overlap[1:].max()
    of_mirrored, _ = local_evidence(shapes[0], shapes[2], rotations)
    assert of_mirrored[5] == pytest.approx(mismatch[0], abs=0.05)
    assert of_mirrored[5] < np.delete(of_mirrored, 5).min() - 0.15


def test_the_most_that_surfaces_overlap_is_that_of_the_best_rotation_refined(shapes, rng):
    off = Rotation.from_rotvec([0.3, 0.0, -0.2]).as_matrix()
    far, near = random_rotation(rng), TURN @ off
    assert rigid_overlap(shapes[0], shapes[1], far[None]) < 0.95
    assert local_evidence(shapes[0], shapes[1], near[None])[1] < 0.98
    assert rigid_overlap(shapes[0], shapes[1], np.stack([far, near])) > 0.95
    assert rigid_overlap(shapes[0], shapes[2], (TURN @ MIRROR @ off)[None]) > 0.95
    assert rigid_overlap(shapes[0], samples_at(np.eye(3)), near[None]) == 0.0


def test_shapes_of_hardly_any_points_say_nothing(shapes):
    few = samples_at(np.eye(3))
    assert few.local is None
    mismatch, overlap = local_evidence(few, shapes[0], TURN[None])
    assert np.isnan([mismatch, overlap]).all()
    assert proposed_rotations(shapes[0], few, "SO", TURN[None]).shape == (0, 3, 3)
