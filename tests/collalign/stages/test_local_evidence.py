"""What neighbourhoods say of whole shapes: mismatch of candidates, and rotations that they propose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.confidence.candidate_model import candidate_costs
from collalign.stages.local_evidence import (
    local_evidence,
    proposed_rotations,
    rigid_overlap,
)
from collalign.stages.match_pairs import match_pair
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.embedding import sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.poses import pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from pairwise import MatchOptions
from tests.products import samples_at

MIRROR = np.diag([-1.0, 1.0, 1.0])
TURN = random_rotation(np.random.default_rng(12))


def sampled(vertices, faces):
    shape = Shape.from_arrays(vertices, faces, name="s")
    return sample_shape(
        shape, SamplingOptions(num_points=16, num_dense_points=0), EmbeddingOptions()
    )


@pytest.fixture(scope="module")
def shapes():
    """A blob, the same moved, and its mirror image moved, which lie on the first one at TURN."""
    whole = blob(np.random.default_rng(7), num_vertices=700)
    moved = whole.vertices @ TURN
    return (
        sampled(whole.vertices, whole.faces),
        sampled(2.0 * moved + 3.0, whole.faces),
        sampled(moved @ MIRROR, whole.faces[:, ::-1]),
    )


def test_neighbourhoods_match_at_the_right_rotation_alone(shapes, rng):
    rotations = np.stack([TURN, *(random_rotation(rng) for _ in range(4)), TURN @ MIRROR])
    mismatch, overlap = local_evidence(shapes[0], shapes[1], rotations)
    assert mismatch[0] < mismatch[1:].min() - 0.15
    assert overlap[0] > 0.9 > overlap[1:].max()
    of_mirrored, _ = local_evidence(shapes[0], shapes[2], rotations)
    assert of_mirrored[5] == pytest.approx(mismatch[0], abs=0.05)
    assert of_mirrored[5] < np.delete(of_mirrored, 5).min() - 0.15


def test_the_most_that_surfaces_overlap_is_that_of_the_best_rotation_refined(shapes, rng):
    off = Rotation.from_rotvec([0.3, 0.0, -0.2]).as_matrix()
    far, near = random_rotation(rng), TURN @ off
    assert rigid_overlap(shapes[0], shapes[1], far[None]) < 0.95
    assert local_evidence(shapes[0], shapes[1], near[None])[1] < 0.98
    assert rigid_overlap(shapes[0], shapes[1], np.stack([far, near])) > 0.95
    assert rigid_overlap(shapes[0], shapes[2], (TURN @ MIRROR @ off)[None]) > 0.95
    assert rigid_overlap(shapes[0], samples_at(np.eye(3)), near[None]) == 0.0


def test_shapes_of_hardly_any_points_say_nothing(shapes):
    few = samples_at(np.eye(3))
    assert few.local is None
    mismatch, overlap = local_evidence(few, shapes[0], TURN[None])
    assert np.isnan([mismatch, overlap]).all()
    assert proposed_rotations(shapes[0], few, "SO", TURN[None]).shape == (0, 3, 3)


def test_a_pair_keeps_the_mismatch_of_each_candidate_and_adds_proposed_ones(shapes, monkeypatch):
    found = match_pair(shapes[0], shapes[1], "SO", MatchOptions())
    assert len(found.mismatches) == len(found.energies) == len(found.rotations) == len(found.maps)
    best = np.argmin(candidate_costs(found.energies, found.mismatches))
    assert pose_angle_deg(found.rotations[best, :3, :3], TURN) < 5.0
    # Nothing overlaps convincingly any more: what neighbourhoods propose joins, by energy.
    other = random_rotation(np.random.default_rng(1))
    monkeypatch.setattr("collalign.stages.match_pairs.CONVINCING", 2.0)
    monkeypatch.setattr("collalign.stages.match_pairs.proposed_rotations", lambda *_: other[None])
    more = match_pair(shapes[0], shapes[1], "SO", MatchOptions())
    assert len(more.energies) == len(found.energies) + 1
    assert pose_angle_deg(more.rotations, other).min() < 1e-3
    assert (np.diff(more.energies) >= 0).all()
    at = int(np.argmin(pose_angle_deg(more.rotations, other)))
    costs = ((shapes[1].positions @ other.T - shapes[0].positions[more.maps[at]]) ** 2).sum()
    costs += ((shapes[1].invariants - shapes[0].invariants[more.maps[at]]) ** 2).sum()
    assert more.energies[at] == pytest.approx(costs)
    assert more.mismatches[at] == pytest.approx(
        local_evidence(shapes[0], shapes[1], other[None])[0][0]
    )
