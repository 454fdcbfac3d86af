from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.collection import AlignedCollection
from collalign.options import AlignOptions
from collalign.output.evidence.gather import (
    MOST_PAIR_POSES,
    by_label,
    cycle_errors_deg,
    distinct_poses,
    view_collection,
)
from collalign.output.report.poses import own_disagreements_deg
from collalign.products.aligned_collection import ConsistentMaps, RunRecord
from collalign.products.pair import Alternative, Pair
from collalign.products.shapes import Excluded
from data_tools.arrays import FloatArray
from tests.view_problems import bumpy_shapes

K = 12
HALF_TURN = np.diag([1.0, -1.0, -1.0])
MIRROR = np.diag([1.0, 1.0, -1.0])


def evidence(i: int, j: int, rotations: list[FloatArray], map_i_j: np.ndarray, **changes: object) -> Pair:
    values: dict[str, object] = {
        "target": i,
        "source": j,
        "rotations": np.array(rotations).reshape(-1, 3, 3),
        "maps": np.zeros((len(rotations), 0), dtype=np.int64),
        "energies": 0.5 + np.arange(len(rotations)),
        "map_target_source": map_i_j,
        "energy": 0.5,
        "lower_bound": float("nan"),
        "status": "LOCAL_OPTIMUM",
        "chirality_proven": True,
        "choice": 0,
        "inlier": True,
        "disagreement_deg": 0.0,
    }
    return Pair(**(values | changes))  # type: ignore[arg-type]


@pytest.fixture
def collection() -> AlignedCollection:
    """Four shapes, samples in a different order on each; one lacks a label, one pair is flipped and one mirrored."""
    common, _ = bumpy_shapes(4, seed=1)
    R = Rotation.random(4, random_state=2).as_matrix()
    transforms = np.tile(np.eye(4), (4, 1, 1))
    transforms[:, :3, :3] = np.array([0.5, 1, 2, 4])[:, None, None] * R
    transforms[:, :3, 3] = [[1, 2, 3]] * 4
    rng = np.random.default_rng(0)
    labels = np.stack([rng.permutation(K) for _ in range(4)])
    vertex = np.arange(K) * 7
    positions = np.stack([common[at][vertex[labels[at]]] for at in range(4)])
    lacking = labels.copy()
    lacking[3][labels[3] == 5] = -1
    maps = ConsistentMaps(tuple("abcd"), lacking)
    pairs = [
        evidence(0, 1, [R[0].T @ R[1]], maps[0, 1]),
        evidence(1, 2, [HALF_TURN @ R[1].T @ R[2], R[1].T @ R[2]], np.roll(maps[1, 2], 1), choice=1),
        evidence(0, 2, [MIRROR @ R[0].T @ R[2]], maps[0, 2], inlier=False, choice=-1),
        evidence(2, 3, [], np.full(K, -1), inlier=False, choice=-1, status="the worker was killed"),
    ]
    return AlignedCollection(
        names=tuple("abcd"),
        files=tuple(Path(f"{name}.ply") for name in "abcd"),
        digests=tuple("abcd"),
        transforms=transforms,
        rotations=R,
        reflected=np.zeros(4, dtype=bool),
        confidence=np.array([1, 0.9, 0.8, 0.2]),
        samples=tuple(vertex[labels[at]] for at in range(4)),
        positions=positions,
        coordinates=positions,
        invariants=np.zeros((4, K, 0)),
        maps=maps,
        consensus=np.zeros((K, 3)),
        pairs=tuple(pairs),
        alternatives=((), (), (), (Alternative(rotation=HALF_TURN @ R[3], log_odds=-0.5),)),
        parts=(np.array([0, 1, 2]), np.array([3])),
        excluded=(Excluded(file="e.ply", reason="empty"),),
        skipped=(),
        notes=("two parts",),
        shape_notes=((),) * 4,
        options=AlignOptions(),
        group="SO",
        run=RunRecord(times_s={"pairs": 1.0}, versions={"numpy": "2"}),
    )


def meshes() -> list[tuple[np.ndarray, np.ndarray]]:
    common, faces = bumpy_shapes(4, seed=1)
    return [(vertices, faces) for vertices in common]


def test_samples_come_by_label_in_file_coordinates(collection: AlignedCollection) -> None:
    view = view_collection(collection, meshes())
    common, _ = bumpy_shapes(4, seed=1)
    expected = common[:, np.arange(K) * 7].copy()
    expected[3, 5] = np.nan
    np.testing.assert_allclose(view.aligned_samples, expected, atol=1e-12)
    T = view.transforms[2]
    np.testing.assert_allclose(view.samples[2] @ T[:3, :3].T + T[:3, 3], expected[2], atol=1e-12)


def test_pairs_say_how_they_disagree_and_what_was_used(collection: AlignedCollection) -> None:
    view = view_collection(collection, meshes())
    good, flipped, mirrored, failed = view.pairs
    own = own_disagreements_deg(view)
    np.testing.assert_allclose(own[:3], [0.0, 180.0, np.inf], atol=1e-5)
    assert np.isnan(own[3])
    assert (flipped.choice, flipped.inlier, mirrored.inlier) == (1, True, False)
    assert len(failed.rotations) == len(failed.energies) == 0
    assert good.chirality_proven
    assert (good.status, failed.status) == ("LOCAL_OPTIMUM", "the worker was killed")


def test_pair_maps_are_in_terms_of_labels(collection: AlignedCollection) -> None:
    good, flipped, _, failed = view_collection(collection, meshes()).pairs
    assert len(good.map_target_source) == 0
    labels, rolled = collection.maps.labels, collection.pairs[1].map_target_source
    for sample in range(K):
        assert flipped.map_target_source[labels[2][sample]] == labels[1][rolled[sample]]
    assert (failed.map_target_source == -1).all()
    assert len(failed.map_target_source)


def test_poses_of_a_pair_are_distinct_and_hold_the_chosen_one() -> None:
    turns = Rotation.from_rotvec(np.radians([[0, 0, a] for a in (0, 5, 60, 120, 170, 240, 300, 303)])).as_matrix()
    energies = np.array([1, 2, 5, 3, 4, 6, 8, 7.0])
    kept, choice = distinct_poses(turns, energies, 6)
    assert energies[kept].tolist() == [1, 3, 4, 7]
    assert choice == MOST_PAIR_POSES - 1
    assert distinct_poses(turns, energies, 1)[1] == 0
    assert distinct_poses(turns, energies, -1)[1] == -1
    mirrored, choice = distinct_poses(np.stack([np.eye(3), -np.eye(3)]), np.array([2.0, 1.0]), 0)
    assert (mirrored, choice) == ([1, 0], 1)


def test_everything_else_is_carried_over(collection: AlignedCollection) -> None:
    view = view_collection(collection, meshes(), labels={"taxon": tuple("xxyy")})
    assert view.part_numbers.tolist() == [0, 0, 0, 1]
    assert view.excluded == (("e.ply", "empty"),)
    assert view.notes == ("two parts",)
    assert [len(poses) for poses in view.alternatives] == [0, 0, 0, 1]
    assert view.alternatives[3][0].log_odds == -0.5
    assert view.timings_s == {"pairs": 1.0}
    assert view.options["group"] == AlignOptions().group
    assert view.labels == {"taxon": tuple("xxyy")}


def test_cycle_errors_find_the_wrong_pair(collection: AlignedCollection) -> None:
    np.testing.assert_allclose(cycle_errors_deg(collection.pairs, 4), [180.0])
    R = collection.rotations
    fine = tuple(evidence(i, j, [R[i].T @ R[j]], np.arange(K)) for i in range(4) for j in range(i))
    errors = cycle_errors_deg(fine, 4)
    assert len(errors) == 4
    np.testing.assert_allclose(errors, 0, atol=1e-5)
    assert len(cycle_errors_deg(fine[:2], 4)) == 0


def test_large_collections_are_sampled_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("collalign.output.evidence.gather.MOST_CYCLES", 10)
    pairs = tuple(evidence(i, j, [np.eye(3)], np.arange(K)) for i in range(8) for j in range(i))
    assert len(cycle_errors_deg(pairs, 8)) == 10


def test_samples_without_label_are_dropped() -> None:
    positions = np.arange(12.0).reshape(2, 2, 3)
    found = by_label(positions, np.array([[1, 0], [-1, 1]]))
    np.testing.assert_array_equal(found[0], positions[0][::-1])
    np.testing.assert_array_equal(found[1], [[np.nan] * 3, positions[1][1]])
