"""Turns and mirror images after which a shape looks like itself."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.stages.self_symmetry import TWELFTHS, mirrored_costs, near_symmetries
from collalign.whole_pairs.local_evidence import surface_gap, surface_points
from data_tools.datasets.synthetic_shapes import crown
from data_tools.poses import APART_DEG
from data_tools.rotations import random_rotation, rotation_angle_deg
from tests.collalign.stages.test_mixed_sides import lopsided
from tests.collalign.stages.test_trust import brick, samples_of


@pytest.mark.parametrize(("sides", "num"), [((1.0, 0.8, 0.6), 3), ((1.0, 1.0, 0.6), 7)])
def test_the_turns_of_a_box_come_first(sides, num):
    found = near_symmetries(brick(np.array(sides)))
    turn = random_rotation(np.random.default_rng(3))
    aligned = turn.T @ found[:num] @ turn
    axes = np.abs(np.round(aligned, 1))
    assert ((axes == 0.0) | (axes == 1.0)).mean() > 0.9
    angles = rotation_angle_deg(found[:num])
    assert (np.minimum(np.abs(angles - 180.0), np.abs(angles - 90.0)) < 8.0).all()
    about_an_axis = Rotation.from_rotvec(np.outer(TWELFTHS, [0, 0, 1]), degrees=True).as_matrix()
    assert (rotation_angle_deg(about_an_axis) > APART_DEG).all()  # whatever the last bits say


def test_a_box_is_its_own_mirror_image_and_a_lopsided_crown_is_not():
    crowned = lopsided(crown(np.random.default_rng(3), num_vertices=600))
    costs = []
    for samples in (brick(np.array([1.0, 0.8, 0.6])), samples_of([crowned], 400)[0]):
        fixed, moving = (surface_points(samples, first=first) for first in (0, 1))
        costs.append(mirrored_costs(samples)[0] / surface_gap(fixed, moving, np.eye(3)[None])[0])
    assert costs[0] < 1.2 < 1.4 < costs[1]
