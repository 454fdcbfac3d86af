"""Bones of the benchmark are closed and unlike, its errors are right, and a measured tool finds the poses."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from data_tools.datasets.synthetic import write_collection
from data_tools.rotations import random_rotation
from data_tools.surface.topology import is_open_surface
from tests.benchmarks.bench_peers import bones, measure, pair_errors_deg, peak_gib


def test_bones_are_closed_and_no_two_alike() -> None:
    first, second = bones(400, 2).shapes
    assert not is_open_surface(first.vertices, first.faces)
    assert first.area != pytest.approx(second.area, rel=1e-3)


def test_errors_are_those_of_relative_rotations(rng: np.random.Generator) -> None:
    truth = np.stack([random_rotation(rng) for _ in range(3)])
    assert pair_errors_deg(truth, random_rotation(rng) @ truth).max() < 1e-5
    found = truth.copy()
    found[2] = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ found[2]
    np.testing.assert_allclose(pair_errors_deg(truth, found), [0.0, 90.0, 90.0], atol=1e-5)


def test_memory_of_children_counts() -> None:
    before = peak_gib(os.getpid())
    with subprocess.Popen(
        [sys.executable, "-c", "b = b'x' * 2**28; print(flush=True); input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert peak_gib(os.getpid()) > before + 0.25
        child.communicate(b"\n")


def test_a_tool_is_measured(tmp_path: Path) -> None:
    planted = bones(400, 3)
    write_collection(tmp_path, planted)
    (measured,) = measure("axes", tmp_path, planted.rotations)
    assert np.median(measured.errors_deg) < 15
    assert measured.memory_gib > 0.05
