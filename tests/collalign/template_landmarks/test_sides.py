"""Landmarks on the other side than their labels say are named, in one specimen without another to compare."""

import numpy as np
import pytest

from collalign.template_landmarks.sides import side_notes, side_pairs

NAMES = ("eye", "ear", "zygo", "canine", "condyle")
LABELS = tuple(f"{side}_{name}" for name in NAMES for side in "LR")


@pytest.fixture
def points(rng):
    """Pairs of landmarks that are nearly symmetric, in any pose."""
    left = rng.uniform(0.5, 2.0, (len(NAMES), 3))
    both = np.stack([left, left * [-1, 1, 1]], axis=1).reshape(-1, 3)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return (both + 0.02 * rng.standard_normal(both.shape)) @ turn.T + 5.0


def codes(points, labels=LABELS):
    return [
        (note.code, note.shapes, note.values["labels"]) for note in side_notes("a", labels, points)
    ]


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("L_eye", "R_eye"),
        ("eye left", "eye right"),
        ("EyeLeft", "EyeRight"),
        ("LEFT-EYE", "RIGHT-EYE"),
        ("zygoL", "zygoR"),
        ("L1", "R1"),
        ("p3L", "p3R"),
        ("eye.l", "eye.r"),
        ("L", "R"),
    ],
)
def test_labels_name_sides_in_many_ways(left, right):
    assert side_pairs(["nasion", right, left]) == [(2, 1)]


@pytest.mark.parametrize(
    "labels", [("tail", "tair"), ("LM1", "RM1x"), ("alar", "arar"), ("L", "l")]
)
def test_letters_inside_words_are_no_sides(labels):
    assert side_pairs(labels) == []


def test_specimens_whose_sides_are_right_or_cannot_be_told_have_no_note(points):
    assert codes(points) == []
    assert codes(points[::-1].copy()) == [], "all the other way round may be right"
    points[0] = np.nan
    assert codes(points) == []
    assert codes(points[2:6], LABELS[2:6]) == [], "two pairs do not outvote each other"
    assert codes(points, [f"LM{at}" for at in range(10)]) == []


@pytest.mark.parametrize("at", range(len(NAMES)))
def test_a_pair_whose_sides_are_exchanged_is_named(points, at):
    points[[2 * at, 2 * at + 1]] = points[[2 * at + 1, 2 * at]]
    assert codes(points) == [
        ("sides-exchanged", ("a",), (f"L_{NAMES[at]} and R_{NAMES[at]}",)),
    ]


def test_landmarks_of_one_side_that_are_exchanged_are_named(points):
    points[[0, 2]] = points[[2, 0]]
    assert codes(points) == [
        ("sides-reordered", ("a",), ("L_eye and R_eye", "L_ear and R_ear")),
    ]
