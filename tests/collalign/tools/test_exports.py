"""Every format is read back by an independent reader; where none can be installed, by the rules of the main one."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from collalign.analysis.procrustes import centroid_sizes
from collalign.products.shapes import Incomplete
from collalign.tools.export.run import FORMATS, export, notes_of_export
from collalign.wording import note_text
from data_tools.errors import InputError, OptionsError
from data_tools.landmark_files import read_landmarks
from data_tools.landmark_tables import read_specimens
from data_tools.notes import Note
from tests.commands import read_json, read_rows
from tests.optional import optional_module
from tests.view_problems import NUM_SAMPLES, view_of


@pytest.fixture
def view(tmp_path_factory):
    """Six shapes whose files exist, four samples missing."""
    plain = view_of(6, num_missing=4)
    folder = tmp_path_factory.mktemp("in")
    files = []
    for name, vertices, faces in zip(plain.names, plain.vertices, plain.faces, strict=True):
        file = folder / f"{name}.ply"
        trimesh.Trimesh(vertices, faces, process=False).export(file)
        files.append(str(file))
    return dataclasses.replace(plain, files=tuple(files))


@pytest.mark.parametrize("format", FORMATS)
def test_files_are_where_they_are_said_to_be_and_the_same_each_time(view, tmp_path, format):
    first = export(view, format, tmp_path / "one")
    second = export(view, format, tmp_path / "two")
    assert first
    assert len(set(first)) == len(first)
    for a, b in zip(first, second, strict=True):
        assert a.is_relative_to(tmp_path / "one")
        assert a.read_bytes() == b.read_bytes()


@pytest.mark.parametrize("format", ["tps", "morphologika"])
def test_tables_of_landmarks_are_read_again(view, tmp_path, format):
    found = read_specimens(export(view, format, tmp_path)[0])
    assert tuple(found) == view.names
    sized = view.aligned_landmarks / view.scales[:, None, None]
    np.testing.assert_allclose([marks.points for marks in found.values()], sized, atol=1e-12)


def test_formats_for_statistics_are_reflected_keep_size_and_say_so(view, tmp_path):
    assert 0 < view.reflected.sum() < 6
    found = [
        marks.points for marks in read_specimens(export(view, "tps", tmp_path / "tps")[0]).values()
    ]
    np.testing.assert_allclose(centroid_sizes(np.array(found)), view.centroid_sizes, rtol=1e-12)
    assert [
        handedness(*pair) < 0 for pair in zip(view.landmarks, found, strict=True)
    ] == view.reflected.tolist()
    comments = [
        line
        for line in (tmp_path / "tps" / "landmarks.tps").read_text().splitlines()
        if "COMMENT" in line
    ]
    assert ["not" not in line for line in comments] == view.reflected.tolist()
    table = read_rows(tmp_path / "tps" / "specimens.csv")
    assert [row["coordinates"] for row in table] == [
        line.removeprefix("COMMENT=") for line in comments
    ]
    assert [float(row["centroid_size_landmarks"]) for row in table] == view.centroid_sizes.tolist()
    noted = (tmp_path / "tps" / "notes-tps.txt").read_text()
    assert (
        f"{int(view.reflected.sum())} of 6 specimens are reflected; centroid sizes are kept"
        in noted
    )
    raw = read_specimens(export(view, "tps", tmp_path / "raw", space="raw")[0])
    np.testing.assert_array_equal([marks.points for marks in raw.values()], view.landmarks)
    assert (
        "which statistics would find as shape" in (tmp_path / "raw" / "notes-tps.txt").read_text()
    )


def handedness(points, moved):
    """Sign of the linear map that takes points to where they were moved."""
    known = np.isfinite(points).all(axis=1)
    points, moved = (one[known] - one[known].mean(axis=0) for one in (points, moved))
    return np.linalg.det(np.linalg.lstsq(points, moved, rcond=None)[0])


def test_what_the_alignment_said_is_repeated(view, tmp_path):
    noted = dataclasses.replace(view, notes=(Note("much-larger", ("b",), {"times": (9.0,)}),))
    for format in ("csv", "itk"):
        export(noted, format, tmp_path / format)
        assert note_text(noted.notes[0]) in (tmp_path / format / f"notes-{format}.txt").read_text()


def test_itk_by_simpleitk_is_the_inverse_pose(view, tmp_path):
    sitk = optional_module("SimpleITK")
    for at, path in enumerate(export(view, "itk", tmp_path)):
        transform = sitk.ReadTransform(str(path))
        raw, aligned = (
            view.vertices[at][7],
            np.append(view.vertices[at][7], 1) @ view.transforms[at].T,
        )
        np.testing.assert_allclose(
            transform.TransformPoint(aligned[:3].tolist()), raw, rtol=1e-9, atol=1e-9
        )
        np.testing.assert_allclose(
            transform.GetInverse().TransformPoint(raw.tolist()), aligned[:3], rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("told", ["header", "caller"])
def test_files_in_ras_keep_their_numbers_and_say_so(view, tmp_path, told):
    if told == "header":
        file = Path(view.files[0])
        file.write_bytes(
            file.read_bytes().replace(b"\nelement", b"\ncomment SPACE=RAS\nelement", 1)
        )
    system = "RAS" if told == "caller" else "LPS"
    raw = [
        read_landmarks(p)
        for p in export(view, "slicer-json", tmp_path / "raw", space="raw", system=system)
    ]
    assert [one.system for one in raw] == ["RAS"] + ["RAS" if told == "caller" else "LPS"] * 5
    known = np.isfinite(view.landmarks[0]).all(axis=1)
    assert np.isin(view.landmarks[0][known], raw[0].points).all()
    posed = [
        read_landmarks(p) for p in export(view, "slicer-json", tmp_path / "posed", system=system)
    ]
    assert {one.system for one in posed} == {"LPS"}


def test_poses_of_files_that_declare_ras_are_those_of_the_scene(view, tmp_path):
    before = [path.read_text().splitlines()[3] for path in export(view, "itk", tmp_path)[:2]]
    file = Path(view.files[0])
    file.write_bytes(file.read_bytes().replace(b"\nelement", b"\ncomment SPACE=RAS\nelement", 1))
    after = [path.read_text().splitlines()[3] for path in export(view, "itk", tmp_path)[:2]]
    numbers = [np.array(text.split()[1:], dtype=float) for text in (before[0], after[0])]
    np.testing.assert_array_equal(numbers[1], numbers[0] * [*[-1] * 6, *[1] * 3, -1, -1, 1])
    assert after[1] == before[1]


def test_shapeworks_project_holds_together(view, tmp_path):
    project_file, *files = export(view, "shapeworks", tmp_path)
    project = read_json(project_file)
    complete = ~np.isnan(view.landmarks).any(axis=(0, 2))
    assert len(files) == 3 * len(view)
    for at, entry in enumerate(project["data"]):
        assert all(isinstance(value, str) for value in entry.values())
        T = np.array(entry["alignment_1"].split(), dtype=float).reshape(4, 4)
        mesh = trimesh.load_mesh(tmp_path / entry["shape_1"], process=False)
        np.testing.assert_allclose(mesh.vertices, view.vertices[at], rtol=1e-6, atol=1e-6)
        text = (tmp_path / entry["local_particles_1"]).read_text()
        assert text.endswith("\n")
        local, world = (
            np.array(text.split(), dtype=float),
            np.loadtxt(tmp_path / entry["world_particles_1"]),
        )
        np.testing.assert_array_equal(local.reshape(-1, 3), view.landmarks[at][complete])
        np.testing.assert_allclose(
            local.reshape(-1, 3) @ T[:3, :3].T + T[:3, 3], world, rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("format", ["ply", "obj", "stl"])
@pytest.mark.parametrize("space", ["aligned", "unscaled", "raw"])
def test_meshes_by_trimesh(view, tmp_path, format, space):
    for at, path in enumerate(export(view, format, tmp_path, space=space)):
        mesh = trimesh.load_mesh(path)
        T = {"raw": np.eye(4), "aligned": view.transforms[at]}.get(
            space, view.transforms[at] / view.scales[at]
        )
        expected = view.vertices[at] @ T[:3, :3].T + T[:3, 3]
        np.testing.assert_allclose(
            mesh.bounds, [expected.min(axis=0), expected.max(axis=0)], rtol=1e-4, atol=1e-5
        )
        raw_volume = trimesh.Trimesh(view.vertices[at], view.faces[at], process=False).volume
        turned = np.sign(np.linalg.det(T[:3, :3]))
        assert np.sign(mesh.volume) == np.sign(raw_volume) * (turned if space == "raw" else 1)


def placed(pose, points):
    return points @ pose[:3, :3].T + pose[:3, 3]


def poses_of_log(path):
    """Read a trajectory: a line of three numbers and four of a pose, each."""
    lines = [line.split() for line in path.read_text().splitlines()]
    assert lines[::5] == [[str(n), str(n), str(n + 1)] for n in range(len(lines) // 5)]
    return np.array(
        [[[float(x) for x in row] for row in lines[n + 1 : n + 5]] for n in range(0, len(lines), 5)]
    )


@pytest.mark.parametrize("space", ["aligned", None])
def test_poses_for_open3d_are_those_of_the_result(view, tmp_path, space):
    log, graph, table = export(view, "open3d", tmp_path, space=space)
    expected = view.transforms.copy()
    if space is None:
        expected[:, :3] /= view.scales[:, None, None]
    np.testing.assert_allclose(poses_of_log(log), expected, rtol=1e-12)
    nodes = read_json(graph)["nodes"]
    poses = [np.array(node["pose"]).reshape(4, 4, order="F") for node in nodes]
    np.testing.assert_allclose(poses, expected, rtol=1e-12)
    assert [row["name"] for row in read_rows(table)] == list(view.names)


def test_a_meshlab_project_names_meshes_that_its_poses_place(view, tmp_path):
    project, *meshes = export(view, "meshlab", tmp_path)
    lines = project.read_text().splitlines()
    assert (lines[0], lines[-1]) == (str(len(view)), "0")
    assert lines[2::7] == lines[7::7] == ["#"] * len(view)
    for at, mesh in enumerate(meshes):
        assert tmp_path / lines[1 + 7 * at] == mesh
        pose = np.array([line.split() for line in lines[3 + 7 * at : 7 + 7 * at]], dtype=float)
        there = placed(pose, trimesh.load_mesh(mesh, process=False).vertices)
        expected = placed(view.transforms[at] / view.scales[at], view.vertices[at])
        np.testing.assert_allclose(there, expected, rtol=1e-4, atol=1e-5)


def test_one_cloud_has_a_label_of_each_point(view, tmp_path):
    merged, table = export(view, "merged", tmp_path, space="aligned")
    header, body = merged.read_bytes().split(b"end_header\n", 1)
    assert b"property int label" in header
    points = np.frombuffer(body, dtype="<f8,<f8,<f8,<i4")
    labels = points["f3"]
    assert np.bincount(labels).tolist() == [len(vertices) for vertices in view.vertices]
    for at, row in enumerate(read_rows(table)):
        assert row["name"] == view.names[at]
        there = np.stack([points[f"f{axis}"][labels == int(row["label"])] for axis in range(3)], 1)
        expected = placed(view.transforms[at], view.vertices[at])
        np.testing.assert_allclose(there, expected, rtol=1e-5, atol=1e-6)
    cloud = trimesh.load(merged)
    assert len(cloud.vertices) == len(points)


def test_parquet_tables_are_read_by_column_and_say_what_csv_says(view, tmp_path):
    parquet = optional_module("pyarrow.parquet")
    export(view, "csv", tmp_path)
    files = {path.stem: path for path in export(view, "parquet", tmp_path)}
    assert set(files) == {"shapes", "landmarks", "pairs"}
    names = parquet.read_table(files["shapes"], columns=["name", "T11"]).to_pydict()
    assert names == {"name": list(view.names), "T11": view.transforms[:, 0, 0].tolist()}
    landmarks = parquet.read_table(files["landmarks"]).to_pylist()
    written = read_rows(tmp_path / "landmarks.csv")
    assert [row["landmark"] for row in landmarks] == [row["landmark"] for row in written]
    np.testing.assert_array_equal(
        [row["x"] for row in landmarks], [float(row["x"] or "nan") for row in written]
    )
    energies = [row["energy"] for row in parquet.read_table(files["pairs"]).to_pylist()]
    np.testing.assert_array_equal(energies, [pair.energy for pair in view.pairs])


def test_without_pyarrow_parquet_says_what_to_install(view, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'collalign\[parquet\]'"):
        export(view, "parquet", tmp_path)
    assert not any(tmp_path.glob("*.parquet"))


def test_csv_tables(view, tmp_path):
    files = {path.name: path for path in export(view, "csv", tmp_path)}
    assert set(files) == {"shapes.csv", "landmarks.csv"}
    shapes = read_rows(files["shapes.csv"])
    T = [[float(row[f"T{a}{b}"]) for a in (1, 2, 3) for b in (1, 2, 3, 4)] for row in shapes]
    np.testing.assert_array_equal(np.array(T).reshape(-1, 3, 4), view.transforms[:, :3])
    landmarks = read_rows(files["landmarks.csv"])
    assert len(landmarks) == 6 * NUM_SAMPLES
    assert sum(row["x"] == "" for row in landmarks) == 4


@pytest.mark.parametrize("incomplete", [(), (3,)])
def test_doubtful_and_incomplete_shapes_have_rows_but_move_nothing_that_is_computed(
    view, tmp_path, incomplete
):
    half = {"partners": np.array([0]), "overlaps": np.array([[0.5, 1.0]]), "reason": "named"}
    lacking = tuple(Incomplete(shape=at, **half) for at in incomplete)
    view = dataclasses.replace(view, incomplete=lacking)
    turned = view.transforms.copy()
    turned[[1, *incomplete], :3, :3] = turned[[1, *incomplete], :3, :3][..., ::-1]
    out = sorted([1, *incomplete])
    tables = {}
    for to, transforms in (("a", view.transforms), ("b", turned)):
        moved = dataclasses.replace(view, transforms=transforms)
        export(moved, "csv", tmp_path / to)
        export(moved, "tps", tmp_path / to / "superimposed", space="procrustes")
        tables[to] = {
            path.name: path.read_text()
            for path in (tmp_path / to).rglob("[!m]*.*")
            if path.is_file()
        }
    told = {"notes-csv.txt", "notes-tps.txt"}  # which say how many are reflected
    computed = {name for name in tables["a"] if not name.startswith("run-")} - told
    changed = {name for name in computed if tables["a"][name] != tables["b"][name]}
    assert changed == {"shapes.csv", "landmarks.csv"}
    superimposed = tables["a"]["landmarks.tps"]
    assert [view.names[at] for at in range(6) if view.names[at] not in superimposed] == [
        view.names[at] for at in out
    ]
    assert tables["a"]["left_out.csv"].splitlines()[1] == "shape_001,in doubt"
    marked = [row["left_out"] for row in read_rows(tmp_path / "a" / "shapes.csv")]
    assert [at for at, reason in enumerate(marked) if reason] == out
    everybody = export(view, "tps", tmp_path / "all", space="procrustes", include_doubtful=True)
    assert everybody[0].read_text().count("LM3=") == 6
    for table in (tmp_path / "a" / "shapes.csv", tmp_path / "all" / "specimens.csv"):
        told = (
            [(row["incomplete"], row["coverage"]) for row in read_rows(table)] if incomplete else []
        )
        assert told == [
            ("1", "0.5") if at in incomplete else ("0", "") for at in range(6 if incomplete else 0)
        ]
    nobody = dataclasses.replace(view, confidence=np.full(6, 0.3))
    with pytest.raises(InputError, match="0 shapes are complete and sure"):
        export(nobody, "tps", tmp_path / "none", space="procrustes")


def test_procrustes_space_is_for_landmarks_only(view, tmp_path):
    text = export(view, "tps", tmp_path, space="procrustes")[0].read_text()
    assert text.count(f"LM3={NUM_SAMPLES - 3}") == 5, "of the shapes that count, in doubt is one"
    with pytest.raises(OptionsError, match="landmarks only"):
        export(view, "ply", tmp_path, space="procrustes")


def test_who_is_excluded_is_written_nowhere_and_listed(view, tmp_path):
    out, *others = view.names
    for format, table in (("tps", "specimens.csv"), ("csv", "shapes.csv")):
        export(view, format, tmp_path / format, exclude=[out])
        assert [row["name"] for row in read_rows(tmp_path / format / table)] == others
        assert (
            f"{out},excluded by name"
            in (tmp_path / format / "left_out.csv").read_text().splitlines()
        )
    assert any(out in line for line in notes_of_export(tmp_path / "tps", "tps"))
    export(view, "tps", tmp_path / "all", space="raw")
    assert not any(out in line for line in notes_of_export(tmp_path / "all", "tps"))
    with pytest.raises(InputError, match="nobody"):
        export(view, "tps", tmp_path, exclude=["nobody"])


def test_only_the_surest_shapes_are_written_and_the_others_are_listed(view, tmp_path):
    view = dataclasses.replace(view, confidence=np.array([1.0, 0.5, 0.999, 0.97, np.nan, 0.998]))
    kept = [view.names[at] for at in (0, 2, 5)]
    for format, table in (("tps", "specimens.csv"), ("csv", "shapes.csv")):
        export(view, format, tmp_path / format, right=0.996)
        assert [row["name"] for row in read_rows(tmp_path / format / table)] == kept
        left_out = {
            row["name"]: row["reason"] for row in read_rows(tmp_path / format / "left_out.csv")
        }
        assert [*left_out] == [name for name in view.names if name not in kept]
        assert {*left_out.values()} == {"less sure than the share of right poses asks for"}
    meshes = export(view, "ply", tmp_path / "ply", right=0.996)
    assert sorted(path.stem for path in meshes) == sorted([*kept, "left_out"])
    (said,) = (line for line in notes_of_export(tmp_path / "ply", "ply") if "3 of 6" in line)
    export(view, "ply", tmp_path / "every")
    assert said not in notes_of_export(tmp_path / "every", "ply")
    export(view, "ply", tmp_path / "more", right=0.8)
    left_out = {row["name"] for row in read_rows(tmp_path / "more" / "left_out.csv")}
    written = {path.stem for path in (tmp_path / "more").glob("*.ply")}
    assert left_out == {*view.names} - written
    assert view.names[1] in written, "in doubt, but sure enough for this share"
    doubted = dataclasses.replace(view, confidence=np.full(6, 0.4))
    with pytest.raises(InputError, match="keeps none of 6 shapes"):
        export(doubted, "ply", tmp_path / "none", right=0.99)
    assert not (tmp_path / "none").exists()


def test_too_few_common_landmarks_are_refused_with_advice(view, tmp_path):
    samples = view.landmarks.copy()
    samples[0, : NUM_SAMPLES - 2] = np.nan
    partial = dataclasses.replace(view, landmarks=samples)
    with pytest.raises(InputError, match="exist on every shape"):
        export(partial, "shapeworks", tmp_path)


def test_unknown_formats_and_spaces_are_refused(view, tmp_path):
    with pytest.raises(OptionsError, match="expected one of morphologika"):
        export(view, "vtk", tmp_path)
    with pytest.raises(OptionsError, match="expected one of aligned"):
        export(view, "tps", tmp_path, space="ras")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="not a directory"):
        export(view, "tps", tmp_path / "file" / "under")
