import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.shapes import read_shape

MALFORMED = [
    ("nan.xyz", "0 0 0\nnan 1 2\n3 4 5\n", "NaN"),
    ("inf.xyz", "0 0 0\ninf 1 2\n3 4 5\n", "infinite"),
    ("cut.xyz", "0 0 0\n1 2 3\n4 5\n", "row 3 has 2 columns"),
    ("flat.xyz", "0 0\n1 2\n", "2 columns, expected 3"),
    ("words.xyz", "0 0 0\n1 two 3\n", "row 2 is not numbers"),
    ("gap.csv", "0,0,0\n1,,3\n4,5,6\n", "1 of 9 values are NaN"),
    ("gaps.csv", "x,y,z,w\n,0,0,7\n,2,3,7\n,5,6,7\n", "3 of 9 values are NaN"),
    ("comments.xyz", "# nothing\n\n", "no points"),
    ("header.csv", "x,y,z\n", "no points"),
    ("binary.txt", "\x00\x01\x02", "columns|no points|numbers"),
    (
        "prose.txt",
        "This is a letter to a friend.\nIt has no points in it, or few.\n",
        "columns|numbers",
    ),
    ("few.xyz", "4\n0 0 0\n1 2 3\n4 5 7\n", "its first line promises 4 points, 3 lines follow"),
    (
        "many.pts",
        "2\n0 0 0 9\n1 2 3 9\n4 5 7 9\n",
        "its first line promises 2 points, 3 lines follow",
    ),
    ("huge.pts", "9" * 30 + "\n0 0 0\n", "promises 99999999999999999999 points, 1 lines follow"),
    (
        "landmarks.pts",
        "Version 1.0\n3\nS000 0 0 0\nS001 1 2 3\nS002 4 5 7\n",
        "landmarks, no point cloud",
    ),
    ("counts.pts", "0\n0\n", "no points"),
    ("text.npz", "not an archive", "not an NPZ archive"),
    ("start.npz", "PK\x03\x04", "not an NPZ archive|damaged"),
    ("end.npz", "PK\x05\x06" + "\x00" * 18, "none of the arrays"),
    ("tabs.txt", "\t\t\t\n", "no points"),
    ("mark.txt", "\ufeff", "no points"),
    ("hex.txt", "0x10 0x20 0x30\n0x1 0x2 0x3\n", "columns|numbers"),
    ("null.txt", "1 2 3\n\x004 5 6\n", "numbers"),
]


@pytest.mark.parametrize("suffix", [".xyz", ".asc", ".pts", ".txt"])
def test_the_number_of_points_may_come_first(tmp_path, suffix):
    for count in ("", "3\n", "003 \r\n", "# by hand\n\n3\n", "//X Y Z I\n3\n"):
        (tmp_path / f"a{suffix}").write_text(f"{count}0 0 0 1\n1 2 3 1\n4 5 7 1\n")
        np.testing.assert_array_equal(
            read_shape(tmp_path / f"a{suffix}").vertices, [[0, 0, 0], [1, 2, 3], [4, 5, 7]]
        )


def test_pts_files_hold_several_scans_with_intensities_and_colours(tmp_path):
    (tmp_path / "a.pts").write_text("2\n0 0 0 -900 1 2 3\n1 2 3 17 4 5 6\n1\n4 5 7 8 9 9 9\n")
    np.testing.assert_array_equal(
        read_shape(tmp_path / "a.pts").vertices, [[0, 0, 0], [1, 2, 3], [4, 5, 7]]
    )


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
def test_clouds_and_obj_may_be_in_any_encoding(tmp_path, encoding):
    (tmp_path / "a.txt").write_bytes("Länge_x;y;z\r\n0;0;0\r\n1;2;3\r\n4;5;7\r\n".encode(encoding))
    (tmp_path / "a.obj").write_bytes(
        "v 0 0 0\ng Schädel\nv 1 2 3\nv 4 5 7\nf 1 2 3\n".encode(encoding)
    )
    for suffix in (".txt", ".obj"):
        np.testing.assert_array_equal(
            read_shape(tmp_path / f"a{suffix}").vertices, [[0, 0, 0], [1, 2, 3], [4, 5, 7]]
        )


@pytest.mark.parametrize(
    ("name", "content", "lost"),
    [
        ("a.obj", "v 0 0 0 .1 .2 .3\nv 1 2 3 1 1 1\nv 4 5 7 1 0 0\nvt 0 0\nusemtl bone\nf 1/1 2/1 3/1\n",
         "colours, materials, texture coordinates"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 2 3\n4 5 7\n3 0 1 2 .5 .5 .5\n", "colours"),
        ("a.csv", "x,y,z,red,\n0,0,0,9,\n1,2,3,9,\n4,5,7,9,\n", "further columns"),
        ("a.pts", "3\n0 0 0 -7 1 2 3\n1 2 3 -7 4 5 6\n4 5 7 -7 1 1 1\n", "further columns"),
        ("b.obj", "v 0 0 0 1\nv 1 2 3 1\nv 4 5 7 1\nf 1 2 3\n", None),
        ("b.off", "OFF\n3 1 0\n0 0 0\n1 2 3\n4 5 7\n3 0 1 2\n", None),
        ("b.csv", "x,y,z,\n0,0,0,\n1,2,3,\n4,5,7,\n", None),
    ],
)  # fmt: skip
def test_what_no_output_keeps_is_noted(tmp_path, name, content, lost):
    (tmp_path / name).write_text(content)
    assert list(read_shape(tmp_path / name).notes) == list(
        not_kept(lost.split(", ")) if lost else ()
    )


def test_npz_holds_meshes_and_clouds(tmp_path, rng):
    shape = blob(rng, num_vertices=50)
    np.savez(tmp_path / "mesh.npz", vertices=shape.vertices, faces=shape.faces)
    np.savez(tmp_path / "libigl.npz", V=shape.vertices, F=shape.faces)
    assert read_shape(tmp_path / "libigl.npz").is_mesh
    np.savez_compressed(tmp_path / "cloud.npz", points=shape.vertices.astype(np.float32))
    np.testing.assert_array_equal(read_shape(tmp_path / "mesh.npz").faces, shape.faces)
    assert not read_shape(tmp_path / "cloud.npz").is_mesh


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"other": np.zeros((3, 3))}, "none of the arrays"),
        ({"vertices": np.zeros((3, 2))}, "shape"),
        ({"vertices": np.zeros((0, 3))}, "no points"),
        ({"vertices": np.full((3, 3), np.nan)}, "NaN"),
        ({"vertices": np.eye(3), "faces": np.array([[0, 1, 99]])}, r"expected them in \[0, 3\)"),
        ({"vertices": np.eye(3), "faces": np.array([[0.0, 1.0, 2.0]])}, "integer"),
        ({"vertices": np.array(["a", "b"])}, "real numbers"),
        ({"vertices": np.array([{"a": 1}], dtype=object)}, "pickle|not a readable"),
    ],
)
def test_npz_arrays_are_checked(tmp_path, arrays, reason):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=reason) as caught:
        read_shape(path)
    assert str(path) in str(caught.value)
