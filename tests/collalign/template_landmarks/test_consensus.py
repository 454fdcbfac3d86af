"""Templates that agree count alike; one whose landmarks are elsewhere or in another order is found and named."""

import numpy as np
import pytest

from collalign.template_landmarks.consensus import (
    OrderMistake,
    agreement_notes,
    geometric_median,
    order_mistakes,
    template_trust,
)
from data_tools.notes import Note

NUM = 12
LABELS = tuple(f"LM{at}" for at in range(1, NUM + 1))
#: Standard deviation of a hand.
HAND = 0.01


@pytest.fixture
def places(rng):
    """Landmarks of five templates, on one mean surface."""
    return rng.standard_normal((NUM, 3)) + HAND * rng.standard_normal((5, NUM, 3))


def kinds(points):
    return [one.kind for one in order_mistakes(points)[0]]


def test_the_median_is_the_place_of_least_summed_distance(rng):
    points = rng.standard_normal((5, 4, 3))
    points[1, 2] = np.nan
    points[:, 3] = np.nan
    found = geometric_median(points)

    def cost(place, at):
        return np.nansum(np.linalg.norm(points[:, at] - place, axis=1))

    for at in range(3):
        around = found[at] + 0.01 * rng.standard_normal((50, 3))
        assert cost(found[at], at) < 1.0001 * min(cost(place, at) for place in around)
        mean = np.nanmean(points[:, at], axis=0)
        assert cost(mean, at) > 1.001 * cost(found[at], at), "the check notices a mean"
    assert np.isnan(found[3]).all()


def test_a_template_far_from_the_others_does_not_count_and_one_of_two_does(places):
    places[1, 4] += 1.0
    trust = template_trust(places[:3])
    assert trust[1, 4] == 0
    assert (trust > 0).sum() == 3 * NUM - 1
    assert (template_trust(places[:2]) == 1).all()
    assert (template_trust(places[:1]) == 1).all()


@pytest.mark.parametrize("num", [2, 3, 5])
def test_swapped_landmarks_are_found_in_the_template_that_is_outvoted(places, num):
    places[1, [2, 11]] = places[1, [11, 2]]
    (mistake,), wrong = order_mistakes(places[:num])
    assert (mistake.kind, mistake.rows, mistake.places) == ("swapped", (2, 11), (11, 2))
    assert mistake.decided == (num > 2)
    assert {mistake.template, mistake.other} >= {1}
    rows = [1] if num > 2 else [0, 1]
    assert np.argwhere(wrong).tolist() == [[row, at] for row in rows for at in (2, 11)]


@pytest.mark.parametrize("num", [2, 4])
def test_other_mistakes_of_order_are_named(places, num):
    def changed(order):
        points = np.array(places[:num])
        points[0] = points[0][order]
        return points

    every = np.arange(NUM)
    assert kinds(changed(every[::-1])) == ["reversed"]
    assert kinds(changed(np.roll(every, 1))) == ["shifted"]
    assert kinds(changed([*every[:4], *np.roll(every[4:7], 1), *every[7:]])) == ["exchanged"]
    forgotten = np.array(places[:num])
    forgotten[0, 4:-1], forgotten[0, -1] = places[0, 5:], np.nan
    (mistake,), wrong = order_mistakes(forgotten)
    assert (mistake.kind, mistake.rows) == ("shifted", tuple(range(4, NUM - 1)))
    assert wrong[0].tolist() == [4 <= at < NUM - 1 for at in range(NUM)]


def test_two_mistakes_in_two_of_five_templates_are_found_in_both(places):
    places[0, [0, 1]] = places[0, [1, 0]]
    places[3, [5, 6]] = places[3, [6, 5]]
    mistakes, _ = order_mistakes(places)
    assert [(one.template, one.rows, one.decided) for one in mistakes] == [
        (0, (0, 1), True),
        (3, (5, 6), True),
    ]


def test_notes_name_a_mistake_once_and_far_landmarks_with_their_distances():
    errors = np.full((3, NUM), 0.01)
    errors[0, [2, 11]] = 4.0
    errors[1, 5] = 2.0
    trust = np.ones((3, NUM))
    trust[0, [2, 11]] = trust[1, 5] = 0
    swapped = OrderMistake(
        kind="swapped", template=0, other=1, rows=(2, 11), places=(11, 2), decided=True
    )
    notes = agreement_notes([swapped], ["a", "b", "c"], LABELS, errors, np.ones(3), trust)
    values = {"kind": "swapped", "labels": ("LM3", "LM12"), "places": ("LM12", "LM3")}
    assert notes == (
        Note("templates-reordered", ("a",), values),
        Note("templates-disagree", ("b",), {"labels": ("LM6",), "distances": (2.0,)}),
    )
    far = agreement_notes([], ["a", "b"], LABELS, errors[1:], np.ones(2), np.ones((2, NUM)))
    assert [note.shapes for note in far] == [("a", "b")]
    large = agreement_notes(
        [], ["a", "b"], LABELS, errors[1:], np.full(2, 100.0), np.ones((2, NUM))
    )
    assert large == (), "a hundredth of the radius is what a hand errs"
    assert (
        agreement_notes([], ["a"], LABELS, np.full((1, NUM), np.nan), np.ones(1), trust[:1]) == ()
    )
