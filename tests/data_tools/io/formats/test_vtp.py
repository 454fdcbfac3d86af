"""VTP in all the ways in which VTK writes its arrays, written here."""

import base64
import lzma
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.formats.vtp import read_vtp
from data_tools.io.source import Source

MESH = blob(np.random.default_rng(3), num_vertices=60)
POLYGONS = MESH.faces.tolist()
PACKERS = {"": None, "vtkZLibDataCompressor": zlib.compress, "vtkLZMADataCompressor": lzma.compress}
NAMES = {"<f8": "Float64", "<f4": "Float32", "<i8": "Int64", "<u4": "UInt32"}


class Writer:
    """Writes arrays in one way; blocks of 500 bytes where they are compressed."""

    def __init__(self, mode="ascii", compressor="", header="<u8", order="<"):
        self.mode, self.compressor, self.header, self.order = (
            mode,
            compressor,
            header.replace("<", order),
            order,
        )
        self.appended = b""

    def stream(self, data):
        """Return the parts of an array as bytes; base64 ends after each."""
        pack = PACKERS.get(self.compressor)
        if pack is None:
            return [np.array([len(data)]).astype(self.header).tobytes() + data]
        blocks = [data[at : at + 500] for at in range(0, len(data), 500)]
        packed = [pack(block) for block in blocks]
        rest = len(data) % 500
        sizes = np.array([len(blocks), 500, rest, *map(len, packed)]).astype(self.header)
        return [sizes.tobytes(), b"".join(packed)]

    def array(self, values, name="", code=None):
        values = np.asarray(values)
        code = code or ("<f8" if values.dtype.kind == "f" else "<i8")
        num = values.shape[1] if values.ndim > 1 else 1
        attributes = f'type="{NAMES[code]}" Name="{name}" NumberOfComponents="{num}"'
        if self.mode == "ascii":
            text = " ".join(map(str, values.ravel().tolist()))
            return f'<DataArray {attributes} format="ascii">\n{text}\n</DataArray>'
        parts = self.stream(values.astype(code.replace("<", self.order)).tobytes())
        content = b"".join(parts) if self.mode == "raw" else b"".join(map(base64.b64encode, parts))
        if self.mode == "binary":
            return f'<DataArray {attributes} format="binary">\n  {content.decode()}\n</DataArray>'
        start, self.appended = len(self.appended), self.appended + content
        return f'<DataArray {attributes} format="appended" offset="{start}"/>'

    def cells(self, tag, lists):
        corners = np.array([corner for one in lists for corner in one], dtype=int)
        ends = np.cumsum([len(one) for one in lists], dtype=int)
        return f"<{tag}>{self.array(corners, 'connectivity')}{self.array(ends, 'offsets')}</{tag}>"

    def piece(self, vertices=MESH.vertices, polygons=POLYGONS, strips=(), more="", code=None):
        points = f"<Points>{self.array(vertices, 'Points', code)}</Points>"
        inside = (
            points
            + self.cells("Polys", polygons)
            + (self.cells("Strips", strips) if strips else "")
            + more
        )
        return f'<Piece NumberOfPoints="{len(vertices)}" NumberOfPolys="{len(polygons)}">{inside}</Piece>'

    def file(self, *pieces, kind="PolyData"):
        header = "UInt64" if self.header[1:] == "u8" else "UInt32"
        head = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" header_type="{header}"'
        head += f' byte_order="{"BigEndian" if self.order == ">" else "LittleEndian"}"'
        head += f' compressor="{self.compressor}">' if self.compressor else ">"
        head += f"<{kind}>{''.join(pieces)}</{kind}>"
        if not self.appended:
            return (head + "</VTKFile>\n").encode()
        encoding = "raw" if self.mode == "raw" else "base64"
        body = f'<AppendedData encoding="{encoding}">\n_'.encode() + self.appended
        return head.encode() + body + b"\n</AppendedData>\n</VTKFile>\n"


def read(content):
    return read_vtp(Source(Path("a.vtp"), content))


@pytest.mark.parametrize("mode", ["ascii", "binary", "base64", "raw"])
@pytest.mark.parametrize("compressor", PACKERS)
@pytest.mark.parametrize(("header", "order"), [("<u8", "<"), ("<u4", "<"), ("<u4", ">")])
def test_arrays_are_read_in_every_encoding(mode, compressor, header, order):
    writer = Writer(mode, compressor, header, order)
    found = read(writer.file(writer.piece()))
    np.testing.assert_array_equal(found.vertices, MESH.vertices)
    np.testing.assert_array_equal(found.faces, MESH.faces)
    assert found.notes == ()


def test_arrays_that_fill_their_blocks_are_whole():
    writer = Writer("raw", "vtkZLibDataCompressor")
    points = np.random.default_rng(1).normal(size=(125, 3))  # 3000 bytes, six blocks
    np.testing.assert_array_equal(read(writer.file(writer.piece(points, []))).vertices, points)


def test_pieces_polygons_strips_and_values():
    writer = Writer()
    values = f"<PointData>{writer.array(np.arange(60.0), 'heat')}</PointData>"
    first = writer.piece(
        polygons=[[0, 1, 2], [3, 4, 5, 6]], strips=[[0, 1, 2, 3]], more=values, code="<f4"
    )
    found = read(writer.file(first, writer.piece(polygons=[[0, 1, 2]])))
    assert found.faces.tolist() == [
        [0, 1, 2],
        [3, 4, 5],
        [3, 5, 6],
        [0, 1, 2],
        [2, 1, 3],
        [60, 61, 62],
    ]
    assert len(found.vertices) == 120
    assert found.notes == not_kept(["values of points and cells"])


def changed(old, new, mode="ascii", compressor=""):
    writer = Writer(mode, compressor)
    content = writer.file(writer.piece())
    assert old in content
    return content.replace(old, new, 1)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"<xml/>", "no element VTKFile"),
        (changed(b"<VTKFile", b"<!DOCTYPE a [<!ENTITY b 'c'>]><VTKFile"), "DOCTYPE"),
        (changed(b"</Piece>", b""), "its XML cannot be read"),
        (Writer().file(kind="UnstructuredGrid"), "holds no PolyData"),
        (changed(b'NumberOfPoints="60"', b'NumberOfPoints="61"'), "other numbers of points"),
        (changed(b"Float64", b"String"), "of a type that is not read"),
        (changed(b'format="ascii"', b'format="binary"'), "truncated or damaged"),
        (
            changed(b"vtkZLib", b"vtkLZ4", "raw", "vtkZLibDataCompressor"),
            "with LZ4, .* save it with ZLib",
        ),
        (changed(b'offset="0"', b'offset="99999999"', "raw"), "truncated or damaged"),
        (
            changed(b"_" + struct.pack("<Q", 1440), b"_" + struct.pack("<Q", 2**60), "raw"),
            "truncated or damaged",
        ),
        (
            changed(
                b"_" + struct.pack("<Q", 3),
                b"_" + struct.pack("<Q", 2**60),
                "raw",
                "vtkZLibDataCompressor",
            ),
            "truncated",
        ),
        (
            changed(
                struct.pack("<QQ", 3, 500),
                struct.pack("<QQ", 3, 2**50),
                "raw",
                "vtkZLibDataCompressor",
            ),
            "promises more than a file of its size",
        ),
        (
            changed(
                struct.pack("<QQ", 3, 500),
                struct.pack("<QQ", 3, 501),
                "raw",
                "vtkZLibDataCompressor",
            ),
            "truncated or damaged",
        ),
        (
            changed(
                b"_" + struct.pack("<Q", 3),
                b"_" + struct.pack("<Q", 2),
                "raw",
                "vtkLZMADataCompressor",
            ),
            "damaged",
        ),
    ],
)
def test_damaged_files_are_refused(content, reason):
    with pytest.raises(InputError, match=reason):
        read(content)


def test_offsets_must_fit_the_corners():
    writer = Writer()
    good = writer.piece(polygons=[[0, 1, 2], [3, 4, 5]])
    for wrong in ("3 7", "6 3", "-3 6", "3 5"):
        with pytest.raises(InputError, match="other numbers of corners"):
            read(writer.file(good.replace("\n3 6\n", f"\n{wrong}\n")))
    with pytest.raises(InputError, match="names vertex 60"):
        read(writer.file(writer.piece(polygons=[[0, 1, 60]])))
