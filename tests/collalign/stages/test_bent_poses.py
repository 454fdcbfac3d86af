"""Poses of bent shapes: every pair measured in several ways, each trusted by how well it agrees with itself."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.products.shapes import Constraints
from collalign.stages.poses.bent import _nearest_map, _trust, numbers_of_samples
from collalign.stages.poses.refinement import refine_poses
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.synchronization.averaging import average_frames, residuals_deg
from collalign.synchronization.frames import transposed
from data_tools.rotations import random_rotation, rotation_angle_deg
from tests.collalign.stages.test_pose_refinement import posed_crowns
from tests.products import pair_of

NUM = 5
EDGES = np.array(list(itertools.combinations(range(NUM), 2)))


@pytest.fixture
def session():
    with Session.open(AlignOptions(group="O"), RunOptions(jobs=1)) as opened:
        yield opened


def turned(rotations, angle_deg, rng):
    """Return rotations that are off by about an angle, each about an axis of its own."""
    axes = rng.standard_normal((len(rotations), 3))
    axes *= np.deg2rad(angle_deg) / np.linalg.norm(axes, axis=1, keepdims=True)
    return np.asarray(Rotation.from_rotvec(axes).as_matrix() @ rotations)


def true_pairs(truth):
    return np.stack([truth[i].T @ truth[j] for i, j in EDGES])


def weighed_pairs(measured):
    """Return pairs whose one candidate is that of a map."""
    return [
        pair_of(
            [rotation], [0.1], target=int(i), source=int(j), num_samples=32, log_odds=np.zeros(1)
        )
        for (i, j), rotation in zip(EDGES, measured, strict=True)
    ]


def noisy_crowns(rng, noise):
    """Return one crown in several poses, its samples moved by some noise."""
    samples, turns = posed_crowns(rng, NUM, num_points=32, num_dense=0)
    moved = [item.positions + noise * rng.standard_normal(item.positions.shape) for item in samples]
    return [
        replace(item, positions=p, coordinates=p) for item, p in zip(samples, moved, strict=True)
    ], turns


def largest_error(rotations, truth):
    return float(rotation_angle_deg(true_pairs(rotations), true_pairs(truth)).max())


@pytest.mark.parametrize(("map_error", "noise"), [(6.0, 0.0), (0.01, 0.03)])
def test_the_way_that_agrees_with_itself_decides(session, rng, map_error, noise):
    samples, truth = noisy_crowns(rng, noise)
    pairs = weighed_pairs(turned(true_pairs(truth), map_error, rng))
    solution = synchronize_pairs(session.options, NUM, pairs)
    without_maps = [replace(pair, log_odds=np.array([-np.inf])) for pair in pairs]
    refined = refine_poses(session, samples, pairs, solution, Constraints())
    others = refine_poses(session, samples, without_maps, solution, Constraints())
    assert largest_error(refined, truth) < 0.3
    worse = others if noise else solution.rotations
    assert largest_error(worse, truth) > 1.0


def test_poses_set_by_hand_stay(session, rng):
    samples, truth = noisy_crowns(rng, 0.02)
    pairs = weighed_pairs(turned(true_pairs(truth), 5.0, rng))
    fixed = {1: truth[1], 3: truth[3]}
    solution = synchronize_pairs(session.options, NUM, pairs, Constraints(fixed=fixed))
    refined = refine_poses(session, samples, pairs, solution, Constraints(fixed=fixed))
    for shape, pose in fixed.items():
        assert np.array_equal(refined[shape], solution.rotations[shape])
        assert np.allclose(refined[shape], pose)
    assert not np.allclose(refined[0], solution.rotations[0], atol=1e-4)


@pytest.mark.parametrize(
    ("most", "numbers"), [(64, [12, 16, 24, 32, 48, 64]), (24, [12, 18, 24]), (12, [12]), (9, [9])]
)
def test_shares_of_few_samples_are_not_counted_twice(most, numbers):
    assert numbers_of_samples(most) == numbers


def test_the_likeliest_candidate_near_the_pose_is_the_maps(rng):
    asked = random_rotation(rng)
    poses = np.stack(
        [np.diag([1.0, -1, -1]) @ asked, *turned(np.stack([asked, asked, asked]), 10.0, rng)]
    )
    pair = pair_of(poses, np.ones(4), log_odds=np.array([9.0, 1.0, 2.0, -np.inf]))
    assert np.array_equal(_nearest_map(pair, asked), poses[2])
    assert not _nearest_map(pair, np.diag([-1.0, 1, -1]) @ asked).any()
    unweighed = replace(pair, log_odds=np.zeros(0), energies=np.array([0.1, 0.3, 0.2, 0.4]))
    assert np.array_equal(_nearest_map(unweighed, asked), poses[2])


def test_least_deviations_forgive_one_wrong_measurement(rng):
    truth = np.stack([random_rotation(rng) for _ in range(NUM)])
    right = true_pairs(truth)
    measured = np.stack([right, turned(right, 1.0, rng)], axis=1)
    measured[3, 1] = turned(right[3:4], 25.0, rng)[0]
    start = transposed(turned(truth, 8.0, rng))
    start[0] = truth[0].T
    free = np.arange(NUM) > 0
    even = np.ones((len(EDGES), 2))
    found = average_frames(start, EDGES, measured, even, free)
    assert residuals_deg(found, EDGES, measured[:, :1]).max() < 1.0
    assert np.array_equal(found[0], start[0])
    trusting = average_frames(start, EDGES, measured, even * [1.0, 0.0], free)
    assert residuals_deg(trusting, EDGES, measured[:, :1]).max() < 1e-3
    assert average_frames(start, EDGES, measured, 0.0 * even, free) is start
    swapped = average_frames(start, EDGES, measured[:, ::-1], even, free)
    assert np.allclose(swapped, found, atol=1e-9)


def test_a_way_that_most_pairs_lack_is_not_trusted(rng):
    truth = np.stack([random_rotation(rng) for _ in range(NUM)])
    right, free = true_pairs(truth), np.arange(NUM) > 0
    frames = transposed(truth)
    exact = _trust(frames, EDGES, right[:, None], np.ones(len(EDGES), dtype=bool), free)
    loose = _trust(
        frames, EDGES, turned(right, 10.0, rng)[:, None], np.ones(len(EDGES), dtype=bool), free
    )
    assert exact == pytest.approx(0.1**-3.0)
    assert 0 < loose < 1e-3 * exact
    assert _trust(frames, EDGES, right[:, None], np.arange(len(EDGES)) < 4, free) == 0
