"""PLY as other programs write it, on files made by hand."""

import struct
from pathlib import Path

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.formats.ply import read_ply
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.io.source import Source

XYZ = "property float x\nproperty float y\nproperty float z\n"
CORNERS = "property list uchar int vertex_indices\n"
ORDERS = {"<": "binary_little_endian", ">": "binary_big_endian"}


@pytest.fixture
def mesh():
    return blob(np.random.default_rng(3), num_vertices=60)


def ply(kind, elements, body, comment="made by hand", newline="\n"):
    """Return a PLY file; elements are names with their counts and properties."""
    head = f"ply\nformat {kind} 1.0\ncomment {comment}\n"
    head += (
        "".join(f"element {name} {count}\n{properties}" for name, count, properties in elements)
        + "end_header\n"
    )
    return head.replace("\n", newline).encode("latin-1") + body


def read(content):
    return read_ply(Source(Path("a.ply"), content))


def text_of(rows):
    return "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()


@pytest.mark.parametrize("order", ["<", ""])
@pytest.mark.parametrize(("kind", "again"), [("int", -1), ("uint", 2**32 - 1)])
def test_triangle_strips_are_surfaces(mesh, order, kind, again):
    strip = [corner for face in mesh.faces.tolist() for corner in (*face, again)]
    elements = [("vertex", 60, XYZ), ("tristrips", 1, f"property list int {kind} vertex_indices\n")]
    if order:
        body = mesh.vertices.astype("<f4").tobytes() + struct.pack("<i", len(strip))
        body += np.array(strip).astype("<u4").tobytes()
    else:
        body = text_of(mesh.vertices) + text_of([[len(strip), *strip]])
    np.testing.assert_array_equal(
        read(ply(ORDERS.get(order, "ascii"), elements, body)).faces, mesh.faces
    )


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_other_elements_and_properties_are_passed_over(mesh, order):
    vertex = (
        "property uchar red\nproperty list int short odd\n"
        + XYZ.replace("float", "double")
        + "property float nx\n"
    )
    elements = [
        ("camera", 1, "property float view\nproperty list uchar double k\n"),
        ("vertex", 60, vertex),
        ("edge", 1, "property int vertex1\nproperty int vertex2\n"),
        ("face", len(mesh.faces), "property uchar flags\n" + CORNERS + "property short quality\n"),
        ("nothing", 10**15, ""),
    ]
    odd = [[at] * (at % 3) for at in range(60)]
    if order:
        body = struct.pack(order + "fBdd", 1.0, 2, 3.0, 4.0)
        for point, values in zip(mesh.vertices, odd, strict=True):
            body += struct.pack(f"{order}Bi{len(values)}h3df", 9, len(values), *values, *point, 0.0)
        body += struct.pack(order + "ii", 0, 1)
        body += b"".join(struct.pack(order + "BB3ih", 1, 3, *face, 5) for face in mesh.faces)
        found = read(ply(ORDERS[order], elements, body))
    else:
        body = text_of([[1.0, 2, 3.0, 4.0]])
        body += text_of(
            [9, len(o), *o, *p.tolist(), 0.0] for p, o in zip(mesh.vertices, odd, strict=True)
        )
        body += text_of([[0, 1]]) + text_of([1, 3, *face, 5] for face in mesh.faces)
        found = read(ply("ascii", elements[:-1], body))
    np.testing.assert_array_equal(found.vertices, mesh.vertices)
    np.testing.assert_array_equal(found.faces, mesh.faces)
    assert {"colours", "its elements 'camera'", "its elements 'edge'"} <= {
        *found.notes[0].values["things"]
    }


def test_bodies_are_counted_to_the_byte_and_line():
    vertex = "property float x\nproperty double y\nproperty uchar z\n"
    size = 4 + 8 + 1
    assert len(read(ply(ORDERS["<"], [("vertex", 3, vertex)], b"\0" * 3 * size)).vertices) == 3
    with pytest.raises(
        InputError, match=f"at least {3 * size} bytes of data and {3 * size - 1} follow"
    ):
        read(ply(ORDERS["<"], [("vertex", 3, vertex)], b"\0" * (3 * size - 1)))
    elements = [("vertex", 1, vertex), ("face", 2, CORNERS)]
    assert (
        len(read(ply(ORDERS["<"], elements, b"\0" * (size + 2))).faces) == 0
    )  # of lists that are empty
    with pytest.raises(InputError, match="truncated"):
        read(ply(ORDERS["<"], elements, b"\0" * (size + 1)))
    with pytest.raises(InputError, match="face 1 of 2 goes beyond its end"):
        read(ply(ORDERS["<"], elements, b"\0" * size + struct.pack("<BiBi", 1, 0, 2, 0)))
    with pytest.raises(InputError, match="at least 3 lines of data and 2 follow"):
        read(ply("ascii", [("vertex", 3, XYZ)], b"1 2 3\n4 5 6\n"))


def test_list_lengths_that_the_file_cannot_hold_are_refused_at_once():
    elements = [("vertex", 1, XYZ), ("face", 1, "property list uint int vertex_indices\n")]
    with pytest.raises(InputError, match="goes beyond its end"):
        read(ply(ORDERS["<"], elements, b"\0" * 12 + struct.pack("<Ii", 2**32 - 1, 0)))
    signed = [elements[0], ("face", 1, "property list int int vertex_indices\n")]
    with pytest.raises(InputError, match="goes beyond its end"):
        read(ply(ORDERS["<"], signed, b"\0" * 12 + struct.pack("<ii", -5, 0)))


@pytest.mark.parametrize(
    ("head", "reason"),
    [
        ("element vertex 0\n" + XYZ, "no vertices"),
        ("element vertex many\n" + XYZ, "line 3: malformed"),
        ("element vertex 1\nproperty quad x\n", "line 4: malformed"),
        ("element vertex 1\nproperty list float int x\n", "line 4: malformed"),
        ("property float x\nelement vertex 1\n", "line 3: malformed"),
        ("element vertex 1\n" + XYZ + "element vertex 1\n" + XYZ, "lists an element twice"),
        (
            "element vertex 1\nproperty float x\nproperty float y\nproperty float w\n",
            "no properties x, y and z",
        ),
        (
            "element vertex 1\n" + XYZ + "element face 1\nproperty float a\nproperty float b\n",
            "face has no list vertex_indices",
        ),
        (
            "element vertex 1\n"
            + XYZ
            + "element face 1\nproperty list uchar float vertex_indices\n",
            "not whole",
        ),
    ],
)
def test_headers_that_say_no_mesh_are_refused(head, reason):
    with pytest.raises(InputError, match=reason):
        read(b"ply\nformat ascii 1.0\n" + head.encode() + b"end_header\n1 2 3\n1 0.5\n")


def test_the_format_must_be_known():
    with pytest.raises(InputError, match="its format is none of ascii"):
        read(b"ply\nformat zipped 1.0\nelement vertex 1\n" + XYZ.encode() + b"end_header\n1 2 3\n")


def test_words_that_are_no_numbers_are_refused():
    with pytest.raises(InputError, match="an element vertex has a word that is no number"):
        read(ply("ascii", [("vertex", 2, XYZ)], b"1 2 3\n4 five 6\n"))


@pytest.mark.parametrize("rows", ["3 0 1 2\n3 0 1\n", "3 0 1 2\n3 0 1 2 0\n", "3 0 1 2 0\n2 0\n"])
def test_lines_of_other_lengths_than_they_say_are_refused(rows):
    body = b"1 2 3\n4 5 6\n7 8 9\n" + rows.encode()
    with pytest.raises(InputError, match=r"face \d has \d numbers, its own counts ask for"):
        read(ply("ascii", [("vertex", 3, XYZ), ("face", 2, CORNERS)], body))


def test_the_case_of_a_whole_file(tmp_path, mesh):
    path = write_mesh(tmp_path / "a.ply", mesh).rename(tmp_path / "A.PLY")
    np.testing.assert_array_equal(read_shape(path).faces, mesh.faces)
