"""VTP, VTK's XML format of PolyData: text, base64 and raw data, plain or compressed."""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import RawShape, joined
from data_tools.io.formats.vtk_legacy import text_numbers, vtk_surface
from data_tools.io.source import Room, Source
from data_tools.io.xml_trees import parse_xml

_DECOMPRESSORS: dict[str, Callable[[bytes | memoryview, int], bytes]] = {
    "vtkZLibDataCompressor": lambda data, size: zlib.decompressobj().decompress(data, size),
    "vtkLZMADataCompressor": lambda data, size: lzma.LZMADecompressor(memlimit=2**28).decompress(
        data, size
    ),
}
_ENCODING = re.compile(rb"\bencoding\s*=\s*[\"'](raw|base64)[\"']")
_NO_COPIES = "save it with each array once"
#: Longest tag of the appended data, and most blanks before its mark.
_MAX_TAG_BYTES = 1000
#: Returns the first bytes of an array's data, fewer where there are not so many.
_Start: TypeAlias = Callable[[int], bytes | memoryview]


def read_vtp(source: Source) -> RawShape:
    """Return the points and triangles of all pieces of a VTP file; polygons and strips are split into triangles.

    Raises
    ------
    InputError
        If it is no VTP file, ends early, or is compressed in a way that is not read.
    """
    path = source.path
    text, appended = _split(source.content)
    root = parse_xml(path, text.strip())
    if root.tag != "VTKFile":
        raise InputError(f"{path}: not a VTP file, it has no element VTKFile")
    surface = root.find("PolyData")
    if surface is None:
        raise InputError(
            f"{path}: holds no PolyData; save its surface as PolyData first (ParaView: Extract Surface)"
        )
    arrays = _Arrays(source, root, appended)
    pieces = [_piece(path, piece, arrays) for piece in surface.iter("Piece")]
    notes = tuple(dict.fromkeys(note for piece in pieces for note in piece.notes))
    return RawShape(*joined([piece[:2] for piece in pieces]), notes)


def _split(content: bytes) -> tuple[bytes, tuple[bool, memoryview] | None]:
    """Return the XML without its appended data, and those data, if there are any, with whether they are raw."""
    start = content.find(b"<AppendedData")
    stop = content.find(b">", start, start + _MAX_TAG_BYTES) + 1 if start >= 0 else 0
    encoding = _ENCODING.search(content, start, stop) if stop else None
    mark = re.compile(rb"\s*_").match(content, stop, stop + _MAX_TAG_BYTES)
    if encoding is None or mark is None:
        return content, None
    is_raw, data = encoding[1] == b"raw", memoryview(content)[mark.end() :]
    if not is_raw:
        data = memoryview(b"".join(bytes(data).split(b"<", 1)[0].split()))
    return content[:start] + b"</VTKFile>", (is_raw, data)


def _piece(path: Path, piece: ElementTree.Element, arrays: _Arrays) -> RawShape:
    place = piece.find("Points/DataArray")
    points = np.empty(0) if place is None else arrays.values(place).astype(np.float64)
    if len(points) % 3 or len(points) != 3 * int(piece.get("NumberOfPoints", "0")):
        raise InputError(f"{path}: damaged, it has other numbers of points than it says")
    cells = {}
    for name in ("Polys", "Strips"):
        found = {one.get("Name", ""): one for one in piece.findall(f"{name}/DataArray")}
        corners, ends = (
            arrays.values(found[part]) if part in found else np.empty(0)
            for part in ("connectivity", "offsets")
        )
        starts = np.concatenate([np.zeros(1, dtype=np.int64), ends.astype(np.int64)])
        cells[name] = corners.astype(np.int64), np.diff(starts)
    has_values = any(
        piece.find(f"{name}/DataArray") is not None for name in ("PointData", "CellData")
    )
    lost = {"values of points and cells"} if has_values else set[str]()
    if piece.get("NumberOfLines", "0").strip() not in ("", "0"):
        lost.add("lines")
    return vtk_surface(path, points.reshape(-1, 3), cells["Polys"], cells["Strips"], lost)


class _Arrays:
    """Reads the arrays of one file, wherever they are and however they are encoded."""

    def __init__(
        self,
        source: Source,
        root: ElementTree.Element,
        appended: tuple[bool, memoryview] | None,
    ) -> None:
        self._path = source.path
        self._order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self._header = np.dtype(
            self._order + ("u8" if root.get("header_type") == "UInt64" else "u4")
        )
        self._compressor = root.get("compressor", "")
        self._appended = appended
        self._room = Room.of(source)  # many arrays may name the same data
        if self._compressor and self._compressor not in _DECOMPRESSORS:
            method = "LZ4" if "LZ4" in self._compressor else "an unknown method"
            raise InputError(
                f"{self._path}: is compressed with {method}, which is not read; save it with ZLib or without "
                "compression"
            )

    def values(self, array: ElementTree.Element) -> NDArray[np.generic]:
        """Return the numbers of one array."""
        kind = re.fullmatch(r"(Int|UInt|Float)(8|16|32|64)", array.get("type", ""))
        if kind is None:
            raise InputError(f"{self._path}: holds numbers of a type that is not read")
        dtype = np.dtype(f"{self._order}{kind[1][0].lower()}{int(kind[2]) // 8}")
        encoding, text = array.get("format", "ascii"), (array.text or "").encode("ascii", "replace")
        if encoding == "ascii":
            return text_numbers(self._path, text, 0, len(text.split()))[0].astype(dtype)
        if encoding == "binary":
            is_raw, at, data = False, 0, memoryview(b"".join(text.split()))
        else:
            at = int(array.get("offset", "0"))
            if self._appended is None or not 0 <= at <= len(self._appended[1]):
                raise self._truncated()
            is_raw, data = self._appended

        def start(num: int) -> bytes | memoryview:
            return data[at : at + num] if is_raw else self._base64(data[at:], num)

        content = self._unpacked(start) if self._compressor else self._plain(start)
        if len(content) % dtype.itemsize:
            raise self._truncated()
        return np.frombuffer(content, dtype=dtype)

    def _base64(self, text: memoryview, num: int) -> bytes:
        """Decode so many bytes of pieces of base64 that stand one after the other, each with an end of its own."""
        taken = text[: 4 * (num // 3 + 3)]  # a header and its data
        try:
            return b"".join(base64.b64decode(piece) for piece in re.findall(rb"[^=]+=*", taken))
        except binascii.Error:
            raise self._truncated() from None

    def _plain(self, start: _Start) -> bytes | memoryview:
        size, at = int(self._headers(start, 1)[0]), self._header.itemsize
        content = start(at + size)[at : at + size]
        if len(content) < size:
            raise self._truncated()
        self._room.take(size, _NO_COPIES)
        return content

    def _unpacked(self, start: _Start) -> bytes:
        num = int(self._headers(start, 1)[0])
        if not num:
            return b""
        _, size, last, *stored = self._headers(start, 3 + num).tolist()
        at, found = (3 + num) * self._header.itemsize, list[bytes]()
        end = at + sum(stored)
        self._room.take((num - (last > 0)) * size + last + end)
        stream = start(end)
        for number, length in enumerate(stored):
            expected = last if last and number == num - 1 else size
            try:
                block = (
                    _DECOMPRESSORS[self._compressor](stream[at : at + length], expected)
                    if expected
                    else b""
                )
            except (zlib.error, lzma.LZMAError):
                block = b""
            if len(block) != expected:
                raise self._truncated()
            found.append(block)
            at += length
        return b"".join(found)

    def _headers(self, start: _Start, num: int) -> NDArray[np.generic]:
        stream = start(num * self._header.itemsize)
        if num * self._header.itemsize > len(stream):
            raise self._truncated()
        return np.frombuffer(stream, dtype=self._header, count=num)

    def _truncated(self) -> InputError:
        return InputError(
            f"{self._path}: truncated or damaged, an array has less data than it says"
        )
