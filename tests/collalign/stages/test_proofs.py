"""Which pairs are worth a proof, and what a proof changes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.engine.records import decode, encode, from_record, to_record
from collalign.stages.proofs import (
    LISTED_WITHIN,
    PairProof,
    contradictions,
    pair_proof,
    proofs_note,
    with_proof,
    worth_proving,
)
from data_tools.errors import StoreError
from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.pose_lists import list_poses
from pairwise.problem import Problem
from pairwise.results import Status
from tests.products import pair_of
from tests.rigid_problems import planted_cube


def pair(*energies):
    num = len(energies)
    return pair_of(
        np.tile(np.eye(3), (num, 1, 1)),
        energies,
        num_samples=4,
        lower_bound=np.nan,
        status="LOCAL_OPTIMUM",
    )


def test_rejected_pairs_come_first_then_close_rivals():
    pairs = [pair(1.0, 1.1), pair(1.0, 3.0), pair(1.0, 1.05), pair(1.0), pair(1.0, 2.0)]
    inlier = np.array([True, True, True, True, False])
    assert worth_proving(pairs, inlier) == [4, 2, 0]
    assert worth_proving(pairs[1:2], inlier[:1]) == []


def proof(energy, *listed, within=1.2):
    """A proof whose pose is a half turn; further listed poses are turned by tenths of a turn."""
    rotations = [turn(36.0 * (number + 1)) for number in range(len(listed))]
    return PairProof(
        listed_rotations=np.array(rotations).reshape(-1, 3, 3),
        listed_maps=np.tile([3, 2, 1, 0], (len(listed), 1)),
        listed_energies=np.array(listed),
        mismatch=0.01,
        listed_mismatches=np.full(len(listed), 0.02),
        complete_within=within,
        regions=np.array([np.diag([1.0, -1.0, -1.0]), *rotations]),
        region_radii_rad=np.full(1 + len(listed), 0.1),
        lower_bound=0.7,
        status=Status.PROVEN_OPTIMAL,
        energy=energy,
        rotation=np.diag([1.0, -1.0, -1.0]),
        map=np.array([1, 0, 2, 3]),
        chirality_proven=True,
        certificate=None,
    )


def test_a_proof_adds_its_bound_and_the_poses_that_the_pair_lacks():
    known = replace(pair(0.8, 0.9), rotations=np.stack([np.diag([1.0, -1.0, -1.0]), np.eye(3)]))
    same = with_proof(known, proof(0.8))
    assert (same.lower_bound, same.status, same.chirality_proven) == (0.7, "PROVEN_OPTIMAL", True)
    assert same.energies.tolist() == [0.8, 0.9]
    better = with_proof(pair(0.8, 0.9), proof(0.71))
    assert better.energies.tolist() == [0.71, 0.8, 0.9]
    assert np.array_equal(better.rotations[0], np.diag([1.0, -1.0, -1.0]))
    assert better.maps[0].tolist() == [1, 0, 2, 3]
    listed = with_proof(known, proof(0.8, 0.85, 0.95))
    assert listed.energies.tolist() == [0.8, 0.85, 0.9, 0.95]
    assert listed.maps[1].tolist() == [3, 2, 1, 0]
    assert (listed.complete_within, len(listed.regions)) == (1.2, 3)
    assert not len(listed.mismatches)
    described = with_proof(replace(known, mismatches=np.array([0.03, 0.04])), proof(0.8, 0.85))
    assert described.mismatches.tolist() == [0.03, 0.02, 0.04]
    again = with_proof(listed, proof(0.8, 0.85, 0.95))
    assert again.energies.tolist() == listed.energies.tolist()


def turn(angle_deg):
    return Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()


def test_a_common_pose_far_from_all_listed_poses_contradicts_only_a_complete_list():
    listed = replace(
        pair(1.0), complete_within=1.2, regions=turn(0.0)[None], region_radii_rad=np.deg2rad([10.0])
    )
    for angle, is_far in ((0.0, False), (38.0, False), (42.0, True), (180.0, True)):
        said = contradictions(("a", "b"), [listed], np.stack([np.eye(3), turn(angle)]))
        assert bool(said) == is_far
    assert said[0].values == {
        "pairs": ("a - b",),
        "within": LISTED_WITHIN,
        "apart_deg": pytest.approx(30.0, abs=0.1),
    }
    incomplete = replace(listed, complete_within=float("nan"))
    assert not contradictions(
        ("a", "b"), [incomplete, pair(1.0)], np.stack([np.eye(3), turn(180.0)])
    )
    many = contradictions(("a", "b"), [listed] * 11, np.stack([np.eye(3), turn(180.0)]))
    assert len(many[0].values["pairs"]) == 11


def proof_of(poses):
    return pair_proof(poses, lambda rotations: np.full(len(rotations), 0.1))


def test_the_record_of_a_list_is_checked_and_says_whether_it_is_complete():
    problem = Problem.from_user(*planted_cube(4, 0.2, 2))
    poses = list_poses(problem, within=LISTED_WITHIN, record=True)
    record = decode(encode(to_record(proof_of(poses))), "pair")
    found = from_record(PairProof, record, "pair")
    assert found.complete_within == LISTED_WITHIN
    assert len(found.regions) == len(poses.regions) > 0
    assert found.listed_energies.tolist() == [one.energy for one in poses.candidates]
    assert found.certificate is not None
    assert found.certificate.bound <= poses.proof.candidate.energy
    for region, centre, radius in zip(
        poses.regions, found.regions, found.region_radii_rad, strict=True
    ):
        assert (
            rotation_angles(region.rotations, centre) + region.radii_rad <= radius + 1e-12
        ).all()
    assert np.isnan(proof_of(replace(poses, is_resolved=False)).complete_within)
    with pytest.raises(StoreError, match="region"):
        from_record(PairProof, record | {"regions": record["regions"][:-1]}, "pair")
    with pytest.raises(StoreError, match="bound"):
        from_record(
            PairProof, record | {"certificate": record["certificate"] | {"bound": "0"}}, "pair"
        )


def test_the_note_on_proofs_counts_them():
    optimal, regions = Status.PROVEN_OPTIMAL.name, np.eye(3)[None]
    proven = [
        replace(
            pair(1.0), status=optimal, chirality_proven=True, complete_within=1.2, regions=regions
        ),
        replace(
            pair(1.0), status=optimal, complete_within=1.2, regions=np.repeat(regions, 2, axis=0)
        ),
        pair(2.0),
    ]
    assert proofs_note([pair(1.0), pair(1.5), pair(2.0)], proven, 5).values == {
        "num_optimal": 2,
        "num_tried": 3,
        "num_wanted": 5,
        "num_chirality": 1,
        "num_improved": 1,
        "num_complete": 2,
        "num_unique": 1,
        "within": LISTED_WITHIN,
    }
