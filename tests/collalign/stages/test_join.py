"""Scans joined by overlaps: poses of a ring, weak links, parts, and blocks that are wrong in agreement."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.confidence.overlap_model import (
    ORDER_ODDS,
    ROUGH_ODDS,
    chances_of,
    overlap_log_odds,
)
from collalign.products.shapes import Constraints
from collalign.stages.incomplete import join
from collalign.stages.incomplete.join import join_scans
from collalign.stages.incomplete.scans import log_odds_of
from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.generated.rooms import depth_frames, room, way_round
from pairwise.features.overlap import LocalPoses, closeness

NUM = 8
#: Share of consistent matches of a pair that is sure, and of one that is not.
SURE, WEAK = 1.0, 0.1


@pytest.fixture(scope="module")
def scans():
    """Views of a blob all around it, each moved, and the pose of each."""
    rng = np.random.default_rng(4)
    whole = blob(np.random.default_rng(1), num_vertices=1500)
    cell = 0.1 * centre_and_radius(whole)[1]
    poses, surfaces = np.tile(np.eye(4), (NUM, 1, 1)), []
    for i, angle in enumerate(2.0 * np.pi * np.arange(NUM) / NUM):
        poses[i, :3, :3], poses[i, :3, 3] = random_rotation(rng), 3.0 * rng.standard_normal(3)
        points = range_view(whole, np.array([np.cos(angle), np.sin(angle), 0.2]), rng=rng)
        own = (points - poses[i, :3, 3]) @ poses[i, :3, :3]
        surfaces.append(surface_cells(Shape.from_arrays(own, name=f"view{i}"), cell))
    return surfaces, poses


def link(poses, i, j, *consensus, wrong=None):
    """What a pair says: its pose, a little wrong, and perhaps another one, with their shares of matches."""
    rng = np.random.default_rng(100 * i + j)
    right = np.linalg.inv(poses[i]) @ poses[j]
    nearly = Rotation.from_rotvec(0.02 * rng.standard_normal(3)).as_matrix() @ right[:3, :3]
    rotations = np.stack([nearly] if wrong is None else [nearly, wrong @ nearly])
    num = len(rotations)
    centre = (
        -poses[j, :3, 3] @ poses[j, :3, :3]
    )  # of the blob, about which the pose is a little wrong
    shifts = (
        right[:3, :3] @ centre + right[:3, 3] - rotations @ centre + 0.01 * rng.standard_normal(3)
    )
    return LocalPoses(
        rotations=rotations,
        shifts=shifts,
        overlaps=np.full((num, 2), 0.8),
        mismatch=np.zeros(num),
        consensus=np.array(consensus),
        in_front=np.full((num, 2), np.nan),
        beside=np.full((num, 2), np.nan),
    )


def errors_deg(joined, poses, members=None):
    """Errors of the poses of some scans relative to the first one of them."""
    chosen = np.arange(len(poses)) if members is None else np.array(members)
    frames = joined.transforms[chosen, :3, :3] @ np.swapaxes(poses[chosen, :3, :3], 1, 2)
    return pose_angle_deg(frames, frames[0])


def joined_by(surfaces, overlaps, hinted=None):
    """Scans joined by pairs, to whose log-odds hints add."""
    hinted = hinted or {}
    odds = {
        pair: overlap_log_odds(poses) + hinted.get(pair, 0.0) for pair, poses in overlaps.items()
    }
    return join_scans(dict(enumerate(surfaces)), overlaps, odds, num=len(surfaces))


def ring(poses):
    pairs = [*((i, i + 1) for i in range(NUM - 1)), (0, NUM - 1)]
    return {pair: link(poses, *pair, SURE) for pair in pairs}


def test_a_ring_is_joined_and_sure(scans):
    surfaces, poses = scans
    joined = joined_by(surfaces, ring(poses))
    assert errors_deg(joined, poses).max() < 1.0
    moved = joined.transforms @ np.linalg.inv(poses)
    middles = moved[:, :3, :3] @ np.array([0.1, 0.1, 0.1]) + moved[:, :3, 3]
    assert np.linalg.norm(middles - middles[0], axis=1).max() < surfaces[0].cell
    assert (joined.confidence > 0.99).all()
    assert [part.tolist() for part in joined.parts] == [[*range(NUM)]]
    assert {*joined.kept} == {*ring(poses)}
    assert min(one.overlap[0] for one in joined.kept.values()) > 0.4
    again = joined_by(surfaces, ring(poses))
    np.testing.assert_array_equal(again.transforms, joined.transforms)


def test_behind_a_weak_link_of_a_chain_scans_are_in_doubt(scans):
    surfaces, poses = scans
    chain = {(i, i + 1): link(poses, i, i + 1, WEAK if i == 4 else SURE) for i in range(NUM - 1)}
    joined = joined_by(surfaces, chain)
    weak = float(chances_of(overlap_log_odds(chain[4, 5]))[0])
    assert 0.5 < weak < 0.7
    assert errors_deg(joined, poses).max() < 4.0  # errors of a chain add up
    assert joined.confidence[:5].min() > 0.95
    assert joined.confidence[5:] == pytest.approx(np.full(3, weak), abs=1e-6)
    assert len(joined.cuts) == NUM - 1
    [weakest] = [cut for cut in joined.cuts if cut.held < 2.0]
    assert weakest.members.tolist() == [5, 6, 7]


def test_what_no_overlap_joins_is_a_part_of_its_own(scans):
    surfaces, poses = scans
    told = {(i, i + 1): link(poses, i, i + 1, SURE) for i in (0, 1, 2, 4, 5)}
    told[3, 4] = link(poses, 3, 4, 0.001)
    joined = joined_by(surfaces, told)
    assert [part.tolist() for part in joined.parts] == [[0, 1, 2, 3], [4, 5, 6], [7]]
    for part in joined.parts[:2]:
        assert errors_deg(joined, poses, part).max() < 3.0
        assert joined.confidence[part].min() > 0.9
    assert joined.confidence[7] == 0.0
    alone = joined_by(surfaces, {})
    assert len(alone.parts) == NUM
    assert not alone.confidence.any()
    assert not alone.kept


def test_a_wrong_link_beside_right_ones_holds_nothing(scans):
    surfaces, poses = scans
    told = ring(poses) | {(0, 2): link(poses, 0, 2, SURE), (2, 4): link(poses, 2, 4, SURE)}
    told[1, 5] = link(
        poses, 1, 5, 0.001, SURE, wrong=Rotation.from_rotvec([1.0, 0.5, 0.0]).as_matrix()
    )[[1]]
    joined = joined_by(surfaces, told)
    assert errors_deg(joined, poses).max() < 1.0
    assert (1, 5) not in joined.kept
    assert (0, 2) in joined.kept
    assert any(cut.against for cut in joined.cuts)  # it is heard, ...
    assert max(cut.against for cut in joined.cuts) <= 0  # ... but contradicted by what was seen


def test_a_sure_wrong_link_does_not_win_against_what_was_seen(scans):
    surfaces, poses = scans
    turn = Rotation.from_rotvec([0.0, 1.0, 0.3]).as_matrix()
    told = {(i, i + 1): link(poses, i, i + 1, SURE) for i in (0, 1, 2, 4, 5, 6)}
    told[3, 4] = link(poses, 3, 4, 0.001, SURE, wrong=turn)
    told[2, 4] = link(poses, 2, 4, WEAK)
    joined = joined_by(surfaces, told)
    assert errors_deg(joined, poses).max() < 8.0  # errors of a chain add up
    assert (3, 4) not in joined.kept


def test_only_contradictions_that_decide_are_looked_at(scans, monkeypatch):
    surfaces, poses = scans
    turn = Rotation.from_rotvec([0.0, 1.0, 0.3]).as_matrix()
    told = ring(poses) | {
        (i, i + 2): link(poses, i, i + 2, 0.3, SURE, wrong=turn) for i in range(NUM - 2)
    }
    look, looks, judge = join.sight_conflicts, [], join._contradictions

    def counted(*ends):
        looks.append(ends)
        return look(*ends)

    monkeypatch.setattr(join, "sight_conflicts", counted)
    joined, num_looks = joined_by(surfaces, told), len(looks)
    monkeypatch.setattr(join, "_contradictions", lambda *ends, **_: judge(*ends))
    exhaustive = joined_by(surfaces, told)
    assert num_looks < len(looks) - num_looks
    np.testing.assert_array_equal(joined.transforms, exhaustive.transforms)
    np.testing.assert_array_equal(joined.confidence, exhaustive.confidence)
    assert errors_deg(joined, poses).max() < 1.0


def test_what_is_in_front_of_what_was_seen_puts_a_block_in_doubt(scans, monkeypatch):
    surfaces, poses = scans
    told = {(i, i + 1): link(poses, i, i + 1, SURE) for i in range(NUM - 1)}
    sure = joined_by(surfaces, told).confidence
    assert sure.min() > 0.95

    def in_front(target, source, rotations, shifts):
        crosses = any(one is surfaces[0] for one in (target, source))
        return np.full((len(rotations), 2), 0.06 if crosses else 0.0), np.zeros((len(rotations), 2))

    monkeypatch.setattr(join, "sight_conflicts", in_front)
    joined = joined_by(surfaces, told)
    assert joined.confidence[0] < 0.5
    assert joined.confidence[1:].min() > 0.95


def test_walls_on_walls_are_contradicted_by_what_stands_there():
    rng = np.random.default_rng(0)
    way = way_round(20, rng)[[0, 1, 10]]
    frames = depth_frames(room(rng), way, rng)
    surfaces = [surface_cells(frame, 0.1, of_scene=True) for frame in frames]
    assert all(len(surface.places) for surface in surfaces)
    assert join._contradictions(surfaces, way, np.array([0]), np.array([1])) < 0.5
    turned = way.copy()
    turned[2] = np.diag([-1.0, -1.0, 1.0, 1.0]) @ way[2]  # the opposite wall on this one
    relative = np.linalg.inv(turned[0]) @ turned[2]
    pose = relative[None, :3, :3], relative[None, :3, 3]
    assert closeness(surfaces[0], surfaces[2], *pose)[0].max() >= 0.5
    assert join._contradictions(surfaces, turned, np.array([0]), np.array([2])) > 2.0
    turned[2, :3, 3] += 50.0  # what shares nothing says nothing
    assert join._contradictions(surfaces, turned, np.array([0]), np.array([2])) < 0.1


def test_a_hint_joins_what_is_nearly_sure_and_no_hint_joins_what_is_not(scans):
    surfaces, poses = scans
    chain = {(i, i + 1): link(poses, i, i + 1, 0.02 if i == 4 else SURE) for i in range(NUM - 1)}
    assert len(joined_by(surfaces, chain).parts) == 2
    hinted = {(4, 5): np.array([2.0])}
    joined = joined_by(surfaces, chain, hinted=hinted)
    assert len(joined.parts) == 1
    assert errors_deg(joined, poses).max() < 4.0
    against = {(3, 4): np.array([-9.0])}
    assert len(joined_by(surfaces, chain, hinted=against).parts) == 3
    hopeless = chain | {(4, 5): link(poses, 4, 5, 1e-4)}
    few = joined_by(surfaces, hopeless, hinted={(4, 5): np.array([0.5])})
    assert len(few.parts) == 2


def test_the_order_and_rough_poses_speak_for_pairs_of_scans(scans):
    _, poses = scans
    wrong = Rotation.from_rotvec([0.0, 0.0, 1.5]).as_matrix()
    overlaps = {
        (i, j): link(poses, i, j, 0.1, 0.1, wrong=wrong) for i, j in [(0, 1), (0, 2), (1, 2)]
    }
    plain = {pair: overlap_log_odds(poses) for pair, poses in overlaps.items()}

    def hints(**known):
        odds = log_odds_of(overlaps, Constraints(**known))
        return {pair: np.round(odds[pair] - plain[pair], 9).tolist() for pair in overlaps}

    none = {pair: [0.0, 0.0] for pair in overlaps}
    assert hints() == none
    ordered = [ORDER_ODDS, ORDER_ODDS]
    assert hints(order=(2, 0, 1)) == none | {(0, 1): ordered, (0, 2): ordered}
    rough = {(1, 2): overlaps[1, 2].rotations[:1]}
    assert hints(candidates=rough) == none | {(1, 2): [ROUGH_ODDS, -ROUGH_ODDS]}
    both = hints(candidates=rough, order=(1, 2))
    np.testing.assert_allclose(both[1, 2], [ORDER_ODDS + ROUGH_ODDS, ORDER_ODDS - ROUGH_ODDS])
