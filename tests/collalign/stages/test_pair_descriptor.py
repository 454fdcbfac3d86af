from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from collalign.stages.pairs.descriptor import shape_descriptor
from tests.products import samples_at


def samples_of(points, invariants=None):
    centred = points - points.mean(axis=0)
    return samples_at(centred, invariants=invariants, offset=points.mean(axis=0))


def test_pose_size_mirroring_and_order_do_not_matter(rng):
    points = rng.standard_normal((30, 3)) * [3.0, 2.0, 1.0]
    invariants = rng.standard_normal((30, 2))
    order = rng.permutation(30)
    moved = 7.0 * points[order] @ Rotation.random(rng=1).as_matrix().T * [1.0, 1.0, -1.0] + 5.0
    one = shape_descriptor(samples_of(points, invariants))
    other = shape_descriptor(samples_of(moved, 7.0 * invariants[order]))
    np.testing.assert_allclose(one, other, atol=1e-12)
    assert one.shape == (35 + 10,)


def test_similar_shapes_are_nearer_than_different_ones(rng):
    points = rng.standard_normal((30, 3)) * [3.0, 1.0, 1.0]
    similar = shape_descriptor(samples_of(points + 0.05 * rng.standard_normal((30, 3))))
    different = shape_descriptor(samples_of(rng.standard_normal((30, 3)) * [3.0, 3.0, 0.1]))
    one = shape_descriptor(samples_of(points))
    assert np.linalg.norm(one - similar) < 0.2 * np.linalg.norm(one - different)


def test_invariants_tell_shapes_of_equal_positions_apart(rng):
    samples = samples_of(rng.standard_normal((30, 3)), rng.standard_normal((30, 2)))
    other = replace(samples, invariants=samples.invariants + 1.0)
    assert np.linalg.norm(shape_descriptor(samples) - shape_descriptor(other)) > 0.1


def test_degenerate_shapes_have_finite_descriptors():
    for points in (np.zeros((1, 3)), np.zeros((5, 3)), np.eye(3)[:2]):
        descriptor = shape_descriptor(samples_of(points))
        assert descriptor.shape == (35,)
        assert np.isfinite(descriptor).all()
