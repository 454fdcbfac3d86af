"""PCD, the format of the Point Cloud Library: text, binary, and binary compressed with LZF."""

from __future__ import annotations

import re
from itertools import accumulate

import numpy as np

from data_tools.arrays import BoolArray, FloatArray
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import RawShape, no_faces, not_kept
from data_tools.io.source import Room, Source
from data_tools.io.text_tables import parse_table
from data_tools.notes import Note

_KINDS = {"F": {4: "<f4", 8: "<f8"}, "I": {1: "i1", 2: "<i2", 4: "<i4", 8: "<i8"}}
_KINDS["U"] = {size: code.replace("i", "u") for size, code in _KINDS["I"].items()}


def read_pcd(source: Source) -> RawShape:
    """Return the points of a PCD file; those without coordinates, where a depth camera saw nothing, are left out.

    Raises
    ------
    InputError
        If it is no PCD file, ends early, or has no fields x, y and z.
    """
    path, content = source.path, source.content
    found = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE).search(content, 0, 2**16)
    if found is None:
        raise InputError(f"{path}: not a PCD file, it has no header that ends in a line 'DATA'")
    header = _Header(source, content[: found.start()].decode("latin-1"))
    points = header.points(found[1].decode().lower(), content[found.end() :])
    is_seen: BoolArray = np.asarray(np.isfinite(points).all(axis=1))
    notes = not_kept(["colours"] if {"rgb", "rgba"} & {*header.names} else [])
    if is_seen.all():
        return RawShape(points, no_faces(), notes)
    lost = Note(
        "points-without-coordinates", values={"num": int((~is_seen).sum()), "total": len(points)}
    )
    return RawShape(
        points[is_seen], no_faces(), (lost, *notes), np.flatnonzero(is_seen), len(points)
    )


class _Header:
    """What the header says of the fields of each point."""

    def __init__(self, source: Source, text: str) -> None:
        self.path = path = source.path
        self._room = Room.of(source)
        lines = {words[0]: words[1:] for words in map(str.split, text.splitlines()) if words}
        self.names = lines.get("FIELDS", lines.get("COLUMNS", []))
        num = len(self.names)
        try:
            sizes = [int(word) for word in lines["SIZE"]]
            self.kinds = [
                np.dtype(_KINDS[kind][size])
                for kind, size in zip(lines["TYPE"], sizes, strict=True)
            ]
            self.counts = [int(word) for word in lines.get("COUNT", ["1"] * num)]
            width, height = int(lines["WIDTH"][0]), int(lines.get("HEIGHT", ["1"])[0])
            self.num_points = int(lines["POINTS"][0]) if "POINTS" in lines else width * height
        except (KeyError, ValueError, IndexError):
            raise InputError(
                f"{path}: malformed PCD header: it needs FIELDS, SIZE, TYPE and WIDTH"
            ) from None
        if (
            not num == len(self.kinds) == len(self.counts)
            or min([self.num_points, *self.counts]) < 0
        ):
            raise InputError(
                f"{path}: malformed PCD header: FIELDS, SIZE, TYPE and COUNT do not fit each other"
            )
        if any(
            self.names.count(axis) != 1 or self.counts[self.names.index(axis)] != 1
            for axis in "xyz"
        ):
            raise InputError(f"{path}: its points have no fields x, y and z")
        self._axes = [self.names.index(axis) for axis in "xyz"]
        sizes = [kind.itemsize * count for kind, count in zip(self.kinds, self.counts, strict=True)]
        self._starts = [0, *accumulate(sizes)]  # of the fields of a point, and its end

    def points(self, encoding: str, body: bytes) -> FloatArray:
        """Return x, y and z of each point, shape (n, 3)."""
        num, starts, axes = self.num_points, self._starts, self._axes
        if encoding == "ascii":
            return self._of_text(body)
        needed = num * starts[-1]
        if encoding == "binary":
            self._refuse_short(needed, len(body))
            places = [(starts[at], starts[-1]) for at in axes]
        elif encoding == "binary_compressed":
            stored, unpacked = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
            self._refuse_short(stored + 8, len(body))
            if unpacked < needed:
                raise InputError(
                    f"{self.path}: truncated, {num} points need {needed} bytes, not {unpacked}"
                )
            self._room.take(max(needed, 24 * num), "save it as binary")
            body = self._unpacked(body[8 : 8 + stored], needed)
            places = [(starts[at] * num, self.kinds[at].itemsize) for at in axes]
        else:
            raise InputError(
                f"{self.path}: its data is neither ascii, binary nor binary_compressed"
            )
        columns = [
            np.ndarray((num,), self.kinds[at], body, start if num else 0, (step,))
            for at, (start, step) in zip(axes, places, strict=True)
        ]
        return np.column_stack(columns).astype(np.float64)

    def _of_text(self, body: bytes) -> FloatArray:
        lines = [line for line in body.decode("latin-1").splitlines() if line.strip()]
        if len(lines) < self.num_points:
            raise InputError(
                f"{self.path}: truncated, its header promises {self.num_points} points, {len(lines)} lines follow"
            )
        lines = lines[: self.num_points]
        table = parse_table("\n".join(lines), num_rows=len(lines))
        if table is None or table.shape[1] != sum(self.counts):
            raise InputError(
                f"{self.path}: a point is not the {sum(self.counts)} numbers that its header names"
            )
        return np.ascontiguousarray(table[:, np.cumsum([0, *self.counts])[self._axes]])

    def _refuse_short(self, needed: int, found: int) -> None:
        if found < needed:
            raise InputError(
                f"{self.path}: truncated, its header promises {needed} bytes of data and {found} follow"
            )

    def _unpacked(self, data: bytes, needed: int) -> bytes:
        """Undo LZF: runs of bytes as they are, and repetitions of what is there already."""
        out = bytearray()
        at = 0
        while at < len(data) and len(out) < needed:
            control = data[at]
            at += 1
            if control < 32:
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = (control >> 5) + 2
            if length == 9:
                length += data[at] if at < len(data) else 0
                at += 1
            back = ((control & 31) << 8) + (data[at] if at < len(data) else 0) + 1
            at += 1
            if back > len(out):
                break
            piece = out[len(out) - back : len(out) - back + length]
            out += (piece * (length // len(piece) + 1))[:length]
        if len(out) < needed:
            raise InputError(f"{self.path}: damaged, its compressed data ends early")
        return bytes(out)
