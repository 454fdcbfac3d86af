from dataclasses import dataclass

import numpy as np
import pytest

from collalign.engine.store import fingerprint, pair_seed
from data_tools.io.source import DIGEST_LENGTH


@dataclass(frozen=True)
class Options:
    num_points: int = 64
    weight: float = 0.5


def test_a_key_changes_with_version_options_and_content_only():
    key = fingerprint("1", Options(), "aa", "bb")
    assert len(key) == DIGEST_LENGTH
    assert key == fingerprint("1", {"weight": 0.5, "num_points": np.int64(64)}, "aa", "bb")
    others = [
        fingerprint("2", Options(), "aa", "bb"),
        fingerprint("1", Options(num_points=65), "aa", "bb"),
        fingerprint("1", Options(), "bb", "aa"),
        fingerprint("1", Options(), "aabb"),
        fingerprint("1", Options(), "aa"),
    ]
    assert len({key, *others}) == 6


def test_whole_floats_count_as_integers_but_not_as_flags():
    assert fingerprint("1", {"w": 1.0}) == fingerprint("1", {"w": 1})
    assert fingerprint("1", {"w": True}) != fingerprint("1", {"w": 1})


def test_options_of_other_kinds_are_refused():
    with pytest.raises(TypeError):
        fingerprint("1", {"f": print})


def test_pair_seeds_depend_on_seed_and_both_names_in_order():
    seeds = {
        pair_seed(0, "a", "b"),
        pair_seed(0, "b", "a"),
        pair_seed(1, "a", "b"),
        pair_seed(0, "ab", ""),
    }
    assert len(seeds) == 4
    assert pair_seed(0, "a", "b") == pair_seed(0, "a", "b")
    assert all(0 <= seed < 2**63 for seed in seeds)
