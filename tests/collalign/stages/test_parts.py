"""Shapes all of which are posed as parts of each other."""

from types import SimpleNamespace

import numpy as np
import pytest

from collalign import RunOptions, add_to_collection, align_collection
from collalign.confidence.incomplete_model import chance_against
from collalign.stages.incomplete.detect import LIKELIER
from collalign.stages.incomplete.parts import PartPoses, _first_transforms
from collalign.stages.posing import CONTRADICTED, OTHER_READING, _surer
from collalign.stages.steps import Posed
from collalign.synchronization import SynchronizationResult
from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.shapes import Shape, write_mesh
from data_tools.poses import Similarity, pose_angle_deg
from data_tools.rotations import random_rotation
from experiments.pairs.incomplete import without_share

#: A half turn.
HALF_TURN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def cut_blobs():
    """Five blobs that differ a little, another quarter of each cut off, posed and scaled; and their rotations."""
    rng = np.random.default_rng(3)
    base = blob(rng, num_vertices=1000)
    given, rotations = {}, []
    for n in range(5):
        piece = without_share(bumped(base, rng, rms=0.02), rng.standard_normal(3), 0.25)
        rotations.append(random_rotation(rng))
        placed = rng.uniform(0.5, 2.0) * piece.vertices @ rotations[-1].T + rng.standard_normal(3)
        given[f"piece{n}"] = Shape.from_arrays(placed, piece.faces, name=f"piece{n}")
    return given, np.array(rotations)


def worst_deg(found, rotations):
    """Return the largest angle of poses (N, 3, 3) from those of most, where the shapes were rotated so."""
    turns = found @ rotations
    angles = pose_angle_deg(turns[:, None], turns)
    return float(angles[np.argmin(np.median(angles, axis=1))].max())


def test_shapes_that_are_all_cut_are_posed_as_parts_of_each_other(cut_blobs, tmp_path):
    given, rotations = cut_blobs
    *first, last = given
    for name in first:
        write_mesh(tmp_path / "first" / f"{name}.ply", given[name])
    write_mesh(tmp_path / "new" / f"{last}.ply", given[last])
    collection = align_collection(tmp_path / "first", run=RunOptions(jobs=1), progress=False)
    found = Similarity.of_transforms(collection.transforms).rotation
    assert worst_deg(found, rotations[:-1]) < 30.0
    assert {pair.how for pair in collection.pairs} == {"part"}
    assert {one.reason for one in collection.incomplete} == {LIKELIER}
    half_turned = rotations[:-1].copy()
    half_turned[0] = half_turned[0] @ HALF_TURN
    assert worst_deg(found, half_turned) > 90.0, "the measure sees a half turn"

    collection.save(tmp_path / "aligned", report=False)
    added = add_to_collection(tmp_path / "aligned", tmp_path / "new", run=RunOptions(jobs=1))
    assert np.array_equal(added.transforms[:-1], collection.transforms)
    assert [added.names[one.shape] for one in added.incomplete] == [last]
    assert worst_deg(Similarity.of_transforms(added.transforms).rotation, rotations) < 30.0


def test_first_transforms_agree_with_exact_pairs():
    rng = np.random.default_rng(0)
    true = Similarity(
        rotation=np.array([random_rotation(rng) for _ in range(4)]),
        scale=rng.uniform(0.5, 2.0, 4),
        shift=rng.standard_normal((4, 3)),
    ).transform
    pairs = {}
    for i, j in ((0, 1), (1, 2), (2, 3), (0, 3)):
        pose = Similarity.of_transforms((np.linalg.inv(true[i]) @ true[j])[None])
        pairs[i, j] = PartPoses(
            rotations=pose.rotation, scales=pose.scale, shifts=pose.shift, energies=np.ones(1)
        )
    solution = SimpleNamespace(
        rotations=Similarity.of_transforms(true).rotation,
        edge_choice=np.zeros(4, dtype=int),
        edge_inlier=np.ones(4, dtype=bool),
    )
    found = _first_transforms(pairs, solution)
    moved = np.linalg.inv(found[0]) @ found
    assert np.allclose(moved, np.linalg.inv(true[0]) @ true)


def test_two_answers_that_contradict_each_other_are_less_sure():
    rotations = np.tile(np.eye(3), (4, 1, 1))
    other = rotations.copy()
    other[3] = HALF_TURN

    def posed(poses, confidence):
        solution = SynchronizationResult(
            rotations=poses,
            confidence=np.full(4, confidence),
            edge_inlier=np.ones(0, dtype=bool),
            edge_choice=np.zeros(0, dtype=np.int64),
            parts=(np.arange(4),),
            components=(np.arange(4),),
            alternatives=((),) * 4,
            warnings=(),
        )
        return Posed(
            pairs=[],
            matched=[],
            solution=solution,
            rotations=poses,
            transforms=np.tile(np.eye(4), (4, 1, 1)),
            labels=np.zeros((4, 1), dtype=np.int64),
            consensus=np.zeros((1, 3)),
            notes=(),
            side_chances={},
        )

    stated = _surer(posed(rotations, 0.9), posed(other, 0.5))
    assert np.allclose(stated.solution.confidence, [0.9, 0.9, 0.9, 0.45 / 0.55])
    assert stated.limited_by == ("", "", "", OTHER_READING)
    assert np.array_equal(stated.rotations, rotations)

    stated = _surer(posed(rotations, 0.9), posed(other, 0.97))
    assert np.allclose(stated.solution.confidence, [0.97, 0.97, 0.97, CONTRADICTED])
    assert stated.limited_by == ("", "", "", OTHER_READING)
    assert np.array_equal(stated.rotations, other)

    other[2] = HALF_TURN
    contradicting = _surer(posed(rotations, 0.9), posed(other, 0.5))
    assert np.array_equal(contradicting.rotations, other), "where many are elsewhere, parts count"


@pytest.mark.parametrize(
    ("chance", "rival", "expected"), [(0.5, 0.5, 1 / 3), (0.9, 0.0, 0.9), (0.9, 1.0, 0.0)]
)
def test_both_of_two_contradicting_claims_may_be_wrong(chance, rival, expected):
    assert np.isclose(chance_against(np.array(chance), np.array(rival)), expected)
