"""PCD in its three encodings; Open3D reads and writes them as well."""

import struct
from pathlib import Path

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.formats.pcd import read_pcd
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.shapes import read_shape
from data_tools.io.source import Source
from data_tools.notes import Note
from tests.memory import most_memory

POINTS = np.random.default_rng(4).normal(size=(50, 3))


def header(
    num=50,
    data="ascii",
    fields="x y z",
    sizes="4 4 4",
    types="F F F",
    counts="1 1 1",
    comment="made by hand",
):
    lines = [
        f"# .PCD v0.7 - {comment}",
        "VERSION 0.7",
        f"FIELDS {fields}",
        f"SIZE {sizes}",
        f"TYPE {types}",
    ]
    lines += [
        f"COUNT {counts}",
        f"WIDTH {num}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {num}",
        f"DATA {data}",
    ]
    return "".join(line + "\n" for line in lines).encode("latin-1")


def text(points=POINTS):
    return "".join(" ".join(map(str, row)) + "\n" for row in points.tolist()).encode()


def read(content):
    return read_pcd(Source(Path("a.pcd"), content))


def literal_lzf(data):
    """Return data as LZF that repeats nothing."""
    return b"".join(
        bytes([len(p) - 1]) + p for p in (data[at : at + 32] for at in range(0, len(data), 32))
    )


def test_text_and_binary_hold_the_same_points():
    single = POINTS.astype("<f4")
    for content in (
        header() + text(single),
        (header() + text(single)).replace(b"\n", b"\r\n"),
        header(data="binary") + single.tobytes(),
        header(data="binary_compressed")
        + struct.pack("<II", len(literal_lzf(single.T.tobytes())), single.nbytes)
        + literal_lzf(single.T.tobytes()),
        header(comment="Größe") + text(single) + b"\n\n",
    ):
        found = read(content)
        np.testing.assert_allclose(found.vertices, single, rtol=1e-6)
        assert (found.faces.shape, found.notes, found.places) == ((0, 3), (), None)


def test_fields_are_of_any_type_count_and_order():
    fields = {
        "fields": "z _ rgb y x normal",
        "sizes": "8 1 4 8 8 4",
        "types": "F U F F F F",
        "counts": "1 3 1 1 1 3",
    }
    kind = np.dtype(
        [("z", "<f8"), ("_", "u1", 3), ("rgb", "<f4"), ("y", "<f8"), ("x", "<f8"), ("n", "<f4", 3)]
    )
    rows = np.zeros(50, dtype=kind)
    rows["x"], rows["y"], rows["z"] = POINTS.T
    found = read(header(data="binary", **fields) + rows.tobytes())
    np.testing.assert_array_equal(found.vertices, POINTS)
    assert found.notes == not_kept(["colours"])
    x, y, z = POINTS[:, :1], POINTS[:, 1:2], POINTS[:, 2:]
    wide = np.hstack([z, np.zeros((50, 4)), y, x, np.ones((50, 3))])
    np.testing.assert_array_equal(read(header(**fields) + text(wide)).vertices, POINTS)


def test_repetitions_of_lzf_are_undone():
    plain = b"abcabcabcabcabcabcX" + b"\0" * 300
    packed = bytes([2]) + b"abc" + bytes([7 << 5, 15 - 9, 2]) + bytes([0]) + b"X" + bytes([0, 0])
    packed += bytes([7 << 5, 255, 0]) + bytes([3 << 5, 0]) * 7 + bytes([1, 0, 0]) * 5
    content = header(num=len(plain) // 12, data="binary_compressed")
    num = len(plain) // 12 * 12
    found = read(content + struct.pack("<II", len(packed), num) + packed)
    expected = np.frombuffer(plain[:num], dtype="<f4").reshape(3, -1).T
    np.testing.assert_array_equal(found.vertices, expected)


def test_points_that_a_camera_did_not_see_are_left_out_and_numbers_stay_those_of_the_file(tmp_path):
    gaps = POINTS.astype("<f4")
    gaps[[0, 7, 30]] = np.nan
    (tmp_path / "a.pcd").write_bytes(header(data="binary") + gaps.tobytes())
    shape = read_shape(tmp_path / "a.pcd")
    assert shape.notes == (Note("points-without-coordinates", values={"num": 3, "total": 50}),)
    kept = np.setdiff1d(np.arange(50), [0, 7, 30])
    np.testing.assert_array_equal(shape.source_indices, kept)
    np.testing.assert_array_equal(shape.vertices, gaps[kept])
    assert len(shape.file_vertices) == 50


def test_packed_points_cannot_ask_for_any_memory(monkeypatch):
    monkeypatch.setattr("data_tools.io.source._FREE_BYTES", 0)
    num = 10**6
    packed = b"\x00\x00" + b"\xe0\xff\x00" * (12 * num // 264 + 1)  # 264 bytes as the one before
    content = header(num=num, data="binary_compressed") + struct.pack("<II", len(packed), 12 * num)
    with most_memory(10**6), pytest.raises(InputError, match="save it as binary"):
        read(content + packed)
    monkeypatch.undo()
    assert not read(content + packed).vertices.any()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"x y z\n1 2 3\n", "not a PCD file"),
        (header(num=10**12) + text(), "promises 1000000000000 points, 50 lines"),
        (header(num=10**12, data="binary") + b"\0" * 99, "promises 12000000000000 bytes"),
        (header(data="binary") + b"\0" * 599, "promises 600 bytes of data and 599 follow"),
        (
            header(data="binary_compressed") + struct.pack("<II", 10**9, 600) + b"\0" * 20,
            "and 28 follow",
        ),
        (
            header(data="binary_compressed") + struct.pack("<II", 20, 599) + b"\0" * 20,
            "need 600 bytes, not 599",
        ),
        (header(data="binary_compressed") + struct.pack("<II", 20, 600) + b"\0" * 20, "ends early"),
        (
            header(data="binary_compressed") + struct.pack("<II", 3, 600) + b"\xff\xff\xff",
            "ends early",
        ),
        (header(data="zipped") + text(), "neither ascii, binary nor"),
        (header() + text(POINTS[:, :2]), "is not the 3 numbers"),
        (header() + text().replace(b"\n", b" one\n", 1), "is not the 3 numbers"),
        (header(fields="x y w") + text(), "no fields x, y and z"),
        (header(fields="x y z z") + text(), "do not fit each other"),
        (header(sizes="4 4 3") + text(), "malformed PCD header"),
        (header(num=-5) + text(), "do not fit each other"),
        (header().replace(b"TYPE", b"KIND") + text(), "malformed PCD header"),
    ],
)
def test_damaged_files_are_refused(content, reason):
    with pytest.raises(InputError, match=reason):
        read(content)
