"""Landmarks carried in other ways: what the figures count, and that each way finds a shifted copy again."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import crown
from data_tools.surface.shape import Shape
from experiments.peers.landmarks import template_rows
from experiments.peers.warps import WARPS


def test_rows_count_coverage_ranks_and_gain():
    errors, radii = np.array([[1.0, 2.0], [3.0, np.nan]]), np.array([[2.0, 3.0], [2.5, np.nan]])
    (row,) = template_rows(
        "teeth", 7, {"carried 7": errors, "radii 7": radii, "closest 7": np.full((2, 2), 4.0)}
    )
    assert row["answered"] == 75
    assert row["gain"] == 50
    assert np.isclose(float(str(row["covered"])), 200 / 3)
    assert np.isclose(float(str(row["ranked"])), 0.5)


@pytest.mark.parametrize("way", [way for way, warp in WARPS.items() if not warp.lacks])
def test_every_way_finds_a_shifted_copy_again(way):
    source = crown(np.random.default_rng(0))
    target = Shape.from_arrays(source.vertices + 0.02, source.faces)
    marks = source.vertices[::150]
    found = WARPS[way].carry(target, source, marks)
    assert np.median(np.linalg.norm(found - (marks + 0.02), axis=1)) < 0.03
