"""Confidence comes from pairs as first matched and from rival poses; what is symmetric or wrong is in doubt."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.engine.options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.products.collection import DOUBT
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints
from collalign.products.trust import KINDS, Trust
from collalign.stages.trust.assess import gather_trust, partners_of, with_trust
from collalign.stages.trust.model import MOST_CONFIDENT, pose_confidence, probability
from collalign.stages.trust.rivals import rival_poses, surface_cost
from collalign.stages.trust.words import listed, trust_notes
from collalign.synchronization import SynchronizationResult, synchronize
from collalign.synchronization.result import WeakCut
from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape

NUM = 8
HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def samples_of(shapes: list[Shape]) -> list[Samples]:
    options = SamplingOptions(num_points=16, num_dense_points=400)
    return [sample_shape(shape, options, EmbeddingOptions(kind="xyz")) for shape in shapes]


def crowns(rng: np.random.Generator) -> tuple[list[Samples], np.ndarray]:
    turns = np.stack([random_rotation(rng) for _ in range(NUM)])
    base = crown(num_vertices=500)
    shapes = [bumped(base, rng, rms=0.01) for _ in turns]
    return samples_of([Shape.from_arrays(s.vertices @ R, s.faces) for s, R in zip(shapes, turns, strict=True)]), turns


def pairs_at(rotations: np.ndarray, wrong: set[int] = frozenset()) -> list[Pair]:
    """Return all pairs with the poses that these rotations ask for; those of ``wrong`` shapes half a turn off."""
    pairs = []
    for i, j in itertools.combinations(range(len(rotations)), 2):
        best, other = rotations[i].T @ rotations[j], rotations[i].T @ HALF_TURN @ rotations[j]
        if (i in wrong) != (j in wrong):
            best, other = other, best
        poses, energies = np.stack([best, other]), np.array([0.1, 0.15])
        pairs.append(
            Pair(target=i, source=j, rotations=poses, maps=np.zeros((2, 16), dtype=np.int64), energies=energies)
        )
    return pairs


def solved(pairs: list[Pair]) -> SynchronizationResult:
    edges = [(pair.target, pair.source) for pair in pairs]
    return synchronize(edges, np.stack([p.rotations for p in pairs]), energies=np.stack([p.energies for p in pairs]))


def trusted(samples: list[Samples], pairs: list[Pair], rotations: np.ndarray) -> Trust:
    with Session.open(AlignOptions(group="SO"), RunOptions(jobs=1)) as session:
        return gather_trust(session, samples, pairs, rotations, [np.arange(len(samples))])


def column(trust: Trust, kind: str) -> np.ndarray:
    return trust.evidence[:, KINDS.index(kind)]


def test_right_poses_have_votes_and_margins_and_a_wrong_one_has_neither(rng: np.random.Generator) -> None:
    samples, truth = crowns(rng)
    trust = trusted(samples, pairs_at(truth), truth)
    assert (column(trust, "votes") == NUM / (NUM + 1)).all()
    assert (column(trust, "margin") > 0.05).all()
    assert (pose_confidence(trust) >= DOUBT).all()
    flipped = truth.copy()
    flipped[2] = HALF_TURN @ truth[2]
    trust = trusted(samples, pairs_at(truth), flipped)
    assert column(trust, "votes")[2] == 1 / (NUM + 1)
    assert column(trust, "margin")[2] < 0
    chance = pose_confidence(trust)
    assert chance[2] < 0.2
    assert chance[2] < np.delete(chance, 2).min()


def test_an_answer_that_pairs_were_solved_again_for_does_not_vote(rng: np.random.Generator) -> None:
    samples, truth = crowns(rng)
    first = pairs_at(truth, wrong={0})
    trust = trusted(samples, first, truth)
    assert column(trust, "votes")[0] == 1 / (NUM + 1)


def test_poses_of_a_sphere_are_all_in_doubt(rng: np.random.Generator) -> None:
    directions, faces = sphere_mesh(400)
    turns = np.stack([random_rotation(rng) for _ in range(5)])
    samples = samples_of([Shape.from_arrays(directions @ R, faces) for R in turns])
    trust = trusted(samples, pairs_at(turns), turns)
    assert (pose_confidence(trust) <= 0.5).all()


def test_rivals_are_apart_from_the_pose_and_from_each_other(rng: np.random.Generator) -> None:
    samples, truth = crowns(rng)
    partners = partners_of(pairs_at(truth), truth)
    rivals = rival_poses(samples[0], truth[0], partners[0], mirrored=True)
    assert (np.linalg.det(rivals) < 0).any()
    poses = [truth[0], *rivals]
    angles = [rotation_angle_deg(a, b) for a, b in itertools.combinations(poses, 2)]
    assert np.nanmin(angles) >= 30.0
    assert not (np.linalg.det(rival_poses(samples[0], truth[0], partners[0], mirrored=False)) < 0).any()


def test_the_cost_is_zero_on_itself_and_sees_normals(rng: np.random.Generator) -> None:
    points = rng.standard_normal((40, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert surface_cost((points, normals), (points, normals), np.eye(3)) == pytest.approx(0.0, abs=1e-12)
    inside_out = surface_cost((points, normals), (points, -normals), np.eye(3))
    assert inside_out > surface_cost((points, normals), (points, np.empty((0, 3))), np.eye(3))
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    assert surface_cost((points, normals), (points @ turn, normals @ turn), turn) == pytest.approx(0.0, abs=1e-12)


def test_evidence_for_a_pose_never_lowers_its_probability() -> None:
    middle = np.array([0.5, 0.2, 0.6])
    for at in range(len(KINDS)):
        low, high = middle.copy(), middle.copy()
        low[at], high[at] = middle[at] - 0.2, middle[at] + 0.2
        assert probability(low[None]) < probability(high[None])
    assert np.isnan(probability(np.full((1, len(KINDS)), np.nan))).all()
    assert probability(np.array([[1.0, 9.0, 1.0]])) == MOST_CONFIDENT


def test_alternatives_share_what_the_pose_leaves_and_poses_set_by_hand_are_certain(rng: np.random.Generator) -> None:
    samples, truth = crowns(rng)
    pairs = pairs_at(truth)
    trust = trusted(samples, pairs, truth)
    solution = with_trust(solved(pairs), trust, Constraints(fixed={1: truth[1]}, placed={}, reference=0))
    assert solution.confidence[1] == 1.0
    for confidence, others in zip(np.delete(solution.confidence, 1), np.delete(np.arange(NUM), 1), strict=True):
        chances = [confidence * np.exp(-other.log_odds) for other in solution.alternatives[others]]
        assert 0.0 < sum(chances) <= 1.0 - confidence + 1e-9


def test_notes_name_the_doubtful_the_contradicted_and_the_block(rng: np.random.Generator) -> None:
    samples, truth = crowns(rng)
    names = [f"shape{i}" for i in range(NUM)]
    flipped = truth.copy()
    flipped[2] = HALF_TURN @ truth[2]
    pairs = pairs_at(truth)
    trust = trusted(samples, pairs, flipped)
    first = solved(pairs)
    chance = pose_confidence(trust)
    notes = " ".join(trust_notes(names, trust, chance, first, flipped, {}))
    assert "In doubt: shape2" in notes
    assert "BY HAND" not in notes
    by_hand = trust_notes(names, trust, chance, first, flipped, {2: flipped[2]})
    assert any("shape2 WAS SET BY HAND" in note for note in by_hand)
    right = trusted(samples, pairs, truth)
    assert not trust_notes(names, right, pose_confidence(right), first, truth, {})


def test_a_block_is_named_as_long_as_the_final_poses_have_it(rng: np.random.Generator) -> None:
    samples, truth = crowns(rng)
    names = [f"shape{i}" for i in range(NUM)]
    pairs = pairs_at(truth)
    trust, first = trusted(samples, pairs, truth), solved(pairs)
    cut = WeakCut(
        members=np.array([0, 1]), rotation=HALF_TURN, log_odds=0.1, pairs_for=3, pairs_against=2, doubted=True
    )
    first = replace(first, weak_cuts=(cut,))
    chance = pose_confidence(trust)
    aligned = first.rotations
    assert "shape0, shape1 may be turned together" in " ".join(trust_notes(names, trust, chance, first, aligned, {}))
    turned = aligned.copy()
    turned[:2] = HALF_TURN @ turned[:2]
    assert "may be turned" not in " ".join(trust_notes(names, trust, chance, first, turned, {}))


def test_long_lists_are_cut() -> None:
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(i) for i in range(11)]) == "0, 1, 2, 3, 4, 5, 6, 7 and 3 more"
