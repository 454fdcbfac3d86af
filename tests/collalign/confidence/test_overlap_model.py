"""How probable poses of two surfaces are by what both share, and that none of them may be right."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.confidence.overlap_model import (
    HARMLESS,
    MOST_CERTAIN,
    chances_of,
    conflict_log_odds,
    on_whole_log_odds,
    overlap_log_odds,
)
from pairwise.features.overlap import LocalPoses


def poses_of(*shares, in_front=np.nan, beside=0.0):
    """Poses of these overlaps and shares of consistent matches, and of points that contradict what was seen."""
    overlaps, consensus = np.array(shares, dtype=float).reshape(-1, 2).T
    return LocalPoses(
        rotations=np.tile(np.eye(3), (len(shares), 1, 1)),
        shifts=np.zeros((len(shares), 3)),
        overlaps=np.stack([overlaps, overlaps], axis=1),
        mismatch=np.zeros(len(shares)),
        consensus=consensus,
        in_front=np.full((len(shares), 2), in_front),
        beside=np.full((len(shares), 2), beside + 0.0 * in_front),
    )


def overlap_chances(poses):
    """How probable poses of a pair are."""
    return chances_of(overlap_log_odds(poses))


@pytest.mark.parametrize(
    "shares", [[(0.5, 0.1)], [(0.5, 0.1), (0.6, 0.05), (0.0, 0.0)], [(0.0, 0.0)] * 6]
)
def test_chances_with_none_sum_to_one(shares):
    poses = poses_of(*shares)
    chances, odds = overlap_chances(poses), overlap_log_odds(poses)
    none = 1.0 / (1.0 + np.exp(odds).sum())
    assert chances.sum() + none == pytest.approx(1.0)
    assert (chances > 0).all()


def test_more_overlap_and_more_matches_make_a_pose_more_probable():
    low, middle, high = (overlap_chances(poses_of((share, share)))[0] for share in (0.1, 0.3, 0.6))
    assert low < 0.2 < middle < high
    first, second = overlap_chances(poses_of((0.6, 0.1), (0.5, 0.1)))
    assert first > second
    alone, with_rival = (
        overlap_chances(poses_of(*given))[0] for given in ([(0.6, 0.1)], [(0.6, 0.1)] * 2)
    )
    assert with_rival < 0.6 * alone + 0.1


def test_a_part_all_of_which_lies_on_a_whole_is_sure():
    part, views = poses_of((1.0, 0.05)), poses_of((0.5, 0.05))
    part.overlaps[:, 0] = 0.3
    assert overlap_chances(part)[0] > 0.7
    assert overlap_chances(views)[0] < 0.3
    assert overlap_chances(poses_of((1.0, 0.0)))[0] < 0.9, "matches must agree as well"


def test_what_lies_in_front_of_what_was_seen_contradicts_a_pose():
    unknown, clear, little, much = (
        overlap_chances(poses_of((0.6, 0.1), in_front=share))[0]
        for share in (np.nan, 0.0, 0.01, 0.1)
    )
    assert clear > 0.95 > unknown > 0.3
    assert clear > little > much
    assert much < 0.2
    beside = overlap_chances(poses_of((0.6, 0.1), in_front=0.0, beside=0.1))[0]
    assert beside < 0.5
    one_sided = poses_of((0.6, 0.1), in_front=0.1)
    one_sided.in_front[0, 0] = np.nan
    assert overlap_chances(one_sided)[0] == unknown


def scene_poses(*, overlaps=(0.5, 0.5), mismatch=0.6, consensus=0.15, in_front=(0.0, 0.0)):
    """One pose of two images of a room: nothing is known beside them."""
    return replace(
        poses_of((0.5, consensus)),
        overlaps=np.array([overlaps]),
        mismatch=np.array([mismatch]),
        in_front=np.array([in_front]),
        beside=np.full((1, 2), np.nan),
    )


def test_in_a_scene_both_images_share_much_and_what_they_share_is_alike():
    usual = overlap_chances(scene_poses())[0]
    assert 0.5 < usual < overlap_chances(scene_poses(mismatch=0.55))[0]
    assert overlap_chances(scene_poses(mismatch=0.9))[0] < 0.5 * usual
    # A wall that is all of one image lies on walls at many places.
    assert overlap_chances(scene_poses(overlaps=(0.1, 0.9)))[0] < 0.5 * usual
    mismatch_of_things = [
        overlap_chances(replace(poses_of((0.6, 0.1)), mismatch=np.array([one])))[0]
        for one in (0.2, 0.8)
    ]
    assert mismatch_of_things[0] == mismatch_of_things[1]


def test_in_a_scene_either_camera_contradicts_and_one_place_is_enough():
    none, one, both, unknown = (
        overlap_chances(scene_poses(in_front=shares))[0]
        for shares in ((0.0, 0.0), (0.02, 0.0), (0.02, 0.02), (0.02, np.nan))
    )
    assert none > one > both
    assert unknown == one
    odds = conflict_log_odds(np.array([[0.05, 0.0], [0.05, 0.05]]), np.full((2, 2), np.nan))
    assert 0.0 < odds[0] == pytest.approx(0.5 * odds[1])
    assert not conflict_log_odds(np.full((1, 2), 0.5 * HARMLESS), np.full((1, 2), np.nan)).any()


def test_no_pose_is_certain_and_no_poses_have_no_chances():
    assert overlap_chances(poses_of((1.0, 1.0)))[0] <= MOST_CERTAIN
    assert overlap_chances(poses_of()).shape == (0,)


def test_poses_on_a_whole_are_judged_by_what_lies_on_it_what_hides_it_and_how_much_it_covers():
    def odds(source, covered, in_front):
        poses = poses_of((0.5, 0.1))
        poses = replace(
            poses,
            overlaps=np.array([[covered, source]]),
            in_front=np.array([[in_front, np.nan]]),
        )
        return float(on_whole_log_odds(poses)[0])

    assert odds(1.0, 0.3, 0.0) > odds(0.8, 0.3, 0.0)
    assert odds(1.0, 0.3, 0.0) > odds(1.0, 0.3, 0.2)
    assert odds(1.0, 0.3, 0.0) > odds(1.0, 0.1, 0.0)
    assert odds(1.0, 0.3, np.nan) == odds(1.0, 0.3, 0.0), "nothing is known of what is hidden"
    assert odds(0.3, 0.3, 0.0) < 0 < odds(1.0, 0.4, 0.0)
