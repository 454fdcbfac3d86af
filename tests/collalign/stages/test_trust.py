"""Confidence comes from pairs as first matched and from rival poses; what is symmetric or wrong is in doubt."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.confidence.pose_model import (
    MOST_CONFIDENT,
    cycle_log_odds,
    is_as_good,
    limited,
    noise_of_excess,
    pose_confidence,
    probability,
    resembles_none,
    symmetric_confidence,
)
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints
from collalign.products.trust import DOUBT, KINDS, UNCERTAIN, Trust
from collalign.stages.trust.assess import (
    RIVAL_POWER,
    _repeatable,
    gather_trust,
    partners_of,
    with_trust,
)
from collalign.stages.trust.rival_poses import (
    Partner,
    describe_rotations,
    leads_over,
    rival_poses,
)
from collalign.stages.trust.trust_notes import trust_notes
from collalign.synchronization import synchronize
from collalign.whole_pairs.local_evidence import surface_gap
from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.embedding.embedding import sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.notes import codes, only

NUM = 8
HALF_TURN = np.diag([-1.0, -1.0, 1.0])
NO_TURNS = np.zeros((0, 3, 3))


def samples_of(shapes, num_dense_points=200):
    options = SamplingOptions(num_points=16, num_dense_points=num_dense_points)
    return [sample_shape(shape, options, EmbeddingOptions(kind="xyz")) for shape in shapes]


@pytest.fixture(scope="module")
def crowns():
    """Crowns that differ a little, and the pose of each."""
    rng = np.random.default_rng(20161)
    turns = np.stack([random_rotation(rng) for _ in range(NUM)])
    base = crown(num_vertices=500)
    shapes = [bumped(base, rng, rms=0.01) for _ in turns]
    return samples_of(
        [Shape.from_arrays(s.vertices @ R, s.faces) for s, R in zip(shapes, turns, strict=True)]
    ), turns


def pairs_at(rotations, wrong=frozenset()):
    """Return all pairs with the poses that these rotations ask for; those of ``wrong`` shapes half a turn off."""
    pairs = []
    for i, j in itertools.combinations(range(len(rotations)), 2):
        best, other = rotations[i].T @ rotations[j], rotations[i].T @ HALF_TURN @ rotations[j]
        if (i in wrong) != (j in wrong):
            best, other = other, best
        poses, energies = np.stack([best, other]), np.array([0.1, 0.15])
        pairs.append(
            Pair(
                target=i,
                source=j,
                rotations=poses,
                maps=np.zeros((2, 16), dtype=np.int64),
                energies=energies,
            )
        )
    return pairs


def solved(pairs):
    edges = [(pair.target, pair.source) for pair in pairs]
    return synchronize(
        edges,
        np.stack([p.rotations for p in pairs]),
        energies=np.stack([p.energies for p in pairs]),
    )


def trusted(samples, pairs, rotations):
    with Session.open(AlignOptions(group="SO"), RunOptions(jobs=1)) as session:
        return gather_trust(session, samples, pairs, rotations, [np.arange(len(samples))])


@pytest.fixture(scope="module")
def right(crowns):
    """Trust in the true poses."""
    samples, truth = crowns
    return trusted(samples, pairs_at(truth), truth)


@pytest.fixture(scope="module")
def flipped(crowns):
    """Poses of which that of shape 2 is half a turn off, and trust in them."""
    samples, truth = crowns
    poses = truth.copy()
    poses[2] = HALF_TURN @ truth[2]
    return poses, trusted(samples, pairs_at(truth), poses)


def column(trust, kind):
    return trust.evidence[:, KINDS.index(kind)]


def test_right_poses_have_votes_and_margins_and_a_wrong_one_has_neither(right, flipped):
    assert (column(right, "votes") == (NUM - 0.5) / NUM).all()
    assert (column(right, "margin") > 0.05).all()
    assert (pose_confidence(right) >= DOUBT).all()
    trust = flipped[1]
    assert column(trust, "votes")[2] == 0.5 / NUM
    np.testing.assert_allclose(column(trust, "collection votes"), column(trust, "votes").mean())
    assert column(trust, "margin")[2] < 0
    assert column(trust, "block margin")[2] < 0 < column(right, "block margin").min()
    assert np.argmax(column(trust, "misfit")) == 2
    chance = pose_confidence(trust)
    assert chance[2] < 0.2
    assert chance[2] < np.delete(chance, 2).min()


def test_rivals_are_apart_from_the_pose_and_from_each_other(crowns):
    _, truth = crowns
    partners = partners_of(pairs_at(truth), truth)
    rivals = rival_poses(truth[0], partners[0], np.stack([HALF_TURN, np.diag([1.0, -1.0, -1.0])]))
    assert len(rivals) == 2  # a candidate of all pairs is one of the turns
    poses = [truth[0], *rivals]
    angles = [rotation_angle_deg(a, b) for a, b in itertools.combinations(poses, 2)]
    assert np.nanmin(angles) >= 30.0
    assert rival_poses(truth[0], [], NO_TURNS).shape == (0, 3, 3)


def partner_of(poses, excess, log_odds=None):
    """Return a partner that asks for these poses, by default all as likely."""
    odds = np.zeros(len(excess)) if log_odds is None else np.array(log_odds)
    return Partner(
        shape=1, poses=np.stack(poses), excess=np.array(excess), log_odds=odds, energy=0.1
    )


@pytest.mark.parametrize("first", range(3))
def test_of_rivals_with_the_same_support_around_them_the_best_supported_is_tried(first):
    turned = [Rotation.from_euler("z", a, degrees=True).as_matrix() for a in (100, 104, 108)]
    excess = np.array([0.4, 0.1, 0.2])
    order = np.roll(np.arange(3), first)
    partner = partner_of([np.eye(3), *np.array(turned)[order]], [0.0, *excess[order]])
    (rival,) = rival_poses(np.eye(3), [partner], NO_TURNS)
    np.testing.assert_array_equal(rival, turned[1])


def test_the_cost_is_zero_on_itself_and_sees_normals(rng):
    points = rng.standard_normal((40, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert surface_gap((points, normals), (points, normals), np.eye(3)[None]) == pytest.approx(
        0.0, abs=1e-12
    )
    inside_out = surface_gap((points, normals), (points, -normals), np.eye(3)[None])
    assert inside_out > surface_gap((points, normals), (points, np.empty((0, 3))), np.eye(3)[None])
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    assert surface_gap((points, normals), (points @ turn, normals @ turn), turn[None]) < 1e-12


def test_evidence_for_a_pose_never_lowers_its_probability():
    middle = np.array([0.5, 0.2, 0.6, 0.4, 0.0, 0.2, 0.4, 0.0, 20.0, 1.0])
    for at, kind in enumerate(KINDS):
        if "mis" in kind or kind in ("cycles", "block margin"):
            continue  # what only limits
        step = 0.2 * np.eye(len(KINDS))[at]
        assert probability((middle - step)[None]) < probability((middle + step)[None])
    assert np.isnan(probability(np.full((1, len(KINDS)), np.nan))).all()
    assert (
        probability(np.array([[1.0, 9.0, 1.0, 9.0, -1.0, 9.0, 0.1, 0.0, 20.0, 9.0]]))
        == MOST_CONFIDENT
    )


#: No misfit, and nothing known of neighbourhoods.
REST = (0.0, np.nan, np.nan, np.nan, 20.0, 1.0)


def trust_of(evidence, excess, leads=None):
    turns = np.array(
        [Rotation.from_euler("z", r + 1.0).as_matrix() for r in range(len(excess))]
    ).reshape(-1, 3, 3)
    over = np.zeros(len(excess)) if leads is None else np.array(leads)
    return trust_in([[*evidence, *REST]], [turns], [np.array(excess)], [over])


def trust_in(evidence, rivals, excess, leads):
    """Return trust in shapes that no turn leaves as they are."""
    seen, none = np.array(evidence), (np.eye(3)[None],) * len(evidence)
    unknown = tuple(np.full(len(own), np.nan) for own in excess)
    rest = {
        "rivals": tuple(rivals),
        "excess": tuple(excess),
        "local_excess": unknown,
        "leads": tuple(leads),
    }
    return Trust(evidence=seen, symmetries=none, up_to_symmetry=seen, **rest)


def test_what_limits_a_confidence_is_named_and_keeps_the_order_of_chances():
    fine = [1.0, 0.5, 1.0, 4.0, 0.0, 0.5, 0.3, 0.0, 20.0, 1.0]
    changes = {
        "": {},
        "misfit": {"misfit": 2.0},
        "few-shapes": {"cycles": -1.0, "local margin": 0.1},
        "contradicted": {"margin": -0.2, "local margin": -0.1},
        "no-relative": {"mismatch": 1.2, "local misfit": 0.8},
        "block": {"block margin": -2.0},
    }
    evidence = np.tile(np.array(fine), (len(changes), 1))
    for row, change in zip(evidence, changes.values(), strict=True):
        for kind, value in change.items():
            row[KINDS.index(kind)] = value
    for code in changes:
        at = list(changes).index(code)
        stated, codes_of_limits = limited(evidence, np.full(len(evidence), 0.97))
        lower, _ = limited(evidence, np.full(len(evidence), 0.95))
        assert codes_of_limits[at] == code
        assert lower[at] < stated[at] <= 0.97
        assert (stated[at] == 0.97) == (code == "")


def test_rivals_that_fit_as_well_share_the_confidence():
    sure = [1.0, 0.8, 1.0, 4.0]
    for excess, share in (
        ([0.0], 1 / 2),
        ([0.0, 0.01, -0.2], 1 / 4),
        ([0.5, 0.03], 1.0),
        ([], 1.0),
    ):
        assert pose_confidence(trust_of(sure, excess)) == min(share, MOST_CONFIDENT)
    assert (
        pose_confidence(trust_of([0.1, 0.0, 0.1, 0.0], [0.0])) < 0.1
    )  # a tie makes nothing likelier
    assert (
        pose_confidence(trust_of(sure, [0.0, 0.0], [2.0, 0.5])) == 1 / 2
    )  # pairs tell the first apart


def test_cheaper_rivals_are_likelier_and_come_first():
    trust = trust_of([0.7, 0.1, 0.7, 0.5], [0.5, 0.1, 0.3, 0.9])
    first = solved(pairs_at(np.stack([np.eye(3)] * 2)))
    solution, _ = with_trust(first, trust, Constraints())
    (confidence,), (found,) = solution.confidence, solution.alternatives
    np.testing.assert_array_equal([other.rotation for other in found], trust.rivals[0][[1, 2, 0]])
    chances = confidence * np.exp([-other.log_odds for other in found])
    np.testing.assert_allclose(np.diff(np.log(chances)), -RIVAL_POWER * 0.2, rtol=1e-9)
    assert 0.9 * (1.0 - confidence) < chances.sum() < 1.0 - confidence


def test_partners_ask_for_poses_from_both_ends_the_likeliest_and_best_matched_first(rng):
    truth = np.stack([random_rotation(rng) for _ in range(3)])
    pairs = pairs_at(truth)
    pairs[0] = replace(pairs[0], energies=3.0 * pairs[0].energies)
    pairs[1] = replace(
        pairs[1], log_odds=np.array([-1.0, 2.0])
    )  # of shapes 0 and 2; maps say what energies do not
    partners = partners_of(pairs, truth)
    assert [[partner.shape for partner in own] for own in partners] == [[2, 1], [2, 0], [1, 0]]
    for i, own in enumerate(partners):
        for partner in own:
            angles = rotation_angle_deg(
                partner.poses, np.broadcast_to(truth[i], partner.poses.shape)
            )
            assert np.argmin(angles) == int({i, partner.shape} == {0, 2})
            assert min(angles) < 1e-4
            assert partner.excess[0] == 0.0 < partner.excess[1]


def test_the_lead_is_the_mean_over_pairs_and_counts_poses_that_a_pair_did_not_find_as_its_last():
    def turn(angle):
        return Rotation.from_euler("z", angle, degrees=True).as_matrix()

    first = partner_of([turn(5.0), turn(90.0)], [0.0, 3.0], [0.0, -3.0])
    second = replace(
        first, shape=2, poses=np.stack([turn(180.0), turn(0.0)]), log_odds=np.array([0.0, -99.0])
    )
    leads = leads_over(np.eye(3), np.stack([turn(90.0), turn(180.0)]), [first, second])
    np.testing.assert_allclose(leads, [(3.0 + 0.0) / 2, (3.0 - 8.0) / 2])
    assert leads_over(np.eye(3), np.empty((0, 3, 3)), [first]).shape == (0,)


def test_poses_at_which_copies_do_not_fit_are_as_implausible_as_any_unless_copies_are_few():
    turned = Rotation.from_euler("z", 90.0, degrees=True).as_matrix()
    other = partner_of([np.eye(3)], [0.0])
    copy = replace(other, energy=0.0)
    assert leads_over(np.eye(3), turned[None], [copy, copy, other]).tolist() == [16.0 / 3.0]
    assert leads_over(np.eye(3), turned[None], [copy, other]).tolist() == [
        0.0
    ]  # a twin knows of itself alone
    both = replace(partner_of([np.eye(3), turned], [0.0, 0.0]), energy=0.0)
    assert leads_over(np.eye(3), turned[None], [both, both]).tolist() == [0.0]  # a box


def test_alternatives_share_what_the_pose_leaves_and_poses_set_by_hand_are_certain(crowns, right):
    _, truth = crowns
    solution, _ = with_trust(
        solved(pairs_at(truth)),
        right,
        Constraints(fixed=dict(enumerate(truth)), by_hand=frozenset({1})),
    )
    assert solution.confidence[1] == 1.0
    assert (
        np.delete(solution.confidence, 1) < 1.0
    ).all()  # what only stays is no surer than the evidence says
    for confidence, others in zip(
        np.delete(solution.confidence, 1), np.delete(np.arange(NUM), 1), strict=True
    ):
        chances = [confidence * np.exp(-other.log_odds) for other in solution.alternatives[others]]
        assert 0.0 < sum(chances) <= 1.0 - confidence + 1e-9


def test_what_may_be_a_mirror_image_is_trusted_by_one_half(crowns, right):
    pairs = pairs_at(crowns[1])
    plain = with_trust(solved(pairs), right, Constraints())[0].confidence
    limited, codes_of_limits = with_trust(
        solved(pairs), right, Constraints(), {2: 0.5, 5: 0.5}, {3: "cut-off"}
    )
    capped = limited.confidence
    assert [at for at, code in enumerate(codes_of_limits) if code == "side"] == [2, 5]
    assert codes_of_limits[3] == "cut-off"
    assert UNCERTAIN < capped[3] < DOUBT
    assert plain.min() > 0.5
    np.testing.assert_allclose(capped[[2, 5]], 0.5 * plain[[2, 5]])
    np.testing.assert_array_equal(np.delete(capped, [2, 3, 5]), np.delete(plain, [2, 3, 5]))


def test_notes_name_the_doubtful_and_the_contradicted(right, flipped):
    names = [f"shape{i}" for i in range(NUM)]
    poses, trust = flipped
    chance = pose_confidence(trust)
    notes = trust_notes(names, trust, chance, Constraints())
    assert only(notes, "doubtful").shapes == ("shape2",)
    assert "contradicted-by-hand" not in codes(notes)
    by_hand = trust_notes(
        names, trust, chance, Constraints(fixed={2: poses[2]}, by_hand=frozenset({2}))
    )
    assert only(by_hand, "contradicted-by-hand").shapes == ("shape2",)
    kept = Constraints(fixed={2: poses[2]}, fixed_transforms={2: np.eye(4)})
    former = trust_notes(names, trust, chance, kept)
    assert only(former, "contradicted-kept").shapes == ("shape2",)
    assert "contradicted-by-hand" not in codes(former)
    assert not trust_notes(names, right, pose_confidence(right), Constraints())


def test_a_block_that_most_pairs_turn_alike_is_in_doubt(crowns):
    samples, truth = crowns
    block = np.arange(NUM) < 3
    turned = np.where(block[:, None, None], HALF_TURN @ truth, truth)
    both = zip(pairs_at(truth), pairs_at(truth, wrong={0, 1, 2}), strict=True)
    pairs = [wrong if (pair.target + pair.source) % 5 < 3 else pair for pair, wrong in both]
    trust = trusted(samples, pairs, turned)
    assert 0.5 < column(trust, "votes")[block].mean() < 0.8
    assert column(trust, "block margin")[block].max() < 0.0
    assert pose_confidence(trust)[block].max() < DOUBT


def brick(sides, num_dense_points=400):
    """Return a box with points on its faces, and their normals, in a pose that no axis favours."""
    directions, faces = sphere_mesh(900)
    extent = 1.0 / np.abs(directions / sides).max(axis=1)
    turn = random_rotation(np.random.default_rng(3))
    return samples_of(
        [Shape.from_arrays((directions * extent[:, None]) @ turn.T, faces)], num_dense_points
    )[0]


@pytest.mark.parametrize("num_dense_points", [0, 400])
def test_cubes_are_named_as_symmetric_and_in_doubt(num_dense_points):
    poses = np.stack([np.eye(3)] * 4)
    pairs = [replace(pair, energies=np.array([0.1, 0.1])) for pair in pairs_at(poses)]
    trust = trusted([brick(np.ones(3), num_dense_points)] * 4, pairs, poses)
    assert (pose_confidence(trust) <= 0.1).all()
    notes = trust_notes([*"abcd"], trust, pose_confidence(trust), Constraints())
    values = only(notes, "symmetric").values
    assert (values["num"], values["total"]) == (4, 4)
    assert "deg about" in values["rotations"]


def generated(kind, rng):
    """Return a table that a half turn leaves as it is, a cup that any turn does, or a mug, each of its own mesh."""
    directions, faces = sphere_mesh(1200)
    u = directions @ random_rotation(rng)
    around, angle = np.hypot(u[:, 0], u[:, 1]), np.arctan2(u[:, 1], u[:, 0])
    if kind == "table":
        extent = 1.0 / np.maximum(
            around / (1.0 + 0.35 * np.sin(2.0 * angle)), np.abs(u[:, 2]) / 0.6
        )
        extent *= 1.0 + 0.25 * (u[:, 2] > 0.3)
    else:
        extent = 1.0 / np.maximum(around * (1.3 - 0.5 * u[:, 2]), np.abs(u[:, 2]) / 1.2)
    if kind == "mug":
        extent *= 1.0 + 0.5 * np.exp(-8.0 * ((u - [1.0, 0.0, 0.0]) ** 2).sum(axis=1))
    return bumped(Shape.from_arrays(u * extent[:, None], faces), rng, rms=0.005)


@pytest.mark.parametrize(
    ("kind", "num", "words"),
    [("table", 2, "deg about"), ("cup", 12, "any angle about"), ("mug", 1, "")],
)
def test_what_turns_leave_as_it_is_is_right_up_to_them(kind, num, words, rng):
    angles = (
        rng.choice([0.0, 180.0], NUM)
        if kind == "table"
        else rng.uniform(0.0, 360.0 * (kind == "cup"), NUM)
    )
    samples = samples_of([generated(kind, rng) for _ in range(NUM)])
    poses = Rotation.from_euler("z", angles[:, None], degrees=True).as_matrix()
    pairs = pairs_at(poses)
    if kind != "mug":  # energies do not tell which of the two
        pairs = [replace(pair, energies=rng.permutation([0.1, 0.102])) for pair in pairs]
    trust = trusted(samples, pairs, poses)
    assert [len(turns) for turns in trust.symmetries] == [num] * NUM
    absolute, up_to = pose_confidence(trust), symmetric_confidence(trust)
    assert (absolute <= up_to / num).all()
    assert np.median(up_to) > 0.9
    notes = trust_notes([*"abcdefgh"], trust, absolute, Constraints())
    assert ("symmetric" in codes(notes)) == (num > 1)
    if num > 1:
        assert only(notes, "symmetric").values["num"] == 8
        assert words in only(notes, "symmetric").values["rotations"]
        turn = trust.symmetries[0][1]
        assert abs(np.linalg.eigh(turn + turn.T)[1][2, -1]) > 0.99


TWELFTHS = Rotation.from_rotvec(np.outer(np.arange(30.0, 360.0, 30.0), [0, 0, 1]), degrees=True)


@pytest.mark.parametrize(
    ("seem", "are"),
    [
        ((30,), ()),  # twice that is another pose
        ((180,), (180,)),
        ((90, 180, 270), (90, 180, 270)),
        ((30, 60, 180), (180,)),
        ((120, 240, 330), (120, 240)),
        (range(30, 360, 30), range(30, 360, 30)),
        ((), ()),
    ],
)
def test_a_symmetry_may_be_done_again(seem, are):
    angles = np.arange(30, 360, 30)
    frame = random_rotation(np.random.default_rng(0))
    turns = frame @ TWELFTHS.as_matrix() @ frame.T
    found = _repeatable(turns, np.isin(angles, seem))
    assert angles[found].tolist() == [*are]


def test_turns_are_told_by_their_axes():
    quarter = Rotation.from_rotvec([0, 0, 90], degrees=True).as_matrix()
    words = describe_rotations(np.stack([quarter, quarter @ quarter, np.diag([1.0, -1.0, -1.0])]))
    assert words == "90, 180 deg about (0.00, 0.00, 1.00); 180 deg about (1.00, 0.00, 0.00)"
    assert (
        describe_rotations(np.stack([quarter, -np.eye(3)]))
        == "90 deg about (0.00, 0.00, 1.00); mirror images"
    )
    assert describe_rotations(np.diag([1.0, 1.0, -1.0])[None]) == "mirror images"
    skew = [
        Rotation.from_rotvec(v, degrees=True).as_matrix()
        for v in ([90, 90, 0], [90, 0, 90], [0, 90, -90])
    ]
    assert "about 2 more axes" in describe_rotations(
        np.stack([quarter, np.diag([1.0, -1.0, -1.0]), *skew])
    )


def seen_of(**kinds):
    """Return the evidence about one shape whose pose all of it speaks for, but for what is given."""
    usual = {"votes": 0.9, "margin": 0.5, "collection votes": 0.9, "lead": 4.0, "misfit": 0.0}
    local = {"local margin": 0.5, "mismatch": 0.4, "local misfit": 0.0}
    joint = {"cycles": 20.0, "block margin": 1.0}
    known = usual | local | joint | {name.replace("_", " "): value for name, value in kinds.items()}
    return np.array([[known[kind] for kind in KINDS]])


def best_of_two_poses(same, num):
    """Return how few pairs (i < j) the best choice of one of two poses for each shape contradicts."""
    pairs = np.stack(np.triu_indices(num, 1))
    states = np.array([*itertools.product([0, 1], repeat=num - 1)])
    states = np.column_stack([np.zeros(len(states), dtype=int), states])
    return ((states[:, pairs[0]] == states[:, pairs[1]]) != same).sum(axis=1).min()


@pytest.mark.parametrize("num", [3, 5, 8])
def test_pairs_that_choose_between_two_poses_at_random_are_rarely_taken_to_know_them(num, rng):
    num_pairs = num * (num - 1) // 2
    same = rng.random((100, num_pairs)) < 0.5
    odds = [cycle_log_odds(num, num_pairs, best_of_two_poses(one, num)) for one in same]
    assert np.mean(np.array(odds) > 2.0) < 0.1


def test_two_or_three_shapes_never_know_and_many_that_agree_do():
    assert cycle_log_odds(1, 0, 0) == pytest.approx(0.0)
    assert cycle_log_odds(2, 1, 0) < cycle_log_odds(3, 3, 0) < 0.0
    agreeing = [cycle_log_odds(num, num * (num - 1) // 2, 0) for num in range(3, 9)]
    assert (np.diff(agreeing) > 0.5).all()
    contradicted = [cycle_log_odds(6, 15, num) for num in range(6)]
    assert (np.diff(contradicted) < -0.5).all()
    assert contradicted[0] > 4.0 > -3.0 > contradicted[-1]


def test_contradictions_that_scatter_say_less_against_pairs_than_those_that_agree():
    alike, scattered = (cycle_log_odds(40, 200, 70, num_poses=num) for num in (2.0, 8.0))
    assert alike < 0.0 < 50.0 < scattered


def test_cycles_are_those_of_distinct_shapes_and_pairs(crowns, right):
    samples, truth = crowns
    assert (column(right, "cycles") == cycle_log_odds(NUM, NUM * (NUM - 1) // 2, 0)).all()
    pairs = [
        replace(pair, energies=np.array([0.0, 0.1])) if pair.source < 5 else pair
        for pair in pairs_at(truth)
    ]
    copies = trusted(samples, pairs, truth)  # the first five shapes are one
    assert (column(copies, "cycles") == cycle_log_odds(4, 6, 0)).all()
    both = zip(pairs_at(truth), pairs_at(truth, wrong={0, 1, 2, 3}), strict=True)
    mixed = [other if (one.target + one.source) % 2 == 0 else one for one, other in both]
    known = cycle_log_odds(NUM, 28, 8)  # eight pairs ask for the half turn
    assert (column(trusted(samples, mixed, truth), "cycles") == known).all()


def test_a_shape_that_its_own_pairs_contradict_says_nothing_of_the_others(flipped):
    assert (column(flipped[1], "cycles") == cycle_log_odds(NUM - 1, 21, 0)).all()


@pytest.mark.parametrize(
    ("num", "num_contradicted", "block_margin", "is_enough"),
    [
        (3, 0, 0.0, False),
        (3, 0, 0.1, True),
        (5, 0, -0.1, True),
        (6, 4, 0.2, False),
        (9, 0, -0.5, False),
    ],
)
def test_few_shapes_or_contradictory_pairs_need_a_clear_block_margin(
    num, num_contradicted, block_margin, is_enough
):
    cycles = cycle_log_odds(num, num * (num - 1) // 2, num_contradicted)
    seen = seen_of(cycles=cycles, block_margin=block_margin)
    assert probability(seen_of()) > DOUBT
    assert (probability(seen) >= DOUBT) == is_enough


@pytest.mark.parametrize(("num", "is_enough"), [(3, False), (8, True)])
def test_few_shapes_need_neighbourhoods_that_tell_poses_apart(num, is_enough):
    cycles = cycle_log_odds(num, num * (num - 1) // 2, 0)
    clear, vague = (
        probability(seen_of(cycles=cycles, block_margin=0.5, local_margin=margin))
        for margin in (0.3, 0.2)
    )
    assert clear >= DOUBT
    assert (vague >= DOUBT) == is_enough
    assert vague >= UNCERTAIN


def test_a_shape_that_resembles_no_other_is_named_and_limited():
    evidence = np.concatenate(
        [seen_of(), seen_of(mismatch=0.95, local_misfit=0.8), seen_of(mismatch=1.2), seen_of()]
    )
    assert resembles_none(evidence).tolist() == [False, True, False, False]
    assert (probability(evidence) > DOUBT).tolist() == [True, False, True, True]
    empty = [np.zeros((0, 3, 3))] * 4, [np.zeros(0)] * 4, [np.zeros(0)] * 4
    (note, _) = trust_notes(
        [*"abcd"], trust_in(evidence, *empty), probability(evidence), Constraints()
    )
    assert (note.code, note.shapes) == ("resembles-none", ("b",))
    assert note.values == {"mismatch": pytest.approx(0.95), "median": pytest.approx(0.68, abs=0.01)}


def test_a_stranger_costs_the_others_no_confidence(crowns):
    samples, truth = (one[:5] for one in crowns)
    kept = [pair for pair in pairs_at(truth) if 4 not in (pair.target, pair.source)]
    alone = pose_confidence(trusted(samples[:4], kept, truth[:4]))
    samples = [*samples[:4], brick(np.array([1.0, 0.8, 0.6]))]
    to_stranger = [
        pair for pair in pairs_at(truth, wrong={0, 2}) if 4 in (pair.target, pair.source)
    ]
    with_stranger = trusted(samples, kept + to_stranger, truth)
    assert np.flatnonzero(resembles_none(with_stranger.evidence)).tolist() == [4]
    assert (column(with_stranger, "cycles") == cycle_log_odds(4, 6, 0)).all()
    assert np.allclose(pose_confidence(with_stranger)[:4], alone, atol=1e-3)


def test_copies_with_thin_limbs_are_not_symmetric():
    def is_alike(own_mismatch, usual_mismatch=0.0):
        return is_as_good(
            np.array([-0.2]), np.array([0.0]), np.array([own_mismatch]), usual_mismatch
        ).item()

    assert not is_alike(0.43)  # a spider on its copies, after an eighth of a turn
    assert is_alike(0.35)  # a cube
    assert is_alike(0.43, usual_mismatch=0.6)  # what the pairs do not tell apart either
    assert is_alike(np.nan, usual_mismatch=np.nan)


def test_noise_of_excess_is_that_of_two_right_poses():
    """Of points that a half turn leaves as they are, on partners of the same noise: no pose is righter."""
    rng, num, partners = np.random.default_rng(3), 12, 5
    noise = rng.standard_normal((4000, 1 + partners, num, 3))
    own, others = noise[:, :1], noise[:, 1:]
    turned = np.roll(own, num // 2, axis=2) * [-1.0, -1.0, 1.0]
    costs = [((others - lying) ** 2).sum(axis=3).mean(axis=(1, 2)) for lying in (own, turned)]
    found = np.std(np.log(costs[1] / costs[0]))
    assert found == pytest.approx(noise_of_excess(num, partners), rel=0.05)
    assert found != pytest.approx(noise_of_excess(num, 2 * partners), rel=0.05)
    excess = np.array([2.1, 1.9]) * noise_of_excess(num, partners)
    alike = is_as_good(excess, np.zeros(2), np.full(2, np.nan), np.nan, noise=float(found))
    assert alike.tolist() == [False, True]
