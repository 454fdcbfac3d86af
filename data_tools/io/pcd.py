"""The Point Cloud Library's PCD format: text and binary read here, compressed through Open3D."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError, UnavailableError
from data_tools.io.source import Source

_KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(source: Source) -> tuple[FloatArray, IntArray]:
    """Return the points of a PCD file (version .7); other fields are ignored, as are points without a return (NaN).

    Raises
    ------
    InputError
        If the header is malformed, data are missing, or the file is compressed and Open3D is not installed.
    """
    path, content = source.path, source.content
    header, body = _header(path, content)
    fields, counts = header["FIELDS"], [int(c) for c in header.get("COUNT", ["1"] * len(header["FIELDS"]))]
    num = int(header["POINTS"][0])
    if not {"x", "y", "z"} <= set(fields):
        raise InputError(f"{path}: its {len(fields)} fields do not hold x, y and z")
    kind = header["DATA"][0].lower()
    if kind == "ascii":
        points = _from_text(path, body, fields, counts, num)
    elif kind == "binary":
        points = _from_binary(path, body, header, counts, num)
    elif kind == "binary_compressed":
        points = _from_open3d(source)
    else:
        raise InputError(f"{path}: unknown DATA; known are ascii, binary, binary_compressed")
    return points[~np.isnan(points).all(axis=1)], np.empty((0, 3), dtype=np.int64)


def _header(path: Path, content: bytes) -> tuple[dict[str, list[str]], bytes]:
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = content.find(b"\n", start)
        if end < 0 or start > 10_000:
            raise InputError(f"{path}: not a PCD file, its header has no DATA line")
        words = content[start:end].decode("ascii", errors="replace").split("#", 1)[0].split()
        start = end + 1
        if words:
            header[words[0].upper()] = words[1:]
    for key in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA"):
        if not header.get(key):
            raise InputError(f"{path}: its PCD header has no {key}")
    num = len(header["FIELDS"])
    if any(len(header.get(key, header["FIELDS"])) != num for key in ("SIZE", "TYPE", "COUNT")):
        raise InputError(f"{path}: its PCD header has {num} fields, but not as many sizes, types and counts")
    numbers = header["POINTS"] + header["SIZE"] + header.get("COUNT", [])
    if not all(word.isdecimal() for word in numbers):
        raise InputError(f"{path}: its PCD header holds a count that is no number")
    return header, content[start:]


def _from_text(path: Path, body: bytes, fields: list[str], counts: list[int], num: int) -> FloatArray:
    lines = [line.split() for line in body.decode("ascii", errors="replace").splitlines() if line.strip()]
    width = sum(counts)
    if len(lines) < num or any(len(words) != width for words in lines[:num]):
        raise InputError(
            f"{path}: truncated, {num} points of {width} numbers were promised, {len(lines)} lines follow"
        )
    starts = np.cumsum([0, *counts])
    columns = [int(starts[fields.index(axis)]) for axis in "xyz"]
    return np.array([[float(words[c]) for c in columns] for words in lines[:num]]).reshape(-1, 3)


def _from_binary(path: Path, body: bytes, header: dict[str, list[str]], counts: list[int], num: int) -> FloatArray:
    formats = [_format(path, t, s) for t, s in zip(header["TYPE"], header["SIZE"], strict=True)]
    names = [f"{position}" for position in range(len(formats))]
    record = np.dtype([(n, f, (c,)) for n, f, c in zip(names, formats, counts, strict=True)])
    if len(body) < num * record.itemsize:
        raise InputError(f"{path}: truncated, {num} points need {num * record.itemsize} bytes, {len(body)} follow")
    table = np.frombuffer(body, dtype=record, count=num)
    columns = [table[names[header["FIELDS"].index(axis)]][:, 0] for axis in "xyz"]
    return np.column_stack(columns).astype(np.float64)


def _format(path: Path, kind: str, size: str) -> str:
    if kind.upper() not in _KINDS or size not in ("1", "2", "4", "8") or (kind.upper() == "F" and size in "12"):
        raise InputError(f"{path}: unknown PCD type or size; known are F, I and U of 1 to 8 bytes")
    return f"<{_KINDS[kind.upper()]}{size}"


def _from_open3d(source: Source) -> FloatArray:
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise UnavailableError(
            f"{source.path}: compressed PCD files are read by Open3D, which cannot be imported ({error}); "
            "install it with: pip install 'collalign[open3d]'"
        ) from error
    with tempfile.TemporaryDirectory() as folder:  # Windows opens no file twice
        copy = Path(folder, "copy.pcd")  # of what was read; the file may be another by now
        copy.write_bytes(source.content)
        cloud = open3d.io.read_point_cloud(copy, remove_nan_points=True)
    return np.asarray(cloud.points, dtype=np.float64).reshape(-1, 3)
