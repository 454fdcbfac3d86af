"""Tables of landmarks are no surfaces: the points alone say how they lie, and after which turns they look alike."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import collalign
from data_tools.rotations import random_rotation, rotation_angle_deg
from tests.notes import codes

NUM = 6
QUARTERS = Rotation.from_rotvec(np.outer([0, 90, 180, 270], [0, 0, 1]), degrees=True).as_matrix()


def aligned(clouds, rng):
    """Align clouds (n, 3) in random poses; also return the rotations that took them there."""
    turns = np.stack([random_rotation(rng) for _ in clouds])
    given = {
        f"s{i}": rng.permutation(cloud @ turn.T)
        for i, (cloud, turn) in enumerate(zip(clouds, turns, strict=True))
    }
    return collalign.align_collection(given, jobs=1, progress=False), turns


def errors_deg(found, turns, alike):
    """Return the angle of each pose to that of the first shape (n,), up to turns after which all look alike."""
    common = found.rotations @ turns[[int(name[1:]) for name in found.names]]
    relative = common[0].T @ common
    return np.min([rotation_angle_deg(relative @ turn) for turn in alike], axis=0)


def tables(base, rng, noise=0.03):
    return [base + noise * rng.standard_normal(base.shape) for _ in range(NUM)]


@pytest.mark.parametrize("num", [5, 20, 150])
def test_tables_of_landmarks_are_right_and_sure(num):
    rng = np.random.default_rng(num)
    found, turns = aligned(tables(rng.standard_normal((num, 3)) * [1.2, 0.8, 0.5], rng), rng)
    assert errors_deg(found, turns, QUARTERS[:1]).max() < 6
    assert found.confidence.min() >= 0.95
    assert not {"symmetric", "open-borders", "incomplete", "all-incomplete"} & {*codes(found.notes)}


@pytest.mark.parametrize("num", [20, 120])
def test_a_table_that_quarter_turns_leave_as_it_is_is_called_symmetric(num):
    rng = np.random.default_rng(num)
    quarter = rng.standard_normal((num // 4, 3)) * [1.0, 1.0, 0.7]
    base = np.concatenate([quarter @ turn.T for turn in QUARTERS])
    found, turns = aligned(tables(base, rng, noise=0.01), rng)
    assert errors_deg(found, turns, QUARTERS).max() < 3
    assert found.confidence.max() <= 0.25
    assert "symmetric" in codes(found.notes)
    assert "open-borders" not in codes(found.notes)


@pytest.mark.parametrize(("num", "noise"), [(6, 0.05), (12, 0.1)])
def test_a_half_turn_that_noise_alone_speaks_against_is_a_symmetry(num, noise):
    rng = np.random.default_rng(num)
    half = rng.standard_normal((num // 2, 3)) * [1.0, 0.8, 0.6]
    base = np.concatenate([half, half * [-1.0, -1.0, 1.0]])
    found, turns = aligned(tables(base, rng, noise), rng)
    assert errors_deg(found, turns, QUARTERS[::2]).max() < 15
    assert found.confidence.max() <= 0.5
    assert "symmetric" in codes(found.notes)
