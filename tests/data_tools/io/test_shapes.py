import dataclasses
import os
import re

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError, UnavailableError
from data_tools.io.listing import READERS, hash_shape, read_folder, shapes_at
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.notes import Note
from data_tools.options import AS_STORED, CleaningOptions
from data_tools.surface.shape import Shape
from tests.data_tools.io.formats.test_text_points import MALFORMED as POINTS

TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"
PLY = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n{}end_header\n"
PLY_FACES = "element face {}\nproperty list uchar int vertex_indices\n"

#: File name, content, and what the error must say.
MALFORMED = [
    ("index99.off", "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 99\n", "names vertex 99"),
    ("negative.off", "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 -1\n", "face 0 is not a count"),
    (
        "nan.off",
        "OFF\n3 1 0\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n",
        "1 of 3 vertices have coordinates that are NaN or infinite",
    ),
    ("no_face.off", "OFF\n3 2 0\n" + TRIANGLE + "3 0 1 2\n", "truncated"),
    ("no_vertex.off", "OFF\n30 1 0\n" + TRIANGLE, "truncated"),
    ("no_counts.off", "OFF\n" + TRIANGLE, "not a readable|truncated|counts"),
    ("only_header.off", "OFF\n", "counts"),
    ("empty_mesh.off", "OFF\n0 0 0\n", "no points|no geometry|not a readable"),
    ("obj_inside.off", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not an OFF file"),
    ("words.off", "OFF\n3 1 0\n0 0 zero\n1 0 0\n0 1 0\n3 0 1 2\n", "vertex 0 is not three numbers"),
    (
        "index99.ply",
        PLY.format(3, PLY_FACES.format(1)) + TRIANGLE + "3 0 1 99\n",
        "names vertex 99, there are 3",
    ),
    (
        "fan.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1" + 5001 * " 2 3" + "\n",
        "corner of 10001 triangles, more than 10000",
    ),
    (
        "fan.off",
        "OFF\n3 1 0\n" + TRIANGLE + "10003 0" + 5001 * " 1 2" + "\n",
        "corner of 10001 triangles",
    ),
    (
        "below.ply",
        PLY.format(3, PLY_FACES.format(1)) + TRIANGLE + "3 0 1 -1\n",
        "names vertex -1, there are 3",
    ),
    (
        "nan.ply",
        PLY.format(3, PLY_FACES.format(1)) + TRIANGLE.replace("1 0 0", "nan 0 0") + "3 0 1 2\n",
        "NaN",
    ),
    (
        "huge_faces.ply",
        PLY.format(3, PLY_FACES.format(2 * 10**9)) + TRIANGLE + "3 0 1 2\n",
        "truncated",
    ),
    ("no_header.ply", TRIANGLE, "not a PLY file"),
    ("index99.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n", "names vertex 99, there are 3"),
    ("zero.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "is no corner"),
    ("below.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -9 1 2\n", "names vertex -9, there are 3"),
    ("cut.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "face 1 has 2 corners"),
    ("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "NaN"),
    ("short.obj", "v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n", "is not three numbers"),
    (
        "comma.obj",
        "v 0,5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "vertex 1 is not three numbers .save it with decimal points",
    ),
    ("flat.obj", "v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "is not three numbers"),
    ("garbage.obj", "\x00\x01 not a mesh", "no vertex lines"),
    ("garbage.stl", "not a mesh", "not an STL file, or truncated"),
    (
        "cut.stl",
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n",
        "truncated STL text",
    ),
    ("garbage.glb", "not a mesh at all, but long enough to be one", "not a glTF file"),
    ("point.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\n", "one place"),
    ("far.obj", "v 0 0 0\nv 1e200 0 0\nv 0 1 0\nf 1 2 3\n", "beyond 1e100"),
    ("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "zero area"),
    ("mesh.fbx", "anything", "unknown suffix '.fbx'"),
    ("mesh", "anything", "unknown suffix ''"),
]


@pytest.mark.parametrize(
    ("name", "content", "reason"), [pytest.param(*row, id=row[0]) for row in MALFORMED + POINTS]
)
def test_malformed_files_are_refused_by_name_and_reason(tmp_path, name, content, reason):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InputError, match=reason) as caught:
        read_shape(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("a.stl", b"ply\nformat ascii 1.0\n", "content is that of a .ply file; rename it"),
        ("a.ply", b"\xef\xbb\xbfsolid a\nfacet normal 0 0 1\n", "content is that of a .stl file"),
        ("a.off", b"# by hand\nmtllib a.mtl\no a\nv 0 0 0\n", "content is that of a .obj file"),
        ("a.obj", b"OFF\n3 1 0\n", "content is that of a .off file"),
        (
            "a.vtk",
            b'<?xml version="1.0"?>\n<VTKFile type="PolyData">',
            "content is that of a .vtp file",
        ),
        (
            "a.glb",
            b"<!DOCTYPE html>\n<html>not found</html>",
            "a web page; download the file again",
        ),
        ("a.ply", b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\n", "Git LFS"),
        ("a.ply", b"\x1f\x8b\x08\x00", "compressed with gzip; unpack it"),
        ("a.obj", b"PK\x03\x04", "a ZIP archive; unpack it"),
        ("a.npz", b"PK\x03\x04", "(damaged archive|or truncated)$"),
    ],
)
def test_what_a_file_is_instead_is_said(tmp_path, name, content, advice):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=advice):
        read_shape(tmp_path / name)


@pytest.mark.parametrize(
    "error",
    [
        UnboundLocalError("x"),
        AssertionError(),
        ValueError("could not convert string to float: 'secret'"),
    ],
)
def test_errors_of_readers_are_neither_named_nor_quoted(tmp_path, monkeypatch, error):
    def fail(source):
        raise error

    monkeypatch.setitem(READERS, ".ply", fail)
    path = tmp_path / "a.ply"
    path.write_text("secret")
    with pytest.raises(
        InputError, match=r"a\.ply: not a readable PLY file, it is damaged or of another format$"
    ):
        read_shape(path)
    error = ModuleNotFoundError("No module named 'zstd'", name="zstd")
    with pytest.raises(UnavailableError, match="cannot be read without the package zstd"):
        read_shape(path)


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj", ".stl", ".glb", ".npz", ".xyz"])
def test_missing_and_empty_files_are_refused(tmp_path, suffix):
    path = tmp_path / f"shape{suffix}"
    with pytest.raises(InputError, match="no such file"):
        read_shape(path)
    path.touch()
    with pytest.raises(InputError, match="empty"):
        read_shape(path)


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj", ".stl", ".glb"])
def test_round_trip_keeps_the_surface(tmp_path, suffix, rng):
    shape = blob(rng, num_vertices=100)
    back = read_shape(write_mesh(tmp_path / f"blob{suffix}", shape))
    assert back.name == "blob"
    assert back.file == tmp_path / f"blob{suffix}"
    assert len(back.vertices) == 100
    assert back.area == pytest.approx(shape.area, rel=1e-6)
    if suffix != ".stl":
        np.testing.assert_allclose(back.vertices, shape.vertices, atol=1e-6)
        np.testing.assert_array_equal(back.faces, shape.faces)
        assert back.source_indices is None


def test_stl_vertices_are_merged_and_say_so(tmp_path, rng):
    path = write_mesh(tmp_path / "blob.stl", blob(rng, num_vertices=100))
    back = read_shape(path)
    assert back.notes == (Note("duplicates-merged", values={"num": 3 * len(back.faces) - 100}),)
    assert back.source_indices is not None
    apart = read_shape(path, CleaningOptions(merge_vertices=False, components="all"))
    np.testing.assert_array_equal(apart.vertices[back.source_indices], back.vertices)


def test_obj_keeps_vertex_order_through_groups_textures_and_negative_indices(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(
        "mtllib ../m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1 # top\nvt 0 0\nvn 0 0 1\nusemtl a\nf 4/1/1 2/1/1 \\\n"
        "3/1/1\ng b\nusemtl c\nf 1//1 3//1 2//1\nf -4 -3 -1 -2\n"
    )
    shape = read_shape(path)
    np.testing.assert_array_equal(shape.vertices[1:], np.eye(3))
    np.testing.assert_array_equal(shape.faces, [[3, 1, 2], [0, 2, 1], [0, 1, 3], [0, 3, 2]])


def test_clouds_come_without_faces(tmp_path, rng):
    cloud = Shape.from_arrays(rng.standard_normal((30, 3)), name="cloud")
    for suffix in (".ply", ".obj"):
        back = read_shape(write_mesh(tmp_path / f"cloud{suffix}", cloud))
        assert not back.is_mesh
        np.testing.assert_allclose(back.vertices, cloud.vertices, atol=1e-6)
    with pytest.raises(InputError, match="point cloud"):
        write_mesh(tmp_path / "cloud.stl", cloud)
    with pytest.raises(InputError, match=r"cannot write '\.npz'"):
        write_mesh(tmp_path / "cloud.npz", cloud)


def test_folder_is_listed_in_natural_order_with_distinct_names(tmp_path):
    for name in ("b10.ply", "b2.ply", "a.off", "A.obj", "notes.md", ".hidden.ply"):
        (tmp_path / name).touch()
    (tmp_path / "folder.ply").mkdir()
    listing = read_folder(tmp_path)
    assert [f.name for f in listing.files] == ["A.obj", "a.off", "b2.ply", "b10.ply"]
    assert listing.names == ("A", "a", "b2", "b10")
    assert [f.name for f in listing.skipped] == ["folder.ply", "notes.md"]


def test_names_are_readable_whatever_the_files_are_called(tmp_path):
    for name in (b"a.ply", b"b.obj", b"a.ply.ply", b"\xff.ply"):
        with open(os.fsencode(tmp_path) + b"/" + name, "wb"):
            pass
    listing = read_folder(tmp_path)
    assert len(set(listing.names)) == 4
    assert "\n".join(listing.names).encode()  # no surrogates
    assert any("xff" in name for name in listing.names)


def test_a_name_does_not_depend_on_what_else_is_in_the_folder(tmp_path):
    files = ["desk_00.ply", "setA/desk_00.ply", "setB/desk_00.stl", "setB/old/desk_00.ply"]
    names = set()
    for count, file in enumerate(files, 1):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
        found = read_folder(tmp_path, recursive=True).names
        assert names < {*found}
        assert len(found) == count
        names = {*found}
    assert names == {"desk_00", "setA/desk_00", "setB/desk_00", "setB/old/desk_00"}


def test_folder_without_shapes_is_refused(tmp_path):
    (tmp_path / "notes.md").touch()
    with pytest.raises(InputError, match="no shape file"):
        read_folder(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        read_folder(tmp_path / "missing")


@pytest.fixture
def sides(tmp_path):
    """Two folders with a shape of one name each, and one with another."""
    for name in ("left/A.ply", "right/A.ply", "right/old/A.stl", "right/B2.ply", "right/notes.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    return tmp_path


def test_folders_in_a_folder_are_taken_when_asked_and_named_when_not(sides):
    with pytest.raises(
        InputError, match=r"its folders do: left \(1\), right \(3\); take them with --recursive"
    ):
        read_folder(sides)
    listing = read_folder(sides, recursive=True)
    assert listing.names == ("left/A", "right/A", "right/B2", "right/old/A")
    assert [path.name for path in listing.skipped] == ["notes.md"]
    assert read_folder(sides / "right").names == ("A", "B2")


def test_places_are_folders_patterns_lists_and_files(sides):
    (sides / "some.txt").write_text("# the left one and a pattern\nleft\n\nright/*\n")
    listed = shapes_at(f"@{sides / 'some.txt'}")
    assert listed.names == ("left/A", "right/A", "right/B2")
    assert [path.name for path in listed.skipped] == ["notes.md"]
    assert shapes_at(sides / "**" / "*.[ps]*").names == (
        "left/A",
        "right/A",
        "right/B2",
        "right/old/A",
    )
    assert shapes_at(sides / "right", recursive=True).names == ("A", "B2", "old/A")
    # A file that is not there is left out later, with this as the reason.
    assert shapes_at(sides / "none.ply").files == (sides / "none.ply",)
    for wrong, message in (
        (sides / "nowhere", "nowhere: no such file or folder"),
        (sides / "left" / "*.stl", "no shape file matches"),
        (f"@{sides / 'none.txt'}", "cannot be read"),
    ):
        with pytest.raises(InputError, match=re.escape(message)):
            shapes_at(wrong)
    (sides / "some.txt").write_text("left\nlfet\n")
    with pytest.raises(InputError, match=r"some\.txt, line 2: .*lfet: no such file"):
        shapes_at(f"@{sides / 'some.txt'}")


def with_gaps(tmp_path, suffix, bad):
    """Write a mesh of which some vertices are NaN or infinite, and return it as it was."""
    shape = blob(np.random.default_rng(3), num_vertices=200)
    vertices = shape.vertices.copy()
    vertices[bad, np.arange(len(bad)) % 3] = np.resize([np.nan, np.inf, -np.inf], len(bad))
    path = tmp_path / f"gaps{suffix}"
    if suffix == ".npz":
        np.savez(path, vertices=vertices, faces=shape.faces)
    else:
        write_mesh(path, dataclasses.replace(shape, vertices=vertices))
    return path, shape


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj", ".npz"])
def test_a_few_vertices_that_are_not_finite_are_dropped_with_their_triangles(tmp_path, suffix):
    path, whole = with_gaps(tmp_path, suffix, [0, 17, 199])
    shape = read_shape(path)
    touched = np.isin(whole.faces, [0, 17, 199]).any(axis=1)
    assert shape.notes == (
        Note("non-finite-dropped", values={"vertices": 3, "triangles": touched.sum()}),
    )
    assert shape.source_indices is not None
    np.testing.assert_array_equal(shape.source_indices, np.setdiff1d(np.arange(200), [0, 17, 199]))
    np.testing.assert_allclose(shape.vertices, whole.vertices[shape.source_indices], atol=1e-5)
    np.testing.assert_array_equal(shape.source_indices[shape.faces], whole.faces[~touched])


def test_many_vertices_that_are_not_finite_are_damage(tmp_path):
    path, _ = with_gaps(tmp_path, ".ply", list(range(11)))
    with pytest.raises(InputError, match=r"gaps\.ply: 11 of 200 vertices .* damage"):
        read_shape(path)


def test_colours_behind_the_corners_of_off_faces_are_no_corners(tmp_path):
    (tmp_path / "a.off").write_text("OFF\n3 2 0\n" + TRIANGLE + "3 0 1 2 255 0 0\n3 2 1 0\n")
    assert read_shape(tmp_path / "a.off", AS_STORED).faces.tolist() == [[0, 1, 2], [2, 1, 0]]


@pytest.mark.parametrize("name", ["a.ply", "a.*"])
def test_a_file_that_vanishes_is_the_machines_failure(tmp_path, name):
    """And not one of its content, which would be remembered."""
    (tmp_path / "a").mkdir()
    for place in (tmp_path, tmp_path / "a"):
        write_mesh(place / "a.ply", blob(np.random.default_rng(0), num_vertices=60))
    path = tmp_path / name
    digest = hash_shape(path)
    assert read_shape(path, digest=digest).name == "a"
    (tmp_path / "a.ply").unlink()
    (tmp_path / "a" / "a.ply").unlink()
    with pytest.raises(UnavailableError, match="has vanished since the run began; put it back"):
        read_shape(path, digest=digest)
    with pytest.raises(InputError, match=r"no such file|no files of its parts"):
        read_shape(path)
