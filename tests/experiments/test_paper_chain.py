"""The paper's own chain of non-rigid matching runs to its end, and its ICP finds a rotation."""

import numpy as np
import pytest

from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.spectral_shape import prepare_surface
from data_tools.datasets.synthetic import bent, shuffled
from data_tools.datasets.synthetic_shapes import figure
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.maps.evaluation import MapEvaluator
from experiments.maps.paper_chain import PaperChain, icp, match_by_paper
from pairwise.results import Status

SMALL = SurfaceOptions(num_functions=45, num_samples=60, num_dense=300)


@pytest.mark.parametrize("is_fast", [False, True])
def test_the_chain_runs_to_the_end(is_fast):
    rng, shape = np.random.default_rng(3), figure()
    posed = bent(shape, rng, angle=0.6)
    source, truth = shuffled(
        Shape.from_arrays(posed.vertices @ random_rotation(rng).T, posed.faces), rng
    )
    chain = PaperChain(
        is_fast=is_fast, num_source=20, bandwidth=1, time_limit_s=4.0, num_candidates=2
    )
    match, status = match_by_paper(
        prepare_surface(shape, SMALL), prepare_surface(source, SMALL), chain
    )
    assert status in (Status.CONVERGED, Status.TIME_LIMIT, Status.STALLED)
    assert match.candidates[0].origin == ("fast" if is_fast else "paper")
    assert match.functional_map.shape == (31, 31)
    rotation = match.functional_map[1:, 1:]
    assert rotation @ rotation.T == pytest.approx(np.eye(30), abs=1e-9)
    chosen = np.linspace(0, len(truth) - 1, 100).astype(int)
    errors = MapEvaluator(shape, truth[chosen]).errors(match.point_map_target_source[chosen])
    assert errors.direct.mean() < 0.25


def test_icp_finds_the_rotation(rng, monkeypatch):
    target = rng.standard_normal((150, 4)) * [3.0, 2.0, 1.0, 0.5]
    rotation = random_rotation(rng, 4)
    order = rng.permutation(150)
    source = target[order] @ rotation
    tilt = np.eye(4)
    tilt[:2, :2] = [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
    found = icp(target, source, tilt @ rotation)
    assert np.abs(found.C_source_target.T - rotation).max() < 1e-9
    assert np.array_equal(found.map_target_source, order)
    monkeypatch.setattr("experiments.maps.paper_chain._MOST_STEPS", 1)
    assert np.abs(icp(target, source, tilt @ rotation).C_source_target.T - rotation).max() > 1e-9
