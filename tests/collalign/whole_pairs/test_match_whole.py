"""Two whole shapes: candidates by energy, the mismatch of each, and those that neighbourhoods propose."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.confidence.candidate_model import candidate_costs
from collalign.whole_pairs.local_evidence import local_evidence
from collalign.whole_pairs.match_whole import match_whole
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.embedding import sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from pairwise import MatchOptions

TURN = random_rotation(np.random.default_rng(12))


@pytest.fixture(scope="module")
def pair():
    """A blob, and the same that lies on it at TURN."""
    whole = blob(np.random.default_rng(7), num_vertices=700)
    sampling = SamplingOptions(num_points=16, num_dense_points=0)
    return [
        sample_shape(Shape.from_arrays(places, whole.faces, name="s"), sampling, EmbeddingOptions())
        for places in (whole.vertices, 2.0 * whole.vertices @ TURN + 3.0)
    ]


def test_the_right_pose_costs_least_and_an_exact_one_nothing(pair):
    found, mismatches = match_whole(*pair, "SO", MatchOptions())
    energies = np.array([one.energy for one in found.candidates])
    assert len(mismatches) == len(energies)
    assert (np.diff(energies) >= 0).all()
    best = int(np.argmin(candidate_costs(energies, mismatches)))
    assert pose_angle_deg(found.candidates[best].R_target_source, TURN) < 5.0
    assert energies[0] == 0.0
    unlike = replace(pair[1], coordinates=1.1 * pair[1].coordinates)
    assert match_whole(pair[0], unlike, "SO", MatchOptions())[0].energy > 0.0


def test_where_nothing_overlaps_what_neighbourhoods_propose_joins(pair, monkeypatch):
    before, _ = match_whole(*pair, "SO", MatchOptions())
    other = random_rotation(np.random.default_rng(1))
    whole = "collalign.whole_pairs.match_whole"
    monkeypatch.setattr(f"{whole}.CONVINCING", 2.0)
    monkeypatch.setattr(f"{whole}.proposed_rotations", lambda *_: other[None])
    found, mismatches = match_whole(*pair, "SO", MatchOptions())
    assert len(found.candidates) == len(before.candidates) + 1
    assert (np.diff([one.energy for one in found.candidates]) >= 0).all()
    at = [one.origin for one in found.candidates].index("neighbourhoods")
    proposed = found.candidates[at]
    np.testing.assert_array_equal(proposed.R_target_source, other)
    target, source = pair
    matched = proposed.map_target_source
    costs = ((source.positions @ other.T - target.positions[matched]) ** 2).sum()
    costs += ((source.invariants - target.invariants[matched]) ** 2).sum()
    assert proposed.energy == pytest.approx(costs)
    assert mismatches[at] == pytest.approx(local_evidence(target, source, other[None])[0][0])
