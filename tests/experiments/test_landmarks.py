"""Landmarks carried in other ways: what the figures count, and that each way finds a shifted copy again."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import crown
from data_tools.surface.shape import Shape
from experiments.peers.warps import WARPS


@pytest.mark.parametrize("way", [way for way, warp in WARPS.items() if not warp.lacks])
def test_every_way_finds_a_shifted_copy_again(way):
    source = crown(np.random.default_rng(0))
    target = Shape.from_arrays(source.vertices + 0.02, source.faces)
    marks = source.vertices[::150]
    found = WARPS[way].carry(target, source, marks)
    assert np.median(np.linalg.norm(found - (marks + 0.02), axis=1)) < 0.03
