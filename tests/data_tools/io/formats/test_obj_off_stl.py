"""OBJ and STL as other programs write them, on files made by hand."""

import struct
from pathlib import Path

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.formats.obj_off_stl import read_obj, read_stl
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.source import Source

TRIANGLES = blob(np.random.default_rng(3), num_vertices=60)
CORNERS = TRIANGLES.vertices[TRIANGLES.faces].astype(np.float32)
NUM = len(CORNERS)
RECORDS = b"".join(b"\0" * 12 + corners.tobytes() + b"\0\0" for corners in CORNERS)
FACETS = "".join(
    "facet normal 0 0 0\n  outer loop\n"
    + "".join(f"    vertex {x:.9e} {y:.9e} {z:.9e}\n" for x, y, z in corners.tolist())
    + "  endloop\nendfacet\n"
    for corners in CORNERS
)


def binary(*, head=b"by hand", count=NUM, records=RECORDS, tail=b""):
    return (
        head.ljust(80, b" " if head.startswith(b"solid") else b"\0")
        + struct.pack("<I", count)
        + records
        + tail
    )


def text(name="a", body=FACETS, end="endsolid a\n"):
    return f"solid {name}\n{body}{end}".encode("latin-1")


def read(content):
    return read_stl(Source(Path("a.stl"), content))


ALIKE = {
    "binary": binary(),
    "binary that begins with solid": binary(head=b"solid part"),
    "bytes behind it": binary(tail=b"\0" * 7),
    "bytes behind it, begins with solid": binary(
        head=b"solid facet normal vertex", tail=b"trailing"
    ),
    "count of zero": binary(count=0),
    "count of a stream": binary(count=2**32 - 1),
    "text": text(),
    "vertex in the name": text("vertex-painted scan", end="endsolid vertex-painted scan\n"),
    "facet in the name": text(
        "a facet normal of endfacet, endloop", end="endsolid a facet normal of endfacet\n"
    ),
    "no name": text("", end="endsolid"),
    "no end": text(end=""),
    "byte order mark": b"\xef\xbb\xbf" + text(),
    "upper case": text().upper(),
    "Windows": text().replace(b"\n", b"\r\n"),
    "old Macintosh": text().replace(b"\n", b"\r"),
    "tabs and blanks": text().replace(b"\n", b" \t\n").replace(b"  ", b"\t"),
    "blanks before": b"\n \n" + text(),
    "Latin-1": text("Größe µm"),
    "two solids": text() + b"solid b\nendsolid b\n",
    "one line": text().replace(b"\n", b" "),
    "end of file of DOS": text() + b"\x1a\0\0",
}


@pytest.mark.parametrize("content", ALIKE.values(), ids=ALIKE)
def test_variants_are_the_same_surface(content):
    found = read(content)
    np.testing.assert_allclose(found.vertices.reshape(-1, 3, 3), CORNERS, rtol=1e-6)
    np.testing.assert_array_equal(found.faces, np.arange(3 * NUM).reshape(-1, 3))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (binary()[:-1], f"the {NUM} triangles that"),
        (binary(head=b"solid part")[:-51], f"the {NUM} triangles that"),
        (binary(count=10**9), "the 1000000000 triangles that"),
        (binary(count=0, tail=b"\0"), "the 0 triangles that"),
        (binary(count=0, records=b""), "the 0 triangles that"),
        (b"solid", "truncated STL text, 0 vertices"),
        (
            text(body=FACETS[: FACETS.rindex("endfacet")], end=""),
            f"{3 * NUM} vertices in {NUM - 1} complete",
        ),
        (text(body=FACETS[: FACETS.rindex("vertex")], end=""), "complete triangles"),
        (text(body=FACETS + "facet normal 0 0 1\nouter loop\n", end=""), "truncated STL text"),
        (text().replace(b"vertex", b"vertex one", 1), "vertex 1 is not three numbers"),
    ],
)
def test_what_is_cut_off_is_refused(content, reason):
    with pytest.raises(InputError, match=reason):
        read(content)


#: Two triangles, as OBJ.
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n"


def test_a_last_face_that_breaks_off_is_refused():
    with pytest.raises(InputError, match=r"face 3 has 2 corners \(truncated\?\)"):
        read_obj(Source(Path("a.obj"), (SQUARE + "f 1 3").encode()))


@pytest.mark.parametrize(
    ("more", "things"),
    [
        ("l 1 2 3\n", ["lines"]),
        ("usemtl wood\nvt 0 0\n", ["materials", "texture coordinates"]),
        ("# l 1 2\ng lid\n", []),
    ],
)
def test_what_an_obj_file_loses_is_named(more, things):
    assert read_obj(Source(Path("a.obj"), (SQUARE + more).encode())).notes == not_kept(things)
