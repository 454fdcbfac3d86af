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


@pytest.mark.parametrize(
    ("turns_onto_itself", "spread", "num", "noise", "limit_deg"),
    [
        (QUARTERS, [1.0, 1.0, 0.7], 20, 0.01, 3),
        (QUARTERS, [1.0, 1.0, 0.7], 120, 0.01, 3),
        (QUARTERS[::2], [1.0, 0.8, 0.6], 6, 0.05, 15),
        (QUARTERS[::2], [1.0, 0.8, 0.6], 12, 0.1, 15),
    ],
)
def test_turns_that_noise_alone_speaks_against_are_symmetries(
    turns_onto_itself, spread, num, noise, limit_deg
):
    rng = np.random.default_rng(num)
    part = rng.standard_normal((num // len(turns_onto_itself), 3)) * spread
    base = np.concatenate([part @ turn.T for turn in turns_onto_itself])
    found, turns = aligned(tables(base, rng, noise), rng)
    assert errors_deg(found, turns, turns_onto_itself).max() < limit_deg
    assert found.confidence.max() <= 1.0 / len(turns_onto_itself)
    assert "symmetric" in codes(found.notes)
    assert "open-borders" not in codes(found.notes)
