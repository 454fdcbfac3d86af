"""The certificates of a result's folder: written, checked against the shapes they are about, refused once changed."""

import json
import os
import shutil
from dataclasses import dataclass

import numpy as np
import pytest

from collalign.output.certificates import write_certificates
from collalign.output.verify import verify_result
from collalign.products.pair import AlignedPair
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import InputError
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import write_mesh
from data_tools.io.text_tables import csv_text
from data_tools.surface.shape import Shape
from pairwise import solve_relaxation
from tests.commands import read_json
from tests.problems import random_rotation
from tests.products import settled_pair_of

NAMES = ("=sum", "b", "c")
K = 5
COLUMNS = ("target", "source", "lower_bound", "energy")


@dataclass(frozen=True)
class Certified:
    """The part of a collection that certificates are written from."""

    coordinates: np.ndarray
    invariants: np.ndarray
    pairs: tuple[AlignedPair, ...]


@pytest.fixture(scope="module")
def certified():
    return certified_pairs()


def certified_pairs(num_functions=0):
    """Pairs of samples with as many coordinates besides those of space."""
    rng = np.random.default_rng(3)
    coordinates, invariants = rng.standard_normal((3, K, 3)), 0.1 * rng.standard_normal((3, K, 2))
    coordinates -= coordinates.mean(axis=1, keepdims=True)
    coordinates /= np.linalg.norm(coordinates, axis=(1, 2), keepdims=True)
    functions = rng.standard_normal((3, K, num_functions))
    coordinates = np.concatenate([coordinates, functions], axis=2)
    certificate = solve_relaxation(
        coordinates[0],
        coordinates[2],
        rotation_pattern=(3, num_functions) if num_functions else None,
        invariants=(invariants[0], invariants[2]),
    ).certificate
    known = {
        "lower_bound": certificate.bound,
        "energy": 1.1 * certificate.bound,
        "certificate": certificate,
    }
    pairs = (
        settled_pair_of([], [], lower_bound=0.1, energy=0.2),
        settled_pair_of([], [], source=2, **known),
        settled_pair_of([], [], target=1, source=2),
    )
    return Certified(coordinates, invariants, pairs)


def summary(certified, normalisation):
    """Return what alignment.json says, and the samples in the common frame: turned, scaled, shifted and mirrored."""
    rng = np.random.default_rng(0)
    shapes, positions = [], []
    for i, (name, x) in enumerate(zip(NAMES, certified.coordinates, strict=True)):
        unit, transform = 1.0 if normalisation == "none" else 5.0 + i, np.eye(4)
        transform[:3, :3] = 2.0 * random_rotation(rng, 3, reflected=i == 1) / unit
        transform[:3, 3] = i
        shapes.append({"name": name, "transform": transform.tolist()})
        positions.append((unit * x[:, :3] + 7.0) @ transform[:3, :3].T + transform[:3, 3])
    options = {"sampling": {"normalisation": normalisation}}
    return {"shapes": shapes, "decided": {"group": "SO"}, "options": options}, np.array(positions)


def rewrite_table(folder, change):
    rows = [line.split(",") for line in (folder / "pairs.csv").read_text().splitlines()]
    change(rows)
    (folder / "pairs.csv").write_text("\n".join(map(",".join, rows)))


@pytest.fixture
def folder(certified, tmp_path):
    return write_folder(certified, tmp_path / "out")


def write_folder(certified, folder):
    with OutputFolder.open(folder, writer="align") as output:
        write_certificates(certified.pairs, certified, output)
        record, positions = summary(certified, "centroid")
        np.savez(output.stage("correspondences.npz"), positions=positions)
        output.stage("alignment.json").write_text(json.dumps(record))
        rows = [
            (NAMES[p.target], NAMES[p.source], p.lower_bound, p.energy) for p in certified.pairs
        ]
        output.stage("pairs.csv").write_text(csv_text([COLUMNS, *rows]))
        output.publish()
    return folder


def test_certificates_hold_and_the_rest_is_called_a_word(folder, certified):
    found = verify_result(folder)
    assert found.holds
    assert (found.num_stated, found.num_proven) == (2, 1)
    (pair,) = found.pairs
    assert (pair.target, pair.source, pair.kind) == ("=sum", "c", "pm-sdp")
    assert pair.proven == pytest.approx(certified.pairs[1].lower_bound, rel=1e-9)
    assert "1 certificates, all hold" in found.table()
    assert json.loads(json.dumps(found.as_dict()))["num_proven"] == 1


@pytest.mark.parametrize("change", ["scaled", "shifted", "mirrored", "vanishing"])
def test_samples_of_the_result_must_be_centred_and_scaled_as_by_the_run(folder, certified, change):
    samples = certified.coordinates[2]
    samples = {"shifted": samples + 0.1, "mirrored": -samples}.get(change, 1.5 * samples)
    if (
        change == "vanishing"
    ):  # taken back, those of the result are zeros, which fit whatever has no size
        record, positions = summary(certified, "centroid")
        record["shapes"][2]["transform"] = np.diag([1e300, 1e300, 1e300, 1.0]).tolist()
        (folder / "alignment.json").write_text(json.dumps(record))
        positions[2] *= 1e-30
        np.savez(folder / "correspondences.npz", positions=positions)
    coordinates = np.array([*certified.coordinates[:2], samples])
    ends = (coordinates[0], coordinates[2])
    proof = solve_relaxation(*ends, invariants=(certified.invariants[0], certified.invariants[2]))
    proof.certificate.save(folder / "certificates" / "0-2.npz")
    np.savez(
        folder / "certificates" / "problems.npz",
        coordinates=coordinates,
        invariants=certified.invariants,
    )
    rewrite_table(folder, lambda rows: rows[2].__setitem__(slice(2, 4), ["4.1", "5.0"]))
    with pytest.raises(InputError, match=r"samples of shape 2 are not those .* centred and scaled"):
        verify_result(folder)


def test_the_run_may_have_scaled_by_no_size_or_by_the_area(folder, certified):
    record, positions = summary(certified, "none")
    np.savez(folder / "correspondences.npz", positions=positions)
    (folder / "alignment.json").write_text(json.dumps(record))
    assert verify_result(folder).holds
    np.savez(
        folder / "correspondences.npz", positions=[positions[0], positions[1], 2.0 * positions[2]]
    )
    with pytest.raises(InputError, match="samples of shape 2 are not those"):
        verify_result(folder)
    np.savez(folder / "correspondences.npz", positions=positions)
    record["options"]["sampling"]["normalisation"] = "area"
    (folder / "alignment.json").write_text(json.dumps(record))
    for name, transform in zip(
        NAMES, [shape["transform"] for shape in record["shapes"]], strict=True
    ):
        sphere = Shape.from_arrays(*sphere_mesh(1000), name=name)
        sphere = sphere.transformed(np.diag([*[1 / np.sqrt(4 * np.pi)] * 3, 1.0]))
        write_mesh(folder / "meshes" / f"{name}.ply", sphere.transformed(np.array(transform)))
    assert verify_result(folder).holds
    write_mesh(folder / "meshes" / "c.ply", sphere)  # of half the size
    with pytest.raises(InputError, match="samples of shape 2 are not those"):
        verify_result(folder)


def test_bounds_above_the_energy_are_refused(folder, certified):
    bound = float(certified.pairs[1].lower_bound)
    rewrite_table(folder, lambda rows: rows[2].__setitem__(3, repr(bound * (1 + 1e-8))))
    assert verify_result(folder).holds
    for energy in (repr(bound * (1 - 1e-4)), "", "inf"):  # what is no energy allows no bound
        rewrite_table(
            folder, lambda rows, energy=energy: rows[2].__setitem__(slice(2, 4), ["", energy])
        )
        assert "above the pair's energy" in verify_result(folder).pairs[0].fault
    rewrite_table(
        folder, lambda rows: rows[2].__setitem__(slice(2, 4), ["0.0", repr(bound * (1 - 1e-4))])
    )
    assert "above the pair's energy" in verify_result(folder).pairs[0].fault
    rewrite_table(
        folder, lambda rows: rows[1].__setitem__(2, "0.21")
    )  # of a pair without a certificate
    with pytest.raises(
        InputError, match=r"states a lower bound of 0\.21 for =sum - b, above its energy 0\.2"
    ):
        verify_result(folder)


def test_each_pair_counts_once_and_only_files_of_the_manifest(folder):
    certificates = folder / "certificates"
    for name in ("2-0.npz", "00-2.npz", "0-02.npz", "a-b.npz"):
        shutil.copy(certificates / "0-2.npz", certificates / name)
    os.mkfifo(certificates / "0-1.npz")
    assert (len(verify_result(folder).pairs), verify_result(folder).num_proven) == (1, 1)
    manifest = folder / ".collalign" / "manifest.json"
    content = read_json(manifest)
    for name in ("2-0.npz", "00-2.npz", "0-02.npz", "0-1.npz"):
        content["files"][f"certificates/{name}"] = content["files"]["certificates/0-2.npz"]
    manifest.write_text(json.dumps(content))
    found = verify_result(folder)
    assert [(pair.target, pair.source, pair.fault.split("/")[-1]) for pair in found.pairs] == [
        (
            "=sum",
            "b",
            "0-1.npz: is not a regular file",
        ),
        ("=sum", "c", ""),
        ("c", "=sum", "2-0.npz: pairs.csv has no such pair"),
    ]
    rewrite_table(folder, lambda rows: rows.append(["c", "=sum", *rows[2][2:]]))
    with pytest.raises(InputError, match="c - =sum occurs twice"):
        verify_result(folder)


@pytest.mark.parametrize(
    "name",
    [
        "alignment.json",
        "pairs.csv",
        "correspondences.npz",
        "certificates/problems.npz",
        ".collalign/manifest.json",
    ],
)
def test_pipes_are_not_opened(folder, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(InputError, match="not a regular file"):
        verify_result(folder)


def test_a_certificate_of_another_group_or_pair_is_refused(folder):
    record = read_json(folder / "alignment.json")
    record["decided"]["group"] = "O"
    (folder / "alignment.json").write_text(json.dumps(record))
    assert "special_blocks" in verify_result(folder).pairs[0].fault
    (folder / "certificates" / "0-2.npz").rename(folder / "certificates" / "1-2.npz")
    assert "cannot be read" in verify_result(folder).pairs[0].fault


def test_samples_that_are_not_those_of_the_result_are_refused(folder, certified):
    moved = certified.coordinates.copy()
    moved[1, 0, 0] += 1e-3
    np.savez(
        folder / "certificates" / "problems.npz", coordinates=moved, invariants=certified.invariants
    )
    with pytest.raises(InputError, match="samples of shape 1 are not those"):
        verify_result(folder)
    np.savez(
        folder / "certificates" / "problems.npz",
        coordinates=moved[..., :2],
        invariants=certified.invariants,
    )
    with pytest.raises(InputError, match="coordinates: 2 of each sample"):
        verify_result(folder)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("alignment.json", "{", "cannot be read as a result"),
        (
            "alignment.json",
            '{"shapes": [], "decided": {"group": "SO"}}',
            "cannot be read as a result",
        ),
        ("pairs.csv", "target,source\na,b\n", "cannot be read as a table"),
        ("certificates/problems.npz", "PK", "not an NPZ archive"),
    ],
)
def test_damaged_folders_are_named(folder, file, content, message):
    (folder / file).write_text(content)
    with pytest.raises(InputError, match=message):
        verify_result(folder)


def test_a_damaged_certificate_is_a_fault_of_its_pair(folder):
    (folder / "certificates" / "0-2.npz").write_bytes(b"PK")
    assert "not an NPZ archive" in verify_result(folder).pairs[0].fault


def test_a_folder_without_certificates_says_how_to_make_them(tmp_path):
    with pytest.raises(InputError, match="--certify"):
        verify_result(tmp_path)
