"""Steps of averaging, and what they do with measurements that nothing else supports."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.synchronization.averaging import (
    MAX_STEP_RAD,
    average_frames,
    gauss_newton_step,
    maximise_likelihood,
)
from collalign.synchronization.graph import PairGraph
from collalign.synchronization.model import EdgeModel
from data_tools.rotations import rotation_angle_deg
from pairwise.rotation_pattern import RotationPattern

FIRST = np.array([[0, 1]])


def about_z(*degrees):
    return Rotation.from_rotvec(np.deg2rad(degrees)[:, None] * [0.0, 0.0, 1.0]).as_matrix()


def free(num):
    """All shapes may move but the first one."""
    return np.arange(num) > 0


@pytest.mark.parametrize("pull", [0.1, 5.0])
def test_a_step_is_cut_where_the_quadratic_model_ends(pull):
    """The tangent step is the pull of the measurement over the weight of the pair."""
    targets, frames = pull * about_z(90.0), np.tile(np.eye(3), (2, 1, 1))
    moved, step = gauss_newton_step(frames, FIRST, targets, np.ones(1), free(2))
    assert step == pytest.approx(pull)
    taken = np.deg2rad(rotation_angle_deg(moved[0], moved[1]))
    assert taken == pytest.approx(2.0 * np.arctan(min(pull, MAX_STEP_RAD) / 2.0))


def test_a_shape_that_no_trusted_pair_holds_follows_its_best_candidate():
    edges = np.array([[0, 1], [1, 2]])
    truth = about_z(0.0, 20.0, 140.0)
    relative = truth[edges[:, 0]] @ truth[edges[:, 1]].transpose(0, 2, 1)
    graph = PairGraph.of_candidates(
        edges,
        [(one[None], np.ones(1)) for one in relative],
        num_shapes=3,
        pattern=RotationPattern.from_user(None, 3, "SO"),
    )
    frames = about_z(0.0, -20.0, -20.0)  # the second pair is 120 degrees off, and trusted by nobody
    model = EdgeModel(graph=graph, noise_rad=np.deg2rad(3.0))
    _, found = maximise_likelihood(model, frames, free(3), estimate=False)
    left, right = found[edges[:, 0]], found[edges[:, 1]]
    for edge in range(2):
        assert rotation_angle_deg(left[edge], relative[edge] @ right[edge]) < 1.0


@pytest.mark.parametrize("start_deg", [0.0, 40.0])
def test_the_average_is_the_median_of_rotations_about_one_axis(start_deg):
    """Weights of one over the residual; one over its square would stay with the nearest measurement."""
    measured = about_z(0.0, -10.0, -40.0)[None]
    frames = about_z(0.0, start_deg)
    found = average_frames(frames, FIRST, measured, np.ones((1, 3)), free(2))
    assert rotation_angle_deg(found[0], about_z(0.0)[0]) < 1e-9
    assert rotation_angle_deg(found[1], about_z(10.0)[0]) < 0.5
