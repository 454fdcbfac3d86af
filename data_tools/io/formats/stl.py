"""STL, binary and text, as many programs write it: with bytes behind it, without a count or without an end."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.io.formats.obj_off import vertices_of_lines
from data_tools.io.formats.raw_shape import RawShape, not_kept
from data_tools.io.source import Source
from data_tools.notes import Note

#: A triangle of the binary format.
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: The name of a solid may hold any word; on one line with the first triangle it ends there.
_NAME = re.compile(
    rb"^[ \t]*solid\b.*?(?=\bfacet\s+normal\s+[-+.\dni]|$)|(?:^[ \t]*|(?<=endfacet)[ \t]+)endsolid\b.*$",
    re.IGNORECASE | re.MULTILINE,
)
_VERTEX = re.compile(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", re.IGNORECASE)


def read_stl(source: Source) -> RawShape:
    """Return the triangles of an STL file, each with vertices of its own.

    Raises
    ------
    InputError
        If the file is truncated, or no STL.
    """
    path, content = source.path, source.content
    text = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    is_text = text[:5].lower() == b"solid" and b"\0" not in text[:1000]
    vertices, notes = _read_text(path, text) if is_text else _read_binary(path, content)
    return RawShape(vertices, np.arange(len(vertices)).reshape(-1, 3), notes)


def _read_binary(path: Path, content: bytes) -> tuple[FloatArray, tuple[Note, ...]]:
    promised = int.from_bytes(content[80:84], "little")
    room, rest = divmod(max(len(content) - 84, 0), STL_TRIANGLE.itemsize)
    is_unknown = promised in (
        0,
        2**32 - 1,
    )  # of programs that write the header first and never come back to it
    num = room if is_unknown and rest == 0 else promised
    if not 0 < num <= room:
        raise InputError(
            f"{path}: not an STL file, or truncated. It does not begin with 'solid', and its {len(content)} bytes "
            f"do not fit the {promised} triangles that a binary header promises"
        )
    triangles = np.frombuffer(content, dtype=STL_TRIANGLE, count=num, offset=84)
    ignored = len(content) - 84 - num * STL_TRIANGLE.itemsize
    notes = (Note("bytes-ignored", values={"num": ignored}),) if ignored else ()
    colours = not_kept(["colours"] if b"COLOR=" in content[:80] else [])
    return triangles["corners"].reshape(-1, 3).astype(np.float64), notes + colours


def _read_text(path: Path, text: bytes) -> tuple[FloatArray, tuple[Note, ...]]:
    body = _NAME.sub(b"", text.replace(b"\r", b"\n")).rstrip(b"\0 \t\n\x1a")
    rows = [row.decode("ascii", "replace") for row in _VERTEX.findall(body)]
    num_ends = len(re.findall(rb"\bendfacet\b", body, re.IGNORECASE))
    if not rows or len(rows) != 3 * num_ends or not body.lower().endswith(b"endfacet"):
        raise InputError(
            f"{path}: truncated STL text, {len(rows)} vertices in {num_ends} complete triangles"
        )
    notes = (
        () if re.search(rb"\bendsolid\b", text[-1000:], re.IGNORECASE) else (Note("no-endsolid"),)
    )
    return vertices_of_lines(path, rows), notes
