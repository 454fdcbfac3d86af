"""The certificates of a result's folder: written, checked against the shapes they are about, refused once changed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from collalign.output.certificates import write_certificates
from collalign.output.verify import verify_result
from collalign.products.pair import Pair
from data_tools.errors import InputError
from data_tools.io.csv_cells import csv_text
from data_tools.io.output_folder import OutputFolder
from pairwise import Problem, solve_relaxation
from tests.problems import random_rotation

NAMES = ("=sum", "b", "c")
K = 5


@dataclass(frozen=True)
class Certified:
    """The part of a collection that certificates are written from."""

    coordinates: np.ndarray
    invariants: np.ndarray
    pairs: tuple[Pair, ...]


@pytest.fixture(scope="module")
def certified() -> Certified:
    rng = np.random.default_rng(3)
    coordinates, invariants = rng.standard_normal((3, K, 3)), 0.1 * rng.standard_normal((3, K, 2))
    certificate = solve_relaxation(
        coordinates[0], coordinates[2], invariants=(invariants[0], invariants[2]), relaxation="quaternion"
    ).certificate
    empty = {"rotations": np.zeros((0, 3, 3)), "maps": np.zeros((0, K), dtype=np.int64), "energies": np.zeros(0)}
    pairs = (
        Pair(target=0, source=1, lower_bound=0.1, **empty),
        Pair(target=0, source=2, lower_bound=certificate.bound, certificate=certificate, **empty),
        Pair(target=1, source=2, **empty),
    )
    return Certified(coordinates, invariants, pairs)


@pytest.fixture
def folder(certified: Certified, tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    with OutputFolder.open(tmp_path / "out", writer="align") as output:
        write_certificates(certified, output)  # type: ignore[arg-type]
        positions = [
            2.0 * x @ random_rotation(rng, 3, reflected=i == 1) + i for i, x in enumerate(certified.coordinates)
        ]
        np.savez(output.stage("correspondences.npz"), positions=np.array(positions))
        shapes = {"shapes": [{"name": name} for name in NAMES], "decided": {"group": "SO"}}
        output.stage("alignment.json").write_text(json.dumps(shapes))
        rows = [(NAMES[p.target], NAMES[p.source], p.lower_bound) for p in certified.pairs]
        output.stage("pairs.csv").write_text(csv_text([("target", "source", "lower_bound"), *rows]))
        output.publish()
    return tmp_path / "out"


def test_certificates_hold_and_the_rest_is_called_a_word(folder: Path, certified: Certified) -> None:
    found = verify_result(folder)
    assert found.holds
    assert (found.num_stated, found.num_proven) == (2, 1)
    (pair,) = found.pairs
    assert (pair.target, pair.source, pair.kind) == ("=sum", "c", "quaternion")
    assert pair.proven == pytest.approx(certified.pairs[1].lower_bound, rel=1e-9)
    assert "1 certificates, all hold" in found.table()
    assert json.loads(json.dumps(found.as_dict()))["num_proven"] == 1


@pytest.mark.parametrize("name", ["coordinates", "invariants"])
def test_other_samples_and_invariants_are_noticed(folder: Path, certified: Certified, name: str) -> None:
    arrays = {"coordinates": certified.coordinates.copy(), "invariants": certified.invariants.copy()}
    arrays[name][2] *= 1.5
    np.savez(folder / "certificates" / "problems.npz", **arrays)
    found = verify_result(folder)  # 1.5 times the samples are still the samples of the result
    assert not found.holds
    assert found.num_proven == 0
    assert "is for another problem" in found.pairs[0].fault
    assert "1 REFUSED" in found.table()
    assert found.as_dict()["pairs"][0]["proven"] is None


def test_a_certificate_of_another_group_or_pair_is_refused(folder: Path) -> None:
    record = json.loads((folder / "alignment.json").read_text())
    record["decided"]["group"] = "O"
    (folder / "alignment.json").write_text(json.dumps(record))
    assert "special_blocks" in verify_result(folder).pairs[0].fault
    (folder / "certificates" / "0-2.npz").rename(folder / "certificates" / "1-2.npz")
    assert "another problem" in verify_result(folder).pairs[0].fault


def test_samples_that_are_not_those_of_the_result_are_refused(folder: Path, certified: Certified) -> None:
    moved = certified.coordinates.copy()
    moved[1, 0, 0] += 1e-3
    np.savez(folder / "certificates" / "problems.npz", coordinates=moved, invariants=certified.invariants)
    with pytest.raises(InputError, match="samples of shape 1 are not those"):
        verify_result(folder)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("alignment.json", "{", "cannot be read as a result"),
        ("alignment.json", '{"shapes": [], "decided": {"group": "SO"}}', "expected shape|only 0 shapes"),
        ("pairs.csv", "target,source\na,b\n", "cannot be read as a table"),
        ("certificates/problems.npz", "PK", "cannot be read"),
        ("certificates/5-6.npz", "PK", "only 3 shapes"),
        ("certificates/a-b.npz", "PK", "two numbers"),
    ],
)
def test_damaged_folders_are_named(folder: Path, file: str, content: str, message: str) -> None:
    (folder / file).write_text(content)
    with pytest.raises(InputError, match=message):
        verify_result(folder)


def test_a_damaged_certificate_is_a_fault_of_its_pair(folder: Path) -> None:
    (folder / "certificates" / "0-2.npz").write_bytes(b"PK")
    assert "cannot be read as a certificate" in verify_result(folder).pairs[0].fault


def test_a_folder_without_certificates_says_how_to_make_them(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--certify"):
        verify_result(tmp_path)


def test_the_samples_are_those_of_the_problem(certified: Certified) -> None:
    # what verify_result states is what was solved
    q, p = certified.coordinates[[0, 2]]
    problem = Problem.from_user(q, p, invariants=(certified.invariants[0], certified.invariants[2]))
    assert np.array_equal(certified.pairs[1].certificate.arrays["constant_cost"], problem.constant_cost)
