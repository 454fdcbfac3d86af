"""Generated scans of a part of a model, and the judge of their poses."""

import numpy as np
import pytest

from data_tools.poses import moved_by
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
