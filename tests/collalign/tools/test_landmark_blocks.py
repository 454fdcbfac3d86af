"""Blocks of landmarks are read as they are meant, and what goes together is in the tables."""

import numpy as np
import pytest

from collalign.analysis.integration import two_block_pls
from collalign.tools.variation.landmark_blocks import (
    SEPARATELY,
    TOGETHER,
    integration_tests,
    read_blocks,
)
from data_tools.errors import InputError
from data_tools.rotations import random_rotation

NAMES = tuple(f"LM{at}" for at in range(1, 13))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["face=LM1..LM3"], "two blocks or more"),
        (["face=LM1..LM3", "LM4..LM6"], "expected a name and landmarks"),
        (["face=LM1..LM3", "=LM4..LM6"], "expected a name and landmarks"),
        (["face=LM1..LM3", "base="], "expected a name and landmarks"),
        (["face=LM1..LM3", "face=LM4..LM6"], "two called 'face'"),
        (["face=LM1..LM3", "base=LM3..LM6"], "LM3 is in face and in base"),
        (["face=LM1..LM3", "base=LM4,LM5,LM4"], "base has 2 landmarks"),
        (["face=LM3..LM1", "base=LM4..LM6"], "LM3 comes after LM1"),
        (["face=LM1..LM3", "base=LM4..LM66"], "no landmark is called 'LM66'"),
    ],
)
def test_what_are_no_blocks_is_refused(asked, said):
    with pytest.raises(InputError, match=said):
        read_blocks(asked, NAMES)
    with pytest.raises(InputError, match="name files"):
        read_blocks(asked, ())


def test_blocks_that_change_together_are_told_from_one_that_does_not():
    """Two blocks follow one factor each shape, the third its own; poses and sizes are random."""
    rng = np.random.default_rng(0)
    base, change = rng.standard_normal((2, 12, 3))
    factors = np.repeat(rng.standard_normal((30, 2)), [8, 4], axis=1)
    points = base + 0.15 * factors[:, :, None] * change + 0.02 * rng.standard_normal((30, 12, 3))
    points = np.array(
        [rng.uniform(1, 3) * one @ random_rotation(rng).T + rng.random(3) for one in points]
    )
    blocks = {"a": [0, 1, 2, 3], "b": [4, 5, 6, 7], "c": [8, 9, 10, 11]}
    names = [f"s{at}" for at in range(30)]
    tables, notes = integration_tests(names, points, blocks, permutations=199, seed=0)
    head, *rows = tables["integration"]
    found = {tuple(row[:3]): dict(zip(head, row, strict=True)) for row in rows}
    pairs = [("a", "b"), ("a", "c"), ("b", "c")]
    assert [*found] == [(*pair, way) for way in (TOGETHER, SEPARATELY) for pair in pairs]
    together = found["a", "b", SEPARATELY]
    assert together["r_PLS"] > 0.9
    assert (together["P"], together["P_Holm"]) == (0.005, pytest.approx(0.015))
    assert (together["shapes"], together["landmarks_first"], together["landmarks_second"]) == (
        *(30, 4, 4),
    )
    for pair in pairs[1:]:
        assert found[*pair, SEPARATELY]["P"] > 0.05
        assert found[*pair, SEPARATELY]["Z"] < together["Z"]
    assert [(note.values["first"], note.values["second"]) for note in notes] == pairs
    assert notes[0].values["r"] == found["a", "b", TOGETHER]["r_PLS"]
    _, *scores = tables["pls_scores"]
    assert len(scores) == 6 * 30
    mine = np.array([row[4:] for row in scores if row[:3] == ["a", "b", SEPARATELY]])
    np.testing.assert_allclose(np.corrcoef(mine.T)[0, 1], together["r_PLS"])
    alone = [
        points[:, rows] - points[:, rows].mean(axis=1, keepdims=True) for rows in blocks.values()
    ]
    unturned = two_block_pls(alone[0].reshape(30, -1), alone[1].reshape(30, -1), permutations=99)
    assert not np.isclose(unturned.r, together["r_PLS"], atol=1e-3), "poses are taken out"
