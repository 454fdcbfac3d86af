"""What headers promise, and the parts of scenes, on files made by hand."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.headers import check_ply, check_stl
from data_tools.io.mesh_formats import _concatenate, _part

FILE = Path("a.ply")
HEADER = b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty double y\nproperty uchar z\n"
FACES = b"element face %d\nproperty list uchar int vertex_indices\n"


def ply(kind, vertices, faces, body):
    return HEADER % (kind, vertices) + (b"" if faces is None else FACES % faces) + b"end_header\n" + body


def test_binary_ply_bodies_are_counted_to_the_byte():
    size = 4 + 8 + 1
    assert check_ply(FILE, ply(b"binary_little_endian", 3, None, b"\0" * 3 * size)) == {"vertex": 3}
    with pytest.raises(InputError, match=f"at least {3 * size} bytes of data and {3 * size - 1} follow"):
        check_ply(FILE, ply(b"binary_little_endian", 3, None, b"\0" * (3 * size - 1)))
    # a list has at least its count, of the first type named
    assert check_ply(FILE, ply(b"binary_little_endian", 1, 2, b"\0" * (size + 2))) == {"vertex": 1, "face": 2}
    with pytest.raises(InputError, match="truncated"):
        check_ply(FILE, ply(b"binary_little_endian", 1, 2, b"\0" * (size + 1)))
    wide = ply(b"binary_little_endian", 1, 2, b"\0" * (size + 2)).replace(b"list uchar", b"list int")
    with pytest.raises(InputError, match=f"at least {size + 2 * 4} bytes"):
        check_ply(FILE, wide)


def test_text_ply_lines_are_counted():
    assert check_ply(FILE, ply(b"ascii", 2, 1, b"1 2 3\n4 5 6\n3 0 1 0\n"))["face"] == 1
    with pytest.raises(InputError, match="at least 3 lines of data and 2 follow"):
        check_ply(FILE, ply(b"ascii", 2, 1, b"1 2 3\n4 5 6\n"))


def test_text_ply_lists_have_the_lengths_that_they_say():
    lists = FACES + b"property uchar red\nproperty list uchar float texture\n"
    good = ply(b"ascii", 1, None, b"1 2 3\n3 0 0 0 9 2 .5 .5\n0 9 0\n").replace(b"end_h", lists % 2 + b"end_h")
    assert check_ply(FILE, good) == {"vertex": 1, "face": 2}
    changes = [
        (0, b"\n3 0 0 0", b"\n2 0 0 0"),
        (0, b"9 2 .5", b"9 1 .5"),
        (1, b"0 9 0", b"0 9 0 1"),
        (1, b"0 9 0", b"0 9"),
    ]
    for face, right, wrong in changes:
        with pytest.raises(InputError, match=f"face {face} has . numbers, its own counts ask for"):
            check_ply(FILE, good.replace(right, wrong))


def test_ply_headers_must_list_vertices():
    with pytest.raises(InputError, match="no vertices"):
        check_ply(FILE, ply(b"ascii", 0, None, b""))
    with pytest.raises(InputError, match="malformed"):
        check_ply(FILE, b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n")


def stl(triangles):
    facet = b"facet normal 0 0 1\nouter loop\n" + b"vertex 0 0 0\n" * 3 + b"endloop\nendfacet\n"
    return b"solid a\n" + facet * triangles + b"endsolid a\n"


def test_text_stl_must_be_whole():
    check_stl(FILE, stl(2))
    with pytest.raises(InputError, match="6 vertices in 1 complete"):
        check_stl(FILE, stl(2).replace(b"endfacet", b"", 1))
    with pytest.raises(InputError, match="truncated STL text"):
        check_stl(FILE, stl(2).replace(b"endsolid", b""))
    with pytest.raises(InputError, match="5 vertices in 2"):
        check_stl(FILE, stl(2).replace(b"vertex 0 0 0\n", b"", 1))


def test_binary_stl_has_50_bytes_a_triangle():
    content = b"\0" * 80 + (3).to_bytes(4, "little") + b"\0" * 150
    check_stl(FILE, content)
    with pytest.raises(InputError, match="promises 3 triangles"):
        check_stl(FILE, content[:-1])


def part(transform, faces=((0, 1, 2),)):
    geometry = SimpleNamespace(vertices=np.eye(3), faces=np.array(faces))
    return _part(FILE, geometry, transform)


def test_parts_of_a_scene_are_moved_and_mirrored_ones_turned_round():
    move = np.eye(4)
    move[:3, :3] = [[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
    move[:3, 3] = [1.0, 2.0, 3.0]
    vertices, faces = part(move)
    np.testing.assert_allclose(vertices, np.eye(3) @ move[:3, :3].T + move[:3, 3])
    assert faces.tolist() == [[0, 1, 2]]
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    assert part(mirror)[1].tolist() == [[2, 1, 0]]


@pytest.mark.parametrize("wrong", [3, -1])
def test_faces_must_name_vertices(wrong):
    with pytest.raises(InputError, match=f"names vertex {wrong}, there are 3"):
        part(np.eye(4), [[0, 1, wrong]])


def test_faces_of_later_parts_are_counted_on():
    faces = np.array([[0, 1, 2]])
    vertices, joined = _concatenate([(np.eye(3), faces), (2.0 * np.eye(3), faces)])
    assert joined.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert len(vertices) == 6
