"""Files that were made to harm: they promise what they do not hold, unpack to any size, or lead readers astray.

Each case is a target and what makes its file; :mod:`tests.fuzz.confined` reads them. All are made here, and alike
each time.
"""

import io
import json
import lzma
import struct
import warnings
import zipfile
import zlib
from functools import cache

import numpy as np

from tests.fuzz import targets

MIB = 2**20


def cases():
    """Return all cases by name: (target, function that returns the name of a file and its content)."""
    found = {}
    for group, target in (
        (_npz, targets.read_shape_file),
        (_pcd, targets.read_shape_file),
        (_gltf, targets.read_shape_file),
        (_vtp, targets.read_shape_file),
        (_vtk, targets.read_shape_file),
        (_ply, targets.read_shape_file),
        (_text, targets.read_shape_file),
        (_landmarks, targets.read_landmark_file),
        (_stores, targets.read_store),
    ):
        for name, make in group().items():
            found[f"{group.__name__[1:]} {name}"] = (target, make)
    return found


def _file(name, content):
    """Return what makes a file of a content that is known, or made only now."""
    return lambda: (name, content() if callable(content) else content)


# --- NumPy


def npy(shape, data=b"", descr="'<f8'", length=None):
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = len(header) if length is None else length
    return b"\x93NUMPY\x02\x00" + length.to_bytes(4, "little") + header + data


def archive(*members, method=zipfile.ZIP_STORED, lie=None):
    """An archive of (name, content) members; ``lie`` is the size that its directory says they have."""
    stream = io.BytesIO()
    with (
        warnings.catch_warnings(),
        zipfile.ZipFile(stream, "w", method, compresslevel=1) as made,
    ):
        warnings.simplefilter("ignore")  # of one name twice
        for name, content in members:
            made.writestr(name, content)
    data = stream.getvalue()
    if lie is not None:
        for mark, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
            place = data.index(mark) + at
            data = data[:place] + struct.pack("<I", lie) + data[place + 4 :]
    return data


@cache
def bomb(method, lie=None):
    """An archive of 100 MiB that are all alike, or one that says it has fewer."""
    return archive(("points.npy", bytes(100 * MIB)), method=method, lie=lie)


def _overlapping():
    """Many members that share one compressed stream."""
    data = zlib.compress(npy("(3000000, 3)", bytes(72_000_000)), 9)[2:-4]
    local = struct.pack("<4sHHHHHIIIHH", b"PK\3\4", 20, 0, 8, 0, 0, 0, len(data), 72_000_092, 1, 0)
    entry = struct.pack("<4sHHHHHHIII", b"PK\1\2", 20, 20, 0, 8, 0, 0, 0, len(data), 72_000_092)
    names = [f"{at:04}.npy".encode() for at in range(2000)]
    directory = b"".join(
        entry + struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0) + name for name in names
    )
    start = len(local) + 1 + len(data)
    end = struct.pack(
        "<4sHHHHIIH", b"PK\5\6", 0, 0, len(names), len(names), len(directory), start, 0
    )
    return local + b"a" + data + directory + end


def _npz():
    points = np.arange(30.0).reshape(10, 3)
    triangle = npy("(1, 3)", np.array([[0, 1, 2]]).tobytes(), "'<i8'")
    vertices = ("points.npy", npy("(10, 3)", points.tobytes()))
    bodies = {
        "deflate that lies": lambda: bomb(zipfile.ZIP_DEFLATED, lie=200),
        "overlapping": _overlapping,
        "shape of integers without end": archive(("points.npy", npy(f"({10**4000}, 3)"))),
        "header of any length": archive(("points.npy", npy("(1, 3)", bytes(24), length=2**32 - 1))),
        "header of brackets": archive(("points.npy", npy("(" * 9000, bytes(24)))),
        "zeros of one byte": lambda: archive(
            ("points.npy", npy(f"({6 * MIB}, 3)", bytes(18 * MIB), "'|i1'")),
            method=zipfile.ZIP_DEFLATED,
        ),
        "one face a million times": lambda: archive(
            vertices,
            ("faces.npy", npy(f"({10**6}, 3)", triangle[-24:] * 10**6, "'<i8'")),
            method=zipfile.ZIP_DEFLATED,
        ),
        "many members": lambda: archive(*((f"{at}.npy", b"") for at in range(30_000))),
        "directory elsewhere": archive(vertices)[:-6] + struct.pack("<IH", 2**32 - 1, 0),
    }
    return {name: _file("a.npz", content) for name, content in bodies.items()}


# --- point clouds of PCL


def _pcd():
    def file(data, body, num, fields="x y z", counts="1 1 1"):
        columns = len(fields.split())
        head = f"FIELDS {fields}\nSIZE {'4 ' * columns}\nTYPE {'F ' * columns}\n"
        head += f"COUNT {counts}\nWIDTH {num}\nHEIGHT 1\nPOINTS {num}\nDATA {data}\n"
        return head.encode() + body

    def packed(num):
        runs = b"\0\0" + b"\xe0\xff\0" * (12 * num // 264 + 1)
        sizes = struct.pack("<II", len(runs), 12 * num)
        return file("binary_compressed", sizes + runs, num)

    bodies = {
        "packed that is bearable": lambda: packed(1_000_000),
        "fields of any count": file("binary", bytes(600), 50, "x y z w", f"1 1 1 {10**18}"),
    }
    return {name: _file("a.pcd", content) for name, content in bodies.items()}


# --- glTF


def _document(binary=bytes(48), **tables):
    """A scene of one mesh of four points; tables replace its own."""
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "accessors": [_accessor(4)],
        "bufferViews": [{"buffer": 0, "byteLength": len(binary)}],
        "buffers": [{"byteLength": len(binary)}],
    } | tables


def _accessor(count, **more):
    return {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"} | more


def glb(document, binary=bytes(48)):
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def _gltf():
    deep, chain = b"[" * 10**5, [{"children": [at + 1]} for at in range(20_000)]
    primitive = {"attributes": {"POSITION": 0}, "mode": 0}
    many = np.zeros((30_000, 3), dtype="<f4").tobytes()
    big = _document(many, accessors=[_accessor(30_000)])
    morphed = big | {
        "meshes": [{"primitives": [primitive | {"targets": [primitive["attributes"]] * 5000}]}],
        "nodes": [{"mesh": 0, "weights": [1] * 5000}],
    }
    stride = {"buffer": 0, "byteLength": 48, "byteStride": 2**60}
    bodies = {
        "morph targets": lambda: glb(morphed, many),
        "a chain of nodes": lambda: glb(_document(nodes=[*chain, {"mesh": 0}])),
        "a stride beyond the end": glb(_document(bufferViews=[stride])),
        "brackets": glb(deep),
        "a number without end": glb(b'{"asset": {"version": 2}, "scene": ' + b"9" * 10**5 + b"}"),
    }
    found = {name: _file("a.glb", content) for name, content in bodies.items()}
    for name, uri in (
        ("device", "%2Fdev%2Fzero"),
        ("itself", "a.gltf"),
        ("data", "data:;base64," + "A" * 10**7 + "!"),
        ("name", "a" * 10**6),
    ):
        document = _document(buffers=[{"byteLength": 48, "uri": uri}])
        found[f"data in: {name}"] = _file("a.gltf", json.dumps(document).encode())
    return found


# --- VTK


def vtp(arrays, appended=b"", *, compressor="", encoding="raw"):
    """A file of one piece, or of as many as its text has, with arrays in the order of ``Points`` and ``Polys``."""
    compressor = compressor and f' compressor="vtk{compressor}DataCompressor"'
    text = f'<?xml version="1.0"?><VTKFile type="PolyData" header_type="UInt64"{compressor}>'
    text += f"<PolyData>{arrays}</PolyData>"
    if appended:
        return text.encode() + (
            f'<AppendedData encoding="{encoding}">_'.encode()
            + appended
            + b"</AppendedData></VTKFile>"
        )
    return (text + "</VTKFile>").encode()


def _piece(num=4, offset=0, form="appended", body=""):
    return (
        f'<Piece NumberOfPoints="{num}"><Points><DataArray type="Float64" format="{form}" offset="{offset}">'
        f"{body}</DataArray></Points></Piece>"
    )


def _blocks(pack, num):
    packed = pack(bytes(MIB))
    sizes = np.array([num, MIB, 0, *[len(packed)] * num], dtype="<u8").tobytes()
    return sizes + packed * num


def _vtp():
    plain = struct.pack("<Q", 24 * 10_000) + bytes(24 * 10_000)
    bodies = {
        "zlib": lambda: vtp(
            _piece(400 * MIB // 24), _blocks(zlib.compress, 400), compressor="ZLib"
        ),
        "LZMA": lambda: vtp(
            _piece(400 * MIB // 24), _blocks(lzma.compress, 400), compressor="LZMA"
        ),
        "pieces of the same data": lambda: vtp(_piece(10_000) * 20_000, plain),
        "pieces of long base64": lambda: vtp(
            "".join(_piece(1, 4 * at) for at in range(20_000)), b"AAAA" * 10**6, encoding="base64"
        ),
        "tags without end": b"<VTKFile>" + b"<AppendedData encoding='raw' " * 100_000,
        "elements in elements": b"<VTKFile>" + b"<a>" * 300_000 + b"</a>" * 300_000,
        "many attributes": lambda: vtp(
            "<a " + " ".join(f"a{at}='1'" for at in range(10**5)) + "/>"
        ),
        "a number of points without end": vtp(_piece("9" * 5000, form="ascii", body="1 2 3")),
    }
    return {name: _file("a.vtp", content) for name, content in bodies.items()}


def _vtk():
    def file(body):
        return b"# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\n" + body

    bodies = {
        "blanks": file(b" " * 300_000 + b"a\ra"),
        "fields": lambda: file(b"FIELD a 200000\n" + b"b 1 1 int\n0\n" * 200_000),
        "metadata": lambda: file(b"METADATA\n" * 300_000),
        "one long line": file(b"POINTS" + b"a" * 10**6),
        "polygons of any size": file(
            b"POINTS 1 float\n0 0 0\nPOLYGONS 1 2\n2000000000 0\n",
        ),
        "one polygon of all": lambda: file(
            b"POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 1000001\n1000000" + b" 0 1" * 500_000
        ),
    }
    return {name: _file("a.vtk", content) for name, content in bodies.items()}


# --- PLY, and text


def _ply():
    def file(elements, body=b"", kind="binary_little_endian"):
        return f"ply\nformat {kind} 1.0\n{elements}end_header\n".encode() + body

    xyz = "".join(f"property double {axis}\n" for axis in "xyz")
    four = f"element vertex 4\n{xyz}"
    faces = "element face 1\nproperty list {} int vertex_indices\n"
    bodies = {
        "elements without properties": file(f"element nothing {10**18}\n{four}", bytes(96)),
        "lists of digits": file(four + faces.format("int"), b"0 0 0\n" * 4 + b"9" * 10**5, "ascii"),
        "many properties": lambda: file(
            f"element vertex 1\n{xyz}" + "".join(f"property char a{at}\n" for at in range(40_000)),
            bytes(50_000),
        ),
        "one list of all": lambda: file(
            four + faces.format("int"), bytes(96) + struct.pack("<i", 10**6) + bytes(4 * 10**6)
        ),
        "a header without end": b"ply\nformat ascii 1.0\n" + b"comment a\n" * 10**6,
    }
    return {name: _file("a.ply", content) for name, content in bodies.items()}


def _text():
    vertex = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    files = {
        "stl names": ("a.stl", b"solid " + b"facet normal " * 200_000),
        "stl blanks": ("a.stl", b"solid a facet" + b" " * 10**6 + b"normal" + b" " * 10**6),
        "obj polygon": ("a.obj", vertex + b"f" + b" 1 2 3" * 200_000 + b"\n"),
        "obj lines that go on": ("a.obj", b"v 0 0 0 \\\n" * 200_000),
        "off polygon": ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n1000000" + b" 0 1" * 500_000),
        "xyz one line": ("a.xyz", b"1 2 3 " * 300_000),
        "csv quotes": ("a.csv", b'x,y,z\n"' + b"1,2,3\n" * 100_000),
        "pts scans": ("a.pts", b"1\n1 2 3\n" * 20_000),
    }
    return {name: _file(*file) for name, file in files.items()}


# --- what stands beside shapes


def _landmarks():
    files = {
        "tps count": ("a.tps", b"LM3=999999999999\n1 2 3\n"),
        "nts counts": ("a.nts", b"1 999999999L 999999999 0 DIM=3\n1 2 3\n"),
    }
    return {name: _file(*file) for name, file in files.items()}


def _stores():
    head = b"SQLite format 3\0" + struct.pack(">H", 4096) + b"\1\1\0\x40\x20\x20"
    bodies = {
        "pages beyond the end": head + struct.pack(">II", 1, 2**32 - 1) + b"\xff" * 4000,
    }
    return {name: _file("a.store", content) for name, content in bodies.items()}
