import numpy as np
from scipy.spatial.transform import Rotation

from collalign.output.evidence_file import (
    MOST_PAIR_POSES,
    OWN_MAP,
    cycle_errors_deg,
    distinct_poses,
    label_maps,
    part_numbers,
)
from collalign.products.consistent_maps import ConsistentMaps
from tests.products import settled_pair_of

K = 12
HALF_TURN = np.diag([1.0, -1.0, -1.0])
MIRROR = np.diag([1.0, 1.0, -1.0])


def matched(i, j, rotations, map_i_j, choice=0, **known):
    energies = 0.5 + np.arange(len(rotations))
    return settled_pair_of(
        rotations, energies, target=i, source=j, map_target_source=map_i_j, choice=choice, **known
    )


def test_pair_maps_are_in_terms_of_labels():
    rng = np.random.default_rng(0)
    labels = np.stack([rng.permutation(K) for _ in range(3)])
    lacking = labels.copy()
    lacking[2][labels[2] == 5] = -1
    maps = ConsistentMaps(tuple("abc"), lacking)
    rolled = np.roll(maps[1, 0], 1)
    pairs = [
        matched(0, 1, [], maps[0, 1]),
        matched(1, 0, [], rolled),
        matched(0, 2, [], maps[0, 2]),
        matched(1, 2, [], np.full(K, -1)),
    ]
    own, other, without_one, none = label_maps(pairs, lacking)
    assert (own == OWN_MAP).all()
    assert (without_one == OWN_MAP).all()
    assert (none == -1).all()
    for sample in range(K):
        assert other[labels[0][sample]] == labels[1][rolled[sample]]


def test_poses_of_a_pair_are_distinct_and_hold_the_chosen_one():
    turns = Rotation.from_rotvec(
        np.radians([[0, 0, a] for a in (0, 5, 60, 120, 170, 240, 300, 303)])
    ).as_matrix()
    energies = np.array([1, 2, 5, 3, 4, 6, 8, 7.0])
    kept, choice = distinct_poses(turns, energies, 6)
    assert energies[kept].tolist() == [1, 3, 4, 7]
    assert choice == MOST_PAIR_POSES - 1
    assert [distinct_poses(turns, energies, choice)[1] for choice in (1, -1)] == [0, -1]
    mirrored, choice = distinct_poses(np.stack([np.eye(3), -np.eye(3)]), np.array([2.0, 1.0]), 0)
    assert (mirrored, choice) == ([1, 0], 1)


def test_cycle_errors_find_the_wrong_pair():
    R = Rotation.random(4, random_state=2).as_matrix()
    own = [matched(i, j, [R[i].T @ R[j]], np.arange(K)) for i in range(4) for j in range(i)]
    errors = cycle_errors_deg(own, 4)
    assert len(errors) == 4
    np.testing.assert_allclose(errors, 0, atol=1e-5)
    assert len(cycle_errors_deg(own[:2], 4)) == 0
    for wrong in (HALF_TURN, MIRROR):
        spoiled = [matched(1, 0, [wrong @ R[1].T @ R[0]], np.arange(K)), *own[1:3]]
        np.testing.assert_allclose(cycle_errors_deg(spoiled, 4), [180.0])


def test_parts_are_numbered():
    assert part_numbers((np.array([0, 3]), np.array([1, 2])), 4).tolist() == [0, 1, 1, 0]
