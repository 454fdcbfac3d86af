"""Generated scans of a part of a model, and the judge of their poses."""

import numpy as np
import pytest

from data_tools.poses import moved_by
from data_tools.surface.shape import Shape
from experiments.generated.assembled import cylinder
from experiments.generated.part_scans import STRAYS, is_right, model_of, part_scans


@pytest.fixture(scope="module")
def mug():
    return model_of("mugs")


def test_scans_lie_on_their_models_but_for_strays(mug):
    for scan in part_scans(mug, 2, np.random.default_rng(0)):
        num = len(scan.points) - scan.num_strays
        assert scan.num_strays == int(STRAYS * num)
        placed = moved_by(scan.pose, scan.points[:num])
        assert (np.ptp(placed, axis=0) < 1.1 * np.ptp(mug.vertices, axis=0)).all()
        assert is_right(mug, scan.pose, scan.pose)


def test_wrong_poses_are_no_right_ones_and_turns_of_a_shaft_are(mug):
    (scan,) = part_scans(mug, 1, np.random.default_rng(1))
    turned = np.diag([-1.0, -1.0, 1.0, 1.0]) @ scan.pose
    assert not is_right(mug, turned, scan.pose), "the handle is on the other side"
    shifted = scan.pose.copy()
    shifted[:3, 3] += 0.5
    assert not is_right(mug, shifted, scan.pose)
    shaft = Shape.from_arrays(*cylinder(0.3, 2.0, [0.0, 0.0, 0.0]))
    assert is_right(shaft, np.diag([-1.0, -1.0, 1.0, 1.0]), np.eye(4))
    assert not is_right(shaft, np.eye(4)[[1, 2, 0, 3]], np.eye(4))
