"""From where a collection is looked at."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.output.views import camera
from collalign.products.named_frame import NamedFrame
from tests.view_problems import bumpy_shapes


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
