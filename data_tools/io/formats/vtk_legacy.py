"""VTK's legacy format, text and binary: PolyData, and unstructured grids that are surfaces."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import (
    RawShape,
    checked_indices,
    fan_triangles,
    no_faces,
    not_kept,
    strip_triangles,
)
from data_tools.io.source import Source

_TYPES = {
    **dict.fromkeys(("char", "signed_char", "vtktypeint8"), ">i1"),
    **dict.fromkeys(("unsigned_char", "vtktypeuint8"), ">u1"),
    **dict.fromkeys(("short", "vtktypeint16"), ">i2"),
    **dict.fromkeys(("unsigned_short", "vtktypeuint16"), ">u2"),
    **dict.fromkeys(("int", "vtkidtype", "vtktypeint32"), ">i4"),
    **dict.fromkeys(("unsigned_int", "vtktypeuint32"), ">u4"),
    **dict.fromkeys(("long", "vtktypeint64"), ">i8"),
    **dict.fromkeys(("unsigned_long", "vtktypeuint64"), ">u8"),
    "float": ">f4",
    "double": ">f8",
}
_CELLS = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS", "CELLS")
#: Kinds of cells of an unstructured grid that lie on a surface, and those that are points or lines.
_POLYGONS, _STRIPS, _NO_SURFACE = (
    {5: "triangle", 7: "polygon", 9: "quad"},
    {6: "strip"},
    {1, 2, 3, 4},
)
#: Polygons or strips: all corners, and how many each has.
_Cells = tuple[IntArray, IntArray]


def read_vtk(source: Source) -> RawShape:
    """Return the points and triangles of a legacy VTK file; polygons and strips are split into triangles.

    Raises
    ------
    InputError
        If it is no such file, ends early, or holds a grid instead of a surface.
    """
    path, content = source.path, source.content
    head = re.match(
        rb"\s*#\s*vtk\s+DataFile\s+Version\s+(\d+)[^\r\n]*\r?\n[^\n]*\n\s*(ASCII|BINARY)\s",
        content,
        re.I,
    )
    if head is None:
        raise InputError(
            f"{path}: not a VTK file: its first lines do not say 'vtk DataFile' and ASCII or BINARY"
        )
    reader = _Reader(path, content, head.end(), is_binary=head[2].upper() == b"BINARY")
    points, cells, kinds = reader.dataset(offsets=int(head[1]) >= 5)
    if kinds is not None:
        cells = _surface_cells(path, cells.get("CELLS", _no_cells()), kinds)
    return vtk_surface(
        path,
        points,
        cells.get("POLYGONS", _no_cells()),
        cells.get("TRIANGLE_STRIPS", _no_cells()),
        reader.lost,
    )


def vtk_surface(
    path: Path, points: FloatArray, polygons: _Cells, strips: _Cells, lost: set[str]
) -> RawShape:
    """Return the surface, or the cloud, of points (v, 3) with polygons and strips."""
    faces = [no_faces()]
    for (corners, sizes), split in ((polygons, fan_triangles), (strips, strip_triangles)):
        if (sizes < 0).any() or sizes.sum() != len(corners):
            raise InputError(
                f"{path}: damaged, its polygons have other numbers of corners than it says"
            )
        faces.append(split(checked_indices(path, corners, len(points)), sizes))
    return RawShape(points, np.concatenate(faces), not_kept(lost))


def _no_cells() -> _Cells:
    return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)


class _Reader:
    """Goes through the blocks of a file, each announced by a line."""

    def __init__(self, path: Path, content: bytes, at: int, *, is_binary: bool) -> None:
        self.path = path
        self.lost: set[str] = set()
        self._content, self._at, self._is_binary = content, at, is_binary

    def dataset(self, *, offsets: bool) -> tuple[FloatArray, dict[str, _Cells], IntArray | None]:
        """Return the points, the cells by their keyword, and the kinds of the cells of an unstructured grid."""
        points, cells, kinds = np.empty((0, 3)), dict[str, _Cells](), None
        while words := self._line():
            keyword = words[0].upper()
            if keyword == "DATASET":
                if words[1:2] not in (["POLYDATA"], ["UNSTRUCTURED_GRID"]):
                    raise InputError(
                        f"{self.path}: holds a grid or image, no surface; save its surface as PolyData first "
                        "(ParaView: Extract Surface)"
                    )
            elif keyword == "POINTS":
                points = (
                    self._numbers(self._count(words, 1) * 3, words[2])
                    .astype(np.float64)
                    .reshape(-1, 3)
                )
            elif keyword in _CELLS:
                cells[keyword] = self._cells(words, offsets=offsets)
                self.lost |= {"lines"} if keyword == "LINES" and len(cells[keyword][1]) else set()
            elif keyword == "CELL_TYPES":
                kinds = self._numbers(self._count(words, 1), "int").astype(np.int64)
            elif keyword == "FIELD":
                for _ in range(self._count(words, 2)):
                    array = self._line()
                    self._numbers(self._count(array, 1) * self._count(array, 2), array[3])
            elif keyword == "METADATA":
                self._skip_metadata()
            elif keyword in ("POINT_DATA", "CELL_DATA"):
                self.lost.add("values of points and cells")
                break
            else:
                raise InputError(
                    f"{self.path}: damaged, where a block should begin is none that is known"
                )
        return points, cells, kinds

    def _cells(self, words: list[str], *, offsets: bool) -> _Cells:
        """Return the corners of all cells and how many each has."""
        first, second = self._count(words, 1), self._count(words, 2)
        if not offsets:
            return _counted(self.path, self._numbers(second, "int").astype(np.int64), first)
        ends, corners = np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int64)
        for num, name in ((first, "OFFSETS"), (second, "CONNECTIVITY")):
            array = self._line()
            if array[:1] != [name]:
                raise InputError(f"{self.path}: damaged, {name} of its cells are missing")
            values = self._numbers(num, array[1]).astype(np.int64)
            ends, corners = (values, corners) if name == "OFFSETS" else (ends, values)
        return corners, np.diff(ends)

    def _count(self, words: list[str], at: int) -> int:
        if len(words) <= at or not words[at].isdecimal():
            raise InputError(f"{self.path}: damaged, a block does not say how much it holds")
        return int(words[at])

    def _line(self) -> list[str]:
        """Return the words of the next line that is not empty; none at the end."""
        found = re.compile(rb"\s*+([^\r\n]*+)(?:\r?\n|$)").match(self._content, self._at)
        if found is None or len(found[1]) > 1000:
            raise InputError(
                f"{self.path}: damaged, where a block should begin is none that is known"
            )
        self._at = found.end()
        return found[1].decode("latin-1").split()

    def _skip_metadata(self) -> None:
        found = re.compile(rb"\r?\n[ \t]*\r?\n").search(self._content, max(self._at - 2, 0))
        self._at = len(self._content) if found is None else found.end()

    def _numbers(self, num: int, kind: str) -> NDArray[np.generic]:
        """Return the numbers that follow, which the file must hold."""
        code = _TYPES.get(kind.lower())
        if code is None:
            raise InputError(f"{self.path}: holds numbers of a type that is not read")
        left = len(self._content) - self._at
        size = np.dtype(code).itemsize if self._is_binary else 1
        if num * size > left:
            raise InputError(
                f"{self.path}: truncated, a block promises {num} numbers and {left} bytes follow"
            )
        if self._is_binary:
            values = np.frombuffer(self._content, dtype=code, count=num, offset=self._at)
            self._at += num * size
            return values
        values, self._at = text_numbers(self.path, self._content, self._at, num)
        return values


def text_numbers(path: Path, content: bytes, at: int, num: int) -> tuple[FloatArray, int]:
    """Return so many numbers (num,) of the text of a VTK file from a place on, and where they end.

    Raises
    ------
    InputError
        If there are fewer, or a word is no number.
    """
    width = 32 * num + 1000  # a file of many blocks is not copied for each
    words = content[at : at + width].split(None, num)
    while len(words) <= num and at + width < len(content):
        width *= 2
        words = content[at : at + width].split(None, num)
    rest = len(words[num]) if len(words) > num else 0
    if len(words) < num:
        raise InputError(
            f"{path}: truncated, a block promises {num} numbers and {len(words)} follow"
        )
    try:
        return np.array([float(word) for word in words[:num]]), min(at + width, len(content)) - rest
    except ValueError:
        raise InputError(f"{path}: damaged, where numbers should be is a word") from None


def _counted(path: Path, values: IntArray, num: int) -> _Cells:
    """Take lists apart, each of which begins with its length."""
    width = int(values[0]) + 1 if len(values) else 1
    if width > 0 and num * width == len(values) and (values[::width] == width - 1).all():
        return values.reshape(num, width)[:, 1:].ravel(), np.full(num, width - 1)
    starts, at = [], 0
    for _ in range(num):
        if at >= len(values) or values[at] < 0:
            break
        starts.append(at)
        at += int(values[at]) + 1
    if len(starts) < num or at != len(values):
        raise InputError(
            f"{path}: damaged, its polygons have other numbers of corners than it says"
        )
    return np.delete(values, starts), values[starts]


def _surface_cells(path: Path, cells: _Cells, kinds: IntArray) -> dict[str, _Cells]:
    """Return the polygons and strips of an unstructured grid that has no other cells."""
    corners, sizes = cells
    odd = set(np.unique(kinds).tolist()) - {*_POLYGONS, *_STRIPS, *_NO_SURFACE}
    if odd or len(kinds) != len(sizes):
        what = f"its cells are of kind {min(odd)}" if odd else "not every cell has a kind"
        raise InputError(
            f"{path}: {what}, no surface of triangles and polygons; save its surface as PolyData first "
            "(ParaView: Extract Surface)"
        )
    of_corner = np.repeat(kinds, sizes)
    chosen = {"POLYGONS": list(_POLYGONS), "TRIANGLE_STRIPS": list(_STRIPS)}
    return {
        name: (corners[np.isin(of_corner, one)], sizes[np.isin(kinds, one)])
        for name, one in chosen.items()
    }
