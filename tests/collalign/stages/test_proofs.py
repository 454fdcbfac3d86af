"""Which pairs are worth a proof, and what a proof changes."""

from __future__ import annotations

import numpy as np

from collalign.products.pair import Pair
from collalign.stages.proofs import CertificationReport, with_proof, worth_proving


def pair(*energies: float) -> Pair:
    num = len(energies)
    return Pair(
        target=0,
        source=1,
        rotations=np.tile(np.eye(3), (num, 1, 1)),
        maps=np.tile(np.arange(4), (num, 1)),
        energies=np.array(energies),
        lower_bound=float("nan"),
        status="LOCAL_OPTIMUM",
    )


def test_rejected_pairs_come_first_then_close_rivals() -> None:
    pairs = [pair(1.0, 1.1), pair(1.0, 3.0), pair(1.0, 1.05), pair(1.0), pair(1.0, 2.0)]
    inlier = np.array([True, True, True, True, False])
    assert worth_proving(pairs, inlier) == [4, 2, 0]
    assert worth_proving(pairs[1:2], inlier[:1]) == []


def proof(energy: float) -> dict[str, object]:
    return {
        "lower_bound": 0.7,
        "status": "PROVEN_OPTIMAL",
        "energy": energy,
        "rotation": np.diag([1.0, -1.0, -1.0]),
        "map": np.array([1, 0, 2, 3]),
        "chirality_proven": True,
        "certificate": None,
    }


def test_a_proof_adds_its_bound_and_a_pose_only_if_it_is_better() -> None:
    same = with_proof(pair(0.8, 0.9), proof(0.8))
    assert (same.lower_bound, same.status, same.chirality_proven) == (0.7, "PROVEN_OPTIMAL", True)
    assert same.energies.tolist() == [0.8, 0.9]
    better = with_proof(pair(0.8, 0.9), proof(0.71))
    assert better.energies.tolist() == [0.71, 0.8, 0.9]
    assert np.array_equal(better.rotations[0], np.diag([1.0, -1.0, -1.0]))
    assert better.maps[0].tolist() == [1, 0, 2, 3]


def test_the_report_says_when_the_budget_ended() -> None:
    text = str(CertificationReport(num_wanted=5, num_tried=3, num_proven=2, num_chiralities=0, num_improved=0))
    assert "2 of 3" in text
    assert "budget" in text
    full = str(CertificationReport(num_wanted=3, num_tried=3, num_proven=3, num_chiralities=1, num_improved=1))
    assert "budget" not in full
    assert "1 mirror" in full
