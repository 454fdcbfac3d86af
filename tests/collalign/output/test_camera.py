"""From where a collection is looked at."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.output.views import camera, principal_view
from collalign.products.named_frame import NamedFrame
from tests.view_problems import bumpy_shapes


def wedge():
    """Points with axes 3, 2 and 1, thin towards the positive end of the first and of the third."""
    ends = np.array([0.0, 0.1, 0.2, 1.0])
    return np.stack(np.meshgrid(3 * ends, [-1.0, 1.0], ends, indexing="ij"), axis=-1).reshape(-1, 3)


def test_longest_axis_is_level_and_the_shortest_the_line_of_sight():
    none = np.empty((0, 3), dtype=np.int64)
    right, up, viewer = principal_view([(wedge(), none)])
    np.testing.assert_allclose(right, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(viewer, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(up, np.cross(viewer, right), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_picture_is_the_same_in_every_frame_and_size(seed):
    vertices, faces = bumpy_shapes(4)
    turn = Rotation.random(random_state=seed).as_matrix()
    plain = camera((points, faces) for points in vertices)
    turned = camera((7 * points @ turn.T + seed, faces) for points in vertices)
    np.testing.assert_allclose(turned @ turn, plain, atol=1e-9)
    assert np.linalg.det(plain) == pytest.approx(1)
    assert not np.allclose(turned, plain, atol=0.01)


@pytest.mark.parametrize(("up", "front"), [("z", "x"), ("-y", "z")])
def test_named_front_is_seen_from_its_side_and_above(up, front):
    frame = NamedFrame(up=up, front=front)
    view = camera([], frame)
    assert np.linalg.det(view) == pytest.approx(1.0)
    high, forward = (view @ direction for direction in frame.directions)
    assert high[0] == pytest.approx(0.0)
    assert high[1] > 0.9
    assert high[2] > 0.3
    assert forward[2] > 0.8
    assert forward[0] == pytest.approx(-0.5)
