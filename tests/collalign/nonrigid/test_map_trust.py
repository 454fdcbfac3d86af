"""How far maps can be trusted: what speaks for a map raises its confidence, wrong places lower their own."""

from types import SimpleNamespace

import numpy as np
import pytest

from collalign.nonrigid.map_options import NonrigidOptions
from collalign.nonrigid.portfolio import (
    MOST_LEAD,
    SCORE_SCALE,
    point_terms,
    standing,
    support,
    trust_of,
)
from collalign.nonrigid.ranked import chosen_first

NUM = 50
ANGLES = np.arange(NUM) * 2 * np.pi / NUM
CIRCLE = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(NUM)])
SHAPE = SimpleNamespace(
    vertices=CIRCLE, dense=np.arange(NUM), nearest_dense=np.arange(NUM), area=1.0
)


def candidate(forward, score, *, commutativity=0.1, orientation=1.0):
    """Return a candidate map of the circle to itself, with its inverse."""
    maps = SimpleNamespace(
        map_target_source=forward, map_source_target=np.argsort(forward, kind="stable")
    )
    evidence = SimpleNamespace(commutativity=commutativity, orientation=orientation)
    return SimpleNamespace(functional_map=maps, evidence=evidence, score=score)


SAME, TURNED, BACKWARDS = np.arange(NUM), np.roll(np.arange(NUM), 20), np.arange(NUM)[::-1].copy()


def test_agreement_and_lead_are_those_of_the_candidates():
    found = [candidate(SAME, -2.0), candidate(SAME, -1.9)]
    agreement, lead = standing(SHAPE, found, 0)
    assert agreement == 1.0
    assert lead == MOST_LEAD  # who says the same is no rival
    found = [candidate(SAME, -2.0), candidate(TURNED, -1.5)]
    agreement, lead = standing(SHAPE, found, 0)
    assert agreement == pytest.approx(1.0 / (1.0 + np.exp(-0.5 / SCORE_SCALE)))
    assert lead == 0.5
    assert standing(SHAPE, found, 1)[1] == -0.5


def test_the_choice_is_what_others_agree_with_and_keeps_the_sides():
    best, many = (
        candidate(TURNED, -2.0),
        [candidate(np.roll(SAME, shift), -1.9) for shift in (0, 0)],
    )
    first, second, _ = chosen_first(SHAPE, [*many, best], NonrigidOptions())
    assert first is many[0]
    assert second is best
    mixed = [
        candidate(SAME, -2.0, orientation=0.1),
        candidate(TURNED, -2.0),
        candidate(SAME, -2.0, orientation=0.2),
    ]
    assert chosen_first(SHAPE, mixed[:2], NonrigidOptions())[0] is mixed[1]
    assert chosen_first(SHAPE, mixed, NonrigidOptions())[0] is mixed[2]
    swapped = [candidate(BACKWARDS, -2.0, orientation=-1.0), candidate(SAME, -1.9)]
    assert chosen_first(SHAPE, swapped, NonrigidOptions())[0] is swapped[1]
    assert chosen_first(SHAPE, swapped, NonrigidOptions(orientation="any"))[0] is swapped[0]


def test_maps_that_swap_sides_have_support_only_among_their_like():
    agreement = np.array([0.9, 0.2])
    assert support(agreement, np.array([-0.5, 0.5]))[0] == -np.inf
    both = support(agreement, np.array([-0.5, -0.5]))
    assert np.isfinite(both).all()
    assert both[0] > both[1]
    assert np.isfinite(support(agreement, np.full(2, np.nan))).all()


def test_points_that_candidates_take_elsewhere_or_that_do_not_come_back_are_doubted():
    torn = SAME.copy()
    torn[:10] = 25
    found = [candidate(SAME, -2.0), candidate(torn, -2.0)]
    at_points = point_terms(SHAPE, SHAPE, found, 0)[:, 0]
    assert at_points[:10].max() < at_points[10:].min()
    returns = point_terms(SHAPE, SHAPE, found, 1)[:, 1]
    assert returns[:10].max() < returns[30:].min()
    whole, vertices = trust_of(SHAPE, SHAPE, found)
    assert 0.0 < whole < 1.0
    assert vertices[:10].max() < vertices[30:].min()
