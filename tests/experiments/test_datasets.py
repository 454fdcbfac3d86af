from dataclasses import replace

import numpy as np
import pytest

from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation, rotation_angle_deg
from experiments import datasets
from experiments.ground_truth import landmark_rotation


@pytest.fixture
def registered(rng):
    base = blob(rng, num_vertices=80)
    return [bumped(base, rng) for _ in range(3)]


def quaternion_pose(scan, q, t):
    """The vertices in the common frame, by rotating with the conjugate quaternion (independent of any matrix)."""
    axis, w = -q[:3], q[3]
    v = scan.vertices
    return v + 2 * np.cross(axis, np.cross(axis, v) + w * v) + t


def test_teeth_layout(tmp_path, registered, rng):
    names = ["B1", "A2", "C3"]
    marks = np.stack([s.vertices[:18] for s in registered])
    rows = ["name,file,order,family,genus,chirality_from_landmarks"]
    for i, (name, shape) in enumerate(zip(names, registered, strict=True)):
        write_mesh(tmp_path / "meshes" / f"{name}_sas.off", shape)
        rows.append(f"{name},{name}_sas.off,Primates,F{i},NA,{(-1) ** i}")
    (tmp_path / "labels.csv").write_text("\n".join(rows) + "\n")
    nearest = np.tile(np.arange(18), (3, 1))
    np.savez(
        tmp_path / "landmarks_mesh_coords.npz",
        names=names[::-1],
        landmarks=marks[::-1],
        nearest_vertex=nearest,
    )
    teeth = datasets.read_teeth(tmp_path)
    assert teeth.names == ("B1", "A2", "C3")
    np.testing.assert_array_equal(teeth.landmarks, marks[:, :16])
    assert teeth.labels["genus"] == ("", "", "")
    assert teeth.chirality.tolist() == [1, -1, 1]
    np.testing.assert_allclose(teeth.shape("A2").vertices, registered[1].vertices, atol=1e-6)
    assert teeth.shape(1).name == "A2"
    np.testing.assert_allclose(
        teeth.rotation(0, 2, group="O"), landmark_rotation(marks[0, :16], marks[2, :16], group="O")
    )
    with pytest.raises(InputError, match="no shape is called 'D4'"):
        teeth.shape("D4")


def test_registered_archive_layout(tmp_path, registered):
    vertices = np.stack([s.vertices for s in registered]).astype(np.float32)
    faces = np.stack([s.faces for s in registered]).astype(np.uint16)
    np.savez(tmp_path / "all.npz", vertices=vertices, faces=faces, names=["a", "b", "c"])
    (tmp_path / "Corrs").mkdir()
    (tmp_path / "Corrs" / "1.pid").write_text("4 0 0 0\n9 0 0 0\n")
    (tmp_path / "Corrs" / "1.sym.info").write_text("0 1\n")
    found = datasets.read_registered_archive(tmp_path)
    assert found.vertices_correspond
    assert found.landmark_vertices.tolist() == [[4, 9]] * 3
    assert found.mirror.tolist() == [1, 0]
    np.testing.assert_array_equal(found.shape("b").vertices, vertices[1])
    truth = landmark_rotation(vertices[0].astype(float), vertices[1].astype(float))
    np.testing.assert_allclose(found.rotation(0, 1), truth, atol=1e-12)
    with pytest.raises(InputError, match="neither poses nor landmarks"):
        replace(found, vertices_correspond=False).rotation(0, 1)


def test_range_scan_layout(tmp_path, registered, rng):
    quaternions = rng.standard_normal((3, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    shifts = rng.standard_normal((3, 3))
    lines = ["camera 0 0 0 0 0 0 1"]
    for i, shape in enumerate(registered):
        write_mesh(tmp_path / f"scan{i}.ply", shape)
        pose = " ".join(repr(float(x)) for x in (*shifts[i], *quaternions[i]))
        lines.append(f"bmesh scan{i}.ply {pose}")
    (tmp_path / "all.conf").write_text("\n".join(lines))
    scans = datasets.read_range_scans(tmp_path)
    assert scans.names == ("scan0", "scan1", "scan2")
    for i, shape in enumerate(registered):
        placed = shape.vertices @ scans.rotations[i].T + scans.translations[i]
        np.testing.assert_allclose(
            placed, quaternion_pose(shape, quaternions[i], shifts[i]), atol=1e-9
        )
    np.testing.assert_allclose(scans.rotation(0, 1), scans.rotations[0].T @ scans.rotations[1])


def test_landmark_archive_layout(tmp_path, rng):
    points = rng.standard_normal((4, 9, 3))
    np.savez(tmp_path / "marks.npz", landmarks=points, names=list("abcd"))
    found = datasets.read_landmark_archive(tmp_path / "marks.npz")
    assert len(found) == 4
    assert not found.shape("c").is_mesh
    turn = random_rotation(rng)
    np.savez(
        tmp_path / "marks.npz",
        landmarks=np.stack([points[0], points[0] @ turn.T]),
        names=["a", "b"],
    )
    pair = datasets.read_landmark_archive(tmp_path / "marks.npz")
    assert rotation_angle_deg(pair.rotation(1, 0), turn) < 1e-9


@pytest.mark.data
def test_public_collections_agree_with_their_ground_truth(shared_data):
    teeth = datasets.read_teeth(shared_data / "teeth_pnas116")
    ant = datasets.read_shrec07_class(shared_data / "shrec07_dev" / "ant")
    for dataset, count, tolerance in ((teeth, 116, 0.03), (ant, 20, 1e-6)):
        assert len(dataset) == count
        shape = dataset.shape(5)
        gap = shape.vertices[dataset.landmark_vertices[5]] - dataset.landmarks[5]
        assert np.linalg.norm(gap, axis=1).max() < tolerance * np.linalg.norm(
            np.ptp(shape.vertices, axis=0)
        )
    signs = [np.linalg.det(teeth.rotation(0, j, group="O")) for j in range(116)]
    np.testing.assert_array_equal(np.sign(signs), teeth.chirality[0] * teeth.chirality)
