"""Semilandmarks of curves and patches: evenly spaced, counted alike, one table for all templates."""

import numpy as np
import pytest

from collalign.template_landmarks.table import (
    counting_like,
    evenly_spaced,
    landmark_table,
    slider_rows,
)
from data_tools.errors import InputError
from data_tools.landmark_files import Landmarks, Semilandmarks
from data_tools.rotations import random_rotation

STILL = np.eye(4)


def arc(angles):
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])


def gaps(points):
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1))


def curve(points, kind="open curve", name="rim"):
    one = Semilandmarks(name=name, kind=kind, points=points)
    return Landmarks(labels=("tip",), points=np.zeros((1, 3)), semilandmarks=(one,))


def test_unevenly_drawn_curves_are_spaced_evenly():
    drawn = arc(np.array([0.0, 0.1, 0.3, 0.8, 1.0, 1.7, 2.0]))
    spaced = evenly_spaced(drawn, 12, closed=False)
    np.testing.assert_allclose(spaced[[0, -1]], drawn[[0, -1]], atol=1e-9)
    assert gaps(spaced).std() < 0.01 * gaps(spaced).mean()
    assert np.abs(np.linalg.norm(spaced, axis=1) - 1).max() < 0.01
    assert gaps(drawn).std() > 0.3 * gaps(drawn).mean(), (
        "the check would notice curves that are left as they are"
    )


def test_a_closed_curve_goes_all_the_way_round():
    drawn = arc(np.array([0.0, 0.5, 1.5, 2.0, 3.5, 4.0, 5.5]))
    spaced = evenly_spaced(drawn, 20, closed=True)
    np.testing.assert_allclose(spaced[0], drawn[0], atol=1e-9)
    around = gaps(np.vstack([spaced, spaced[:1]]))
    assert around.std() < 0.03 * around.mean()
    assert np.isclose(around.sum(), 2 * np.pi, rtol=0.03)


def test_direction_and_start_do_not_matter():
    closed = arc(np.linspace(0, 2 * np.pi, 9, endpoint=False)) * [2, 1, 1]
    turned = np.roll(closed[::-1], 4, axis=0)
    np.testing.assert_allclose(turned[counting_like(turned, closed, closed=True)], closed)
    line = arc(np.linspace(0, 2, 7))
    np.testing.assert_allclose(line[::-1][counting_like(line[::-1], line, closed=False)], line)


def test_sliders_leave_the_ends_where_they_are():
    assert slider_rows((3, 4, 5, 6), closed=False).tolist() == [[3, 4, 5], [4, 5, 6]]
    assert slider_rows((3, 4, 5), closed=True).tolist() == [[3, 4, 5], [4, 5, 3]]


def test_templates_drawn_in_other_ways_and_poses_agree():
    rng = np.random.default_rng(0)
    pose = np.eye(4)
    pose[:3, :3] = 2 * random_rotation(rng)
    pose[:3, 3] = rng.random(3)
    drawn = arc(np.linspace(0, 2, 6))
    there = (arc(np.linspace(2, 0, 11)) - pose[:3, 3]) @ np.linalg.inv(pose[:3, :3]).T
    table = landmark_table({"a": curve(drawn), "b": curve(there)}, {"a": STILL, "b": pose})
    assert table.labels == ("tip", *(f"rim-{number}" for number in range(1, 7)))
    assert table.semilandmarks == (("rim", "open curve", (1, 2, 3, 4, 5, 6)),)
    assert table.landmark_rows == [0]
    np.testing.assert_allclose(
        table.points["b"][1:] @ pose[:3, :3].T + pose[:3, 3], table.points["a"][1:], atol=5e-3
    )
    more = landmark_table({"a": curve(drawn)}, {"a": STILL}, curve_points=20)
    assert len(more.labels) == 21


def test_what_a_template_lacks_is_missing():
    plain = Landmarks(labels=("tip", "base"), points=np.ones((2, 3)))
    table = landmark_table({"a": curve(arc(np.arange(3.0))), "b": plain}, {"a": STILL, "b": STILL})
    assert np.isnan(table.points["b"]).all(axis=1).tolist() == [False, True, True, True, False]
    assert np.isnan(table.points["a"]).all(axis=1).tolist() == [False, False, False, False, True]


def test_what_does_not_fit_together_is_named():
    open_one, closed = curve(arc(np.arange(4.0))), curve(arc(np.arange(4.0)), "closed curve")
    for given, words in (
        ({}, "no landmark file"),
        ({"a": open_one, "b": closed}, "'rim' is a closed curve here"),
        (
            {"a": curve(arc(np.arange(4.0)), "patch"), "b": curve(arc(np.arange(3.0)), "patch")},
            "has 3 points",
        ),
        (
            {"a": Landmarks(labels=("x", "x"), points=np.ones((2, 3)))},
            "two landmarks are called 'x'",
        ),
        (
            {"a": open_one, "b": Landmarks(labels=("x",), points=np.ones((1, 3)))},
            "no landmark .* has the name",
        ),
    ):
        with pytest.raises(InputError, match=words):
            landmark_table(given, {"a": STILL, "b": STILL})
