"""Legacy VTK files of both versions and encodings, written here as VTK writes them."""

from pathlib import Path

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.formats.vtk_legacy import read_vtk
from data_tools.io.source import Source

MESH = blob(np.random.default_rng(3), num_vertices=60)
LISTS = [face.tolist() for face in MESH.faces]


def numbers(values, code, binary):
    return (
        np.asarray(values).astype(code).tobytes()
        if binary
        else " ".join(map(str, np.ravel(values).tolist())).encode()
    )


def cells(keyword, lists, binary, version):
    """Return a block of cells, which version 5 keeps as offsets and connectivity."""
    flat = [corner for one in lists for corner in one]
    if version < 5:
        values = [word for one in lists for word in (len(one), *one)]
        return (
            f"{keyword} {len(lists)} {len(values)}\n".encode()
            + numbers(values, ">i4", binary)
            + b"\n"
        )
    ends = np.cumsum([0, *map(len, lists)])
    return (
        f"{keyword} {len(ends)} {len(flat)}\nOFFSETS vtktypeint64\n".encode()
        + numbers(ends, ">i8", binary)
        + b"\nCONNECTIVITY vtktypeint64\n"
        + numbers(flat, ">i8", binary)
        + b"\n"
    )


def vtk(
    blocks,
    *,
    binary,
    version,
    kind="POLYDATA",
    points=MESH.vertices,
    word="double",
    title="Größe µm",
):
    head = f"# vtk DataFile Version {version}.0\n{title}\n{'BINARY' if binary else 'ASCII'}\nDATASET {kind}\n"
    code = {"double": ">f8", "float": ">f4", "int": ">i4"}[word]
    body = f"POINTS {len(points)} {word}\n".encode() + numbers(points, code, binary) + b"\n"
    return head.encode("latin-1") + body + b"".join(blocks)


def read(content):
    return read_vtk(Source(Path("a.vtk"), content))


each = pytest.mark.parametrize(
    ("binary", "version"), [(b, v) for b in (False, True) for v in (3, 5)]
)


@each
@pytest.mark.parametrize("word", ["double", "float"])
def test_polygons_are_read(binary, version, word):
    found = read(
        vtk([cells("POLYGONS", LISTS, binary, version)], binary=binary, version=version, word=word)
    )
    np.testing.assert_allclose(found.vertices, MESH.vertices, atol=1e-6 * (word == "float"))
    np.testing.assert_array_equal(found.faces, MESH.faces)
    assert found.notes == ()


@each
def test_mixed_polygons_strips_lines_and_other_blocks(binary, version):
    metadata = b"METADATA\nINFORMATION 1\nNAME POLYGONS LOCATION vtkDataArray\nDATA 2 POINTS 3\n\n"
    field = b"FIELD FieldData 1\nTime 1 2 double\n" + numbers([1.5, 2.5], ">f8", binary) + b"\n"
    blocks = [
        metadata,
        field,
        cells("VERTICES", [[0], [1, 2]], binary, version),
        cells("LINES", [[0, 1, 2]], binary, version),
        cells("POLYGONS", [[0, 1, 2], [3, 4, 5, 6], [7, 8, 9, 10, 11]], binary, version),
        cells("TRIANGLE_STRIPS", [[0, 1, 2, 3], [7, 8, 9]], binary, version),
        b"\nPOINT_DATA 60\nSCALARS POINTS float 1\nLOOKUP_TABLE default\n\xff\xfe",
    ]
    found = read(vtk(blocks, binary=binary, version=version))
    expected = [
        [0, 1, 2],
        [3, 4, 5],
        [3, 5, 6],
        [7, 8, 9],
        [7, 9, 10],
        [7, 10, 11],
        [0, 1, 2],
        [2, 1, 3],
        [7, 8, 9],
    ]
    assert found.faces.tolist() == expected
    assert found.notes == not_kept(["lines", "values of points and cells"])


@each
def test_unstructured_grids_are_read_where_they_are_surfaces(binary, version):
    def grid(kinds):
        types = b"CELL_TYPES 4\n" + numbers(kinds, ">i4", binary) + b"\n"
        lists = [[0, 1, 2], [3, 4, 5, 6], [0, 1], [7, 8, 9, 10]]
        blocks = [cells("CELLS", lists, binary, version), types]
        return vtk(blocks, binary=binary, version=version, kind="UNSTRUCTURED_GRID")

    assert read(grid([5, 9, 3, 6])).faces.tolist() == [
        [0, 1, 2],
        [3, 4, 5],
        [3, 5, 6],
        [7, 8, 9],
        [9, 8, 10],
    ]
    with pytest.raises(InputError, match=r"of kind 10, .* save its surface as PolyData"):
        read(grid([5, 9, 3, 10]))


def changed(old, new, *, binary=False, version=3):
    content = vtk([cells("POLYGONS", LISTS, binary, version)], binary=binary, version=version)
    assert old in content
    return content.replace(old, new)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"# vtk\n", "not a VTK file"),
        (changed(b"POLYDATA", b"STRUCTURED_POINTS"), "a grid or image, no surface"),
        (
            changed(b"POINTS 60", b"POINTS 1000000000000000"),
            "truncated, a block promises 3000000000000000 numbers",
        ),
        (
            changed(b"POINTS 60", b"POINTS 1000000000000000", binary=True),
            "truncated, a block promises 3000000000000000",
        ),
        (changed(b"POINTS 60", b"POINTS many"), "does not say how much it holds"),
        (changed(b"POINTS 60", b"POINTS 61"), "where numbers should be is a word"),
        (changed(b"POINTS 60 double", b"POINTS 60 quad"), "of a type that is not read"),
        (changed(b"POLYGONS 116", b"POLYGONS 117"), "other numbers of corners"),
        (changed(b"POLYGONS 116 464", b"POLYGONS 116 465"), "promises 465 numbers and 464 follow"),
        (changed(b"POLYGONS", b"PYRAMIDS"), "none that is known"),
        (
            changed(b"\nCONNECTIVITY", b"\nSOMETHING", version=5),
            "CONNECTIVITY of its cells are missing",
        ),
        (changed(b"POLYGONS 117", b"POLYGONS 116", binary=True, version=5), "damaged"),
        (
            vtk([cells("POLYGONS", [[0, 1, 60]], False, 3)], binary=False, version=3),
            "names vertex 60, there are 60",
        ),
        (vtk([b"POLYGONS 1 4\n3 0 1 -1\n"], binary=False, version=3), "names vertex -1"),
        (vtk([b"POLYGONS 2 4\n-3 0 1 1\n"], binary=False, version=3), "other numbers of corners"),
    ],
)
def test_damaged_files_are_refused(content, reason):
    with pytest.raises(InputError, match=reason):
        read(content)
