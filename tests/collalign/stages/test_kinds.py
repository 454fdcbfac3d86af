"""Kinds of shapes: groups whose nearest kin is far closer than the nearest stranger, and the frames between them."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions
from collalign.confidence.kind_model import MOST_KIN, kin_log_odds, part_log_odds, split_log_odds
from collalign.engine.session import Session
from collalign.products.pair import FormerPairs
from collalign.stages.kinds.find import find_kinds, likely_kin
from collalign.stages.kinds.grouping import group_into, group_shapes
from collalign.stages.kinds.kind_frames import LEAST_AGREEING, agreed_rotation, kind_frames
from collalign.stages.kinds.plan import (
    kinds_of,
    looks_for_kinds,
    options_of_kind,
    plan_kinds,
    settled_kinds,
)
from collalign.stages.kinds.pose_free import NUM_SHELLS, are_described, shell_means
from collalign.stages.shape_stage import prepare_shapes
from data_tools.errors import InputError, OptionsError
from data_tools.io.objects import list_shapes
from data_tools.options import SamplingOptions
from data_tools.poses import APART_DEG
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.pairs.incomplete import without_share
from tests.goldens.inputs import two_kinds
from tests.products import kind_of
from tests.synchronization_problems import small_rotations

OPTIONS = AlignOptions(
    group="SO", sampling=SamplingOptions(num_points=32, num_dense_points=100), maps="never"
)


def log_odds_of(labels, *, kin=6.0, strangers=-2.0, rng=None):
    """Log-odds of shapes whose nearest kin is as close as is said, and whose strangers are."""
    labels = np.asarray(labels)
    odds = np.where(labels[:, None] == labels, kin, strangers).astype(float)
    if rng is not None:
        noise = rng.normal(scale=0.3, size=odds.shape)
        odds += noise + noise.T
    return odds


def as_partition(labels):
    return {tuple(np.flatnonzero(labels == k).tolist()) for k in np.unique(labels)}


@pytest.mark.parametrize("labels", [[0, 0, 0, 1, 1, 1], [0, 1, 0, 1, 2, 2, 0, 1, 2]])
def test_kinds_are_told_apart_whatever_their_order(labels, rng):
    odds = log_odds_of(labels, rng=rng)
    found = group_shapes(odds)
    assert as_partition(found.labels) == as_partition(np.array(labels))
    assert found.labels.tolist()[0] == 0
    assert (found.confidence > 0.95).all()
    order = rng.permutation(len(labels))
    again = group_shapes(odds[np.ix_(order, order)])
    assert as_partition(again.labels[np.argsort(order)]) == as_partition(np.array(labels))


def test_a_gap_that_is_small_or_strangers_that_match_keep_shapes_together(rng):
    labels = [0, 0, 0, 1, 1, 1]
    for kin, strangers, num in (
        (2.0, 0.0, 1),
        (7.0, 0.0, 2),
        (30.0, 3.5, 1),  # they match, however closely others do
    ):
        found = group_shapes(log_odds_of(labels, kin=kin, strangers=strangers))
        assert found.num == num
    copies = [
        group_shapes(log_odds_of(labels, kin=kin)).confidence[0]
        for kin in (0.9 * MOST_KIN, MOST_KIN, 2 * MOST_KIN)
    ]
    assert copies[0] < copies[1] == copies[2], "kin counts as no closer than copies"
    assert group_shapes(log_odds_of([0] * 8, rng=rng)).num == 1


def test_nearest_kin_counts_and_not_all_of_a_kind():
    """A row of shapes, each like its neighbours only, is of one kind; a second row far from it is another."""
    place = np.concatenate([np.arange(6.0), 100.0 + np.arange(6.0)])
    odds = np.maximum(5.0 - 3.0 * (np.abs(place[:, None] - place) - 1.0), -8.0)
    assert as_partition(group_shapes(odds).labels) == {
        tuple(range(6)),
        tuple(range(6, 12)),
    }


def test_known_groups_stay_apart_and_new_shapes_come_to_theirs():
    labels = np.array([0, 0, 0, 0, 1, 1])
    known = np.array([0, 0, 1, 1, -1, -1])
    found = group_shapes(log_odds_of(labels), known=known)
    assert as_partition(found.labels) == {(0, 1), (2, 3), (4, 5)}
    near = log_odds_of([0, 0, 1, 1, 1, 0])
    found = group_shapes(near, known=known)
    assert as_partition(found.labels) == {(0, 1, 5), (2, 3, 4)}


def test_a_few_shapes_that_may_be_parts_are_no_kind_of_their_own():
    labels = [0, 0, 0, 0, 1]
    odds = log_odds_of(labels, kin=9.0)
    assert group_shapes(odds).num == 2
    parts = np.array([False] * 4 + [True])
    assert group_shapes(odds, never_apart=parts).num == 1
    three = log_odds_of([0, 0, 0, 1, 1, 1], kin=9.0)
    assert group_shapes(three, never_apart=np.arange(6) > 2).num == 2


def test_each_shape_is_matched_with_its_likeliest_kin_and_never_with_itself(rng):
    odds = log_odds_of([0, 0, 0, 1, 1, 1], rng=rng)
    assert {(i // 3, j // 3) for i, j in likely_kin(odds, 2)} == {(0, 0), (1, 1)}
    every = likely_kin(odds, 9)
    assert len({*every}) == len(every) == 6 * 5
    assert all(i != j for i, j in every)


@pytest.mark.parametrize("num", [1, 2, 3, 5, 9])
def test_there_are_as_many_groups_as_asked_for(num, rng):
    odds = log_odds_of([0, 0, 0, 1, 1, 1, 2, 2, 2], rng=rng)
    found = group_into(odds, num)
    assert found.num == num == len(np.unique(found.labels))
    if num == 3:
        assert as_partition(found.labels) == {(0, 1, 2), (3, 4, 5), (6, 7, 8)}


def test_what_is_nearer_is_likelier_of_one_kind_and_a_larger_gap_surer():
    near, far = np.array(0.1), np.array(0.4)
    assert kin_log_odds(near, near) > kin_log_odds(far, near) > kin_log_odds(far, far)
    assert kin_log_odds(near, near, near) > kin_log_odds(near, near, far)
    gaps, across = np.array([6.0, 6.0, 3.0]), np.array([0.0, 2.0, 2.0])
    assert (np.diff(split_log_odds(gaps, across)) < 0).all()
    assert split_log_odds(gaps, across)[0] > 0.0 > split_log_odds(np.zeros(1), np.zeros(1))


@pytest.fixture(scope="module")
def mixed():
    """Six blobs and six figures in random poses, and which of the two each is."""
    return two_kinds(6), np.repeat([0, 1], 6)


def _number_of(planted, name):
    return [shape.name for shape in planted.shapes].index(name)


def prepared(session, shapes):
    return prepare_shapes(session, list_shapes({shape.name: shape for shape in shapes}))


def test_descriptors_do_not_depend_on_pose_size_or_side(mixed, rng):
    shape = mixed[0].shapes[0]
    moved = 3.0 * shape.vertices @ random_rotation(rng).T + 5.0
    mirrored = shape.vertices * [1.0, 1.0, -1.0]
    others = [
        Shape.from_arrays(moved, shape.faces, name="moved"),
        Shape.from_arrays(mirrored, shape.faces[:, ::-1], name="mirrored"),
        replace(mixed[0].shapes[7], name="other"),
    ]
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        samples = prepared(session, [shape, *others]).samples
    by_name = {one.name: one for one in samples}
    means = {name: shell_means(one.local) for name, one in by_name.items()}
    assert means["moved"].shape == (33 * NUM_SHELLS,)
    of = means[shape.name]
    near = [float(np.linalg.norm(means[name] - of)) for name in ("moved", "mirrored")]
    assert 4.0 * max(near) < np.linalg.norm(means["other"] - of)
    assert are_described(samples).all()
    assert not are_described([replace(one, local=None) for one in samples]).any()


def test_two_kinds_are_found_and_one_is_not_split(mixed):
    planted, kinds = mixed
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepared(session, planted.shapes)
        truth = np.array([kinds[_number_of(planted, name)] for name in shapes.names])
        found = find_kinds(session, shapes)
        assert found is not None
        assert as_partition(found.labels) == as_partition(truth)
        assert (found.confidence > 0.9).all()
        images = [
            replace(one, rim="open", local=replace(one.local, sights=np.array([[0.0, 0.0, 1.0]])))
            for one in shapes.samples
        ]
        assert find_kinds(session, replace(shapes, samples=images)) is None, "of unlike parts"
        alone = shapes.some(np.flatnonzero(truth == 0).tolist())
        assert find_kinds(session, alone) is None
        halves = find_kinds(session, alone, num=2)
        assert halves is not None
        assert halves.num == 2
        with pytest.raises(OptionsError, match="at most 6"):
            find_kinds(session, alone, num=7)


def test_shapes_of_few_points_hide_no_kinds(mixed):
    planted, kinds = mixed
    few = {one.name for one in (planted.shapes[0], planted.shapes[-1])}
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepared(session, planted.shapes)
        truth = np.array([kinds[_number_of(planted, name)] for name in shapes.names])
        samples = tuple(
            replace(one, local=None) if one.name in few else one for one in shapes.samples
        )
        with_few = replace(shapes, samples=samples)
        found = find_kinds(session, with_few)
        assert found is not None
        assert as_partition(found.labels) == as_partition(truth)
        assert found.log_odds.shape == (len(truth), len(truth))
        firsts = np.unique(found.labels, return_index=True)[1]
        assert (np.diff(firsts) > 0).all()
        other = 1 - truth  # what is known counts more than what is alike
        known = np.where(np.isin(shapes.names, sorted(few)), other, truth)
        assert as_partition(find_kinds(session, with_few, known=known).labels) == as_partition(
            known
        )
        none_left = replace(shapes, samples=tuple(replace(one, local=None) for one in samples))
        assert find_kinds(session, none_left) is None
        with pytest.raises(
            OptionsError,
            match=rf"clusters: 2 kinds .* too few points: {shapes.names[0]}, .* 4 more;",
        ):
            find_kinds(session, none_left, num=2)


def test_what_is_missing_of_shapes_makes_no_kind(mixed):
    planted, kinds = mixed
    rng = np.random.default_rng(2)
    shapes = [planted.shapes[i] for i in np.flatnonzero(kinds == 0)]
    halves = [without_share(one, random_rotation(rng)[0], 0.4) for one in shapes[:3]]
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        assert find_kinds(session, prepared(session, [*halves, *shapes[3:]])) is None
        figures = [planted.shapes[i] for i in np.flatnonzero(kinds == 1)]
        found = find_kinds(session, prepared(session, [*halves, *shapes[3:], *figures[:3]]))
        assert found is not None
        assert found.num == 2


def test_a_part_of_less_energy_is_likelier_of_one_kind():
    odds = part_log_odds(np.array([0.02, 0.04, 0.09]))
    assert (np.diff(odds) < 0.0).all()
    assert odds[0] > 0.0 > odds[2]


def test_one_kind_costs_no_pair(mixed):
    planted, kinds = mixed
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepared(session, [planted.shapes[i] for i in np.flatnonzero(kinds == 1)])
        assert find_kinds(session, shapes) is None
        assert not session.store.keys("pairs")


def test_an_odd_shape_among_one_kind_makes_no_second_kind(mixed):
    planted, kinds = mixed
    chosen = [*np.flatnonzero(kinds == 0), int(np.flatnonzero(kinds == 1)[0])]
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        assert find_kinds(session, prepared(session, [planted.shapes[i] for i in chosen])) is None


def test_most_rotations_agree_or_none_does(rng):
    truth = random_rotation(rng)
    near = truth @ small_rotations(rng, (7,), 8.0)
    far = [random_rotation(rng) for _ in range(2)]
    mean, share = agreed_rotation(np.stack([*near, *far]), 9)
    assert rotation_angle_deg(mean, truth) < APART_DEG / 3
    assert LEAST_AGREEING <= share < 1.0
    assert agreed_rotation(np.stack([random_rotation(rng) for _ in range(9)]), 9)[1] == 0.0


def test_pairs_of_one_shape_are_one_vote(rng):
    same = np.repeat(random_rotation(rng)[None], 9, axis=0)
    shares = [agreed_rotation(same, num)[1] for num in (1, 2, 3, 9)]
    assert shares == pytest.approx([0.0, 2 / 3, 3 / 4, 9 / 10])


def test_a_kind_is_rotated_to_another_that_it_matches(mixed):
    """Two halves of one kind, one of which has another frame: pairs across say how it lies."""
    planted, kinds = mixed
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepared(session, [planted.shapes[i] for i in np.flatnonzero(kinds == 0)])
        at = [_number_of(planted, name) for name in shapes.names]
        turn = random_rotation(np.random.default_rng(3))
        rotations = planted.rotations[at].copy()
        rotations[3:] = turn.T @ rotations[3:]
        halves = [np.arange(3), np.arange(3, 6)]
        odds = np.zeros((6, 6))
        first, second = kind_frames(session, shapes, halves, rotations, odds, root=0, settled={})
        assert first.agreeing == 1.0
        np.testing.assert_array_equal(first.rotation, np.eye(3))
        assert rotation_angle_deg(second.rotation, turn) < 10
        assert LEAST_AGREEING <= second.agreeing < 1.0
        stays = kind_frames(session, shapes, halves, rotations, odds, root=0, settled={1: 0.7})[1]
        assert stays.agreeing == 0.7
        np.testing.assert_array_equal(stays.rotation, np.eye(3))


def test_folders_and_labels_say_kinds():
    names = ["chairs/a", "chairs/old/b", "mugs/a", "c"]
    assert kinds_of("folder", names) == {
        "chairs/a": "chairs",
        "chairs/old/b": "chairs",
        "mugs/a": "mugs",
    }
    assert kinds_of({"mugs/a": "mug", "c": ""}, names) == {"mugs/a": "mug"}
    assert kinds_of("", names) == {}
    with pytest.raises(InputError, match="--recursive"):
        kinds_of("folder", ["a", "b"])
    with pytest.raises(InputError, match="no shape is called 'd'"):
        kinds_of({"d": "x"}, names)
    with pytest.raises(OptionsError, match="expected 'folder'"):
        kinds_of("colour", names)


@pytest.mark.parametrize(
    ("options", "num", "expected"),
    [
        ({}, 6, True),
        ({}, 5, False),
        ({"clusters": 1}, 50, False),
        ({"clusters": 2}, 4, True),
        ({"incomplete": "all"}, 50, False),
        ({"deformable": True}, 50, False),
        ({"preset": "paper"}, 50, False),
    ],
)
def test_kinds_are_looked_for_where_nothing_forbids_it(options, num, expected):
    assert looks_for_kinds(AlignOptions(**options), num) == expected


def test_given_and_former_kinds_are_taken_as_they_are(mixed):
    planted, kinds = mixed
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepared(session, planted.shapes)
        given = {name: "even" if i % 2 else "odd" for i, name in enumerate(shapes.names)}
        plan = plan_kinds(session, shapes, None, given)
        assert plan is not None
        assert {*plan.names} == {"odd", "even"}
        assert np.isnan(plan.confidence).all()
        assert plan.kind_of(shapes.names[2]) == plan.names.index("odd")
        assert plan_kinds(session, shapes, None, dict.fromkeys(shapes.names, "one")) is None
        truth = np.array([kinds[_number_of(planted, name)] for name in shapes.names])
        first = np.flatnonzero(truth[:-1] == truth[0])
        former = FormerPairs(
            num_shapes=len(truth) - 1,
            edges=np.empty((0, 2), dtype=np.int64),
            group="SO",
            kinds=(
                kind_of("blobs", first),
                kind_of(
                    "figures",
                    np.setdiff1d(np.arange(len(truth) - 1), first),
                    frame=0.0,
                    group="O",
                ),
            ),
        )
        plan = plan_kinds(session, shapes, former, {})
        assert plan is not None
        assert {*plan.names} == {"blobs", "figures"}
        assert as_partition(truth) == {tuple(own.tolist()) for own in plan.members}
    assert former.some(former.kinds[1].shapes.tolist()).group == "O"
    called = [[shapes.names[i] for i in own] for own in plan.members]
    assert settled_kinds(former, called, {*shapes.names}) == {0: 1.0, 1: 0.0}
    assert settled_kinds(former, called, {called[0][0]}) == {0: 1.0}


def test_directions_are_those_of_the_kind_of_the_reference():
    options = AlignOptions(reference="a", up="z", front="x", incomplete="b,c")
    own = options_of_kind(options, {"a", "b"}, has_reference=True)
    assert (own.reference, own.up, own.front, own.incomplete) == ("a", "z", "x", "b")
    other = options_of_kind(options, {"d"}, has_reference=False)
    assert (other.reference, other.up, other.front, other.incomplete) == ("", "", "", "never")
