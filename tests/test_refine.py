"""Refinement on dense samples: recovers a disturbed pose, never raises its own energy, keeps chirality."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.errors import InputError, OptionsError
from data_tools.normals import outward_normals
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.synthetic_shapes import crown
from pairwise.refine import DensePoints, refine_pose
from pairwise.status import Status


def some_shape(num: int = 300) -> tuple[np.ndarray, np.ndarray]:
    shape = crown(np.random.default_rng(0), num_vertices=num)
    return shape.vertices, outward_normals(shape)


@pytest.mark.parametrize("correspondence", ["nearest", "assignment"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_exact_pose_scale_and_shift_are_recovered(
    correspondence: str, mirrored: bool, rng: np.random.Generator
) -> None:
    points, normals = some_shape()
    turn = random_rotation(rng) @ (np.diag([1.0, 1.0, -1.0]) if mirrored else np.eye(3))
    source = DensePoints.from_user(2.5 * (points @ turn) + [1.0, 2.0, 3.0], normals @ turn)
    start = turn @ Rotation.from_rotvec([0.1, -0.08, 0.05]).as_matrix()
    refined = refine_pose(DensePoints.from_user(points, normals), source, start, correspondence=correspondence)
    assert refined.status is Status.CONVERGED
    assert rotation_angle_deg(refined.R_target_source, turn) < 0.01
    assert refined.scale == pytest.approx(0.4)
    assert refined.energy < 1e-8 < refined.initial_energy
    moved = refined.scale * source.points @ refined.R_target_source.T + refined.translation
    assert np.allclose(moved, points, atol=1e-4)


def test_without_scale_and_normals(rng: np.random.Generator) -> None:
    points, normals = some_shape()
    turn = Rotation.from_rotvec([0.05, 0.1, 0.0]).as_matrix()
    plain = refine_pose(
        DensePoints.from_user(points), DensePoints.from_user(points @ turn), np.eye(3), estimate_scale=False
    )
    assert plain.scale == 1.0
    assert rotation_angle_deg(plain.R_target_source, turn) < 0.01
    mixed = refine_pose(DensePoints.from_user(points, normals), DensePoints.from_user(points @ turn), np.eye(3))
    assert np.allclose(mixed.R_target_source, plain.R_target_source, atol=1e-3)


def test_far_start_ends_elsewhere() -> None:
    """The recovery test can fail: from half a turn away the answer is another one."""
    points, _ = some_shape()
    shape = DensePoints.from_user(points)
    refined = refine_pose(shape, shape, np.diag([-1.0, -1.0, 1.0]))
    assert rotation_angle_deg(refined.R_target_source) > 30


def test_bad_input_is_refused() -> None:
    points, _ = some_shape(100)
    shape = DensePoints.from_user(points)
    with pytest.raises(InputError, match="one place"):
        DensePoints.from_user(np.ones((5, 3)))
    with pytest.raises(InputError, match="normals"):
        DensePoints.from_user(points, points[:5])
    with pytest.raises(InputError, match="not orthogonal"):
        refine_pose(shape, shape, 2 * np.eye(3))
    with pytest.raises(InputError, match="swap"):
        refine_pose(DensePoints.from_user(points[:20]), shape, np.eye(3), correspondence="assignment")
    with pytest.raises(OptionsError, match="correspondence"):
        refine_pose(shape, shape, np.eye(3), correspondence="guess")
    with pytest.raises(OptionsError, match="normal_weight"):
        refine_pose(shape, shape, np.eye(3), normal_weight=-1)
