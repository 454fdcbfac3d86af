"""Results of several kinds become one: nothing of a kind is lost or moved but with its frame."""

import dataclasses

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions, align_collection
from collalign.driver.join_kinds import in_frame, join_kinds, kind_notes, unknown_trust
from collalign.products.trust import KINDS
from collalign.stages.kinds.kind_frames import KindFrame
from data_tools.datasets.synthetic import demo_collection
from data_tools.notes import Note
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation
from tests.notes import codes, only

HERE = KindFrame(rotation=np.eye(3), agreeing=1.0)


def aligned(seed, num_points, names):
    options = AlignOptions(
        group="SO", sampling=SamplingOptions(num_points=num_points, num_dense_points=100)
    )
    shapes = demo_collection(seed=seed, num=len(names), resolution=1).shapes
    given = dict(zip(names, shapes, strict=True))
    return align_collection(given, options=options, run=RunOptions(jobs=1), progress=False)


@pytest.fixture(scope="module")
def parts():
    """Two results, of 16 and of 24 points a shape, and names in between each other's."""
    return [aligned(0, 16, ("a", "c", "e")), aligned(1, 24, ("b", "d"))]


@pytest.fixture(scope="module")
def whole(parts):
    turn = random_rotation(np.random.default_rng(2))
    frames = (HERE, KindFrame(rotation=turn, agreeing=0.7))
    return join_kinds("abcde", parts, frames, ("first", "second"), (0.9, 0.8)), turn


def test_each_shape_keeps_its_place_and_all_that_is_known_of_it(parts, whole):
    found, turn = whole
    assert found.names == tuple("abcde")
    assert found.kind_names == ("first", "second", "first", "second", "first")
    assert [kind.shapes.tolist() for kind in found.kinds] == [[0, 2, 4], [1, 3]]
    assert [kind.frame for kind in found.kinds] == [1.0, 0.7]
    for part, rotation in zip(parts, (np.eye(3), turn), strict=True):
        for name in part.names:
            np.testing.assert_allclose(
                found[name].transform[:3], rotation @ part[name].transform[:3], atol=1e-12
            )
            assert found[name].confidence == part[name].confidence
            assert found[name].digest == part[name].digest
    assert found.samples.shape == (5, 24)
    assert len(found.pairs) == 4
    assert found.pairs["b", "d"].energy == parts[1].pairs["b", "d"].energy
    assert found.made.trust is not None
    assert found.made.trust.evidence.shape == (5, len(KINDS))
    np.testing.assert_array_equal(found.made.trust.evidence[[1, 3]], parts[1].made.trust.evidence)


def test_points_correspond_within_a_kind_only(parts, whole):
    found = whole[0]
    np.testing.assert_array_equal(found.maps["c", "a"][:16], parts[0].maps["c", "a"])
    assert (found.maps["c", "a"][16:] == -1).all()
    assert (found.maps["b", "a"] == -1).all()
    assert found.landmarks.shape == (5, 16 + 24, 3)
    assert np.isnan(found.landmarks[0, 16:]).all()
    np.testing.assert_allclose(found.landmarks[1, 16:], parts[1].landmarks[0], atol=1e-9)
    np.testing.assert_allclose(found.consensus[16:], parts[1].consensus @ whole[1].T, atol=1e-12)


def test_a_frame_is_rotated_with_all_that_lies_in_it(parts):
    turn = random_rotation(np.random.default_rng(5))
    turned = in_frame(parts[0], turn)
    np.testing.assert_allclose(turned.rotations, turn @ parts[0].rotations, atol=1e-12)
    for poses, before in zip(turned.alternatives, parts[0].alternatives, strict=True):
        for pose, one in zip(poses, before, strict=True):
            np.testing.assert_allclose(pose.rotation, turn @ one.rotation, atol=1e-12)
    back = in_frame(turned, turn.T)
    np.testing.assert_allclose(back.positions, parts[0].positions, atol=1e-12)


def test_notes_of_several_kinds_are_said_once(parts):
    notes = (Note("doubtful", ("a",)), Note("fewer-points", values={"num": 3, "asked": 9}))
    first = dataclasses.replace(parts[0], notes=notes)
    other = dataclasses.replace(parts[1], notes=(Note("doubtful", ("b",)), notes[1]))
    found = join_kinds("abcde", (first, other), (HERE, HERE), ("x", "y"), (0.9, 0.9))
    assert codes(found.notes) == ["doubtful", "kind-of"]
    assert only(found.notes, "doubtful").shapes == ("a", "b")
    assert only(found.notes, "kind-of").values == {
        "of_kind": "x, y",
        "of_code": "fewer-points",
        "num": 3,
        "asked": 9,
    }


def test_what_is_said_of_kinds_depends_on_who_said_them(whole):
    found = whole[0]
    assert codes(kind_notes(found.kinds, found.names, are_given=True)) == [
        "kinds-given",
        "kinds-posed",
    ]
    (note, _) = kind_notes(found.kinds, found.names, are_given=False)
    assert note.values["confidence"] == 0.8
    apart = [found.kinds[0], dataclasses.replace(found.kinds[1], frame=0.0)]
    (_, note) = kind_notes(apart, found.names, are_given=True, named=["up"])
    assert (note.code, note.values) == ("kinds-apart", {"kinds": ("second",), "named": ("up",)})
    alone = [found.kinds[0], dataclasses.replace(found.kinds[1], shapes=np.array([1]))]
    assert only(kind_notes(alone, found.names, are_given=True), "kind-alone").shapes == ("b",)


def test_nothing_is_known_of_shapes_without_evidence():
    assert np.isnan(unknown_trust(2).evidence).all()
    assert [one.shape for one in unknown_trust(2).symmetries] == [(1, 3, 3)] * 2
