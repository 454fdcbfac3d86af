"""PLY, text and binary in both byte orders: any elements with any properties, lists of any lengths, strips."""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeAlias

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
from data_tools.io.text_tables import parse_table
from data_tools.notes import Note

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    "int64": "i8",
    "uint64": "u8",
}
_DOUBLE: np.dtype[np.generic] = np.dtype(np.float64)
#: More values than any list has.
_NO_LENGTH = 2**48
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index", "vertex_indexes")
_COLOURS = {"red", "diffuse_red", "r"}
_TEXTURES = {"texcoord", "texture_u", "s", "u", "texnumber"}

#: The values of one property: an array with a number of each row, or of a list, all values and the length of each.
_Column: TypeAlias = NDArray[np.generic] | tuple[NDArray[np.generic], IntArray]


@dataclass(frozen=True)
class _Property:
    name: str
    kind: np.dtype[np.generic]
    #: Of a list, the type of its length.
    length: np.dtype[np.generic] | None = None

    @property
    def nothing(self) -> _Column:
        """The column of an element without rows."""
        none = np.empty(0)
        return none if self.length is None else (none, none.astype(np.int64))


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def num_bytes(self) -> int:
        """The least that one row takes in a binary file."""
        return sum((one.length or one.kind).itemsize for one in self.properties)

    @property
    def in_doubles(self) -> _Element:
        """The same with every number, and every length of a list, in double precision."""
        properties = [
            _Property(one.name, _DOUBLE, None if one.length is None else _DOUBLE)
            for one in self.properties
        ]
        return _Element(self.name, self.count, properties)


class _Found(NamedTuple):
    """The columns of an element by name, and where each of its rows ends, in bytes."""

    columns: dict[str, _Column]
    ends: IntArray


def read_ply(source: Source) -> RawShape:
    """Return the vertices and triangles of a PLY file; polygons and strips are split into triangles.

    Raises
    ------
    InputError
        If it is no PLY file, ends early, a list in text has another length than it says, or a face names a vertex
        that does not exist.
    """
    path, content = source.path, source.content
    order, elements, header, start = _header(path, content)
    by_name = {element.name: element for element in elements}
    if "vertex" not in by_name or not by_name["vertex"].count:
        raise InputError(f"{path}: its header lists no vertices")
    tables = (_text_tables if not order else _binary_tables)(path, content[start:], elements)
    vertices = _vertices(path, tables["vertex"])
    num, faces = len(vertices), [no_faces()]
    if "face" in tables:
        corners, sizes = _index_lists(path, by_name["face"], tables["face"])
        faces.append(fan_triangles(checked_indices(path, corners, num), sizes))
    if "tristrips" in tables:
        corners, sizes = _restarted(*_index_lists(path, by_name["tristrips"], tables["tristrips"]))
        faces.append(strip_triangles(checked_indices(path, corners, num), sizes))
    return RawShape(vertices, np.concatenate(faces), _notes(elements, header))


def _header(path: Path, content: bytes) -> tuple[str, list[_Element], str, int]:
    """Return the byte order (none for text), the elements, the header's text and where the data begins."""
    begin = re.match(rb"(?:\xef\xbb\xbf)?\s*ply[ \t]*[\r\n]", content[:1000], re.IGNORECASE)
    end = begin and re.compile(rb"(\r\n|\n|\r)end_header[ \t]*(?:\1|$)").search(content, 0, 2**20)
    if begin is None or end is None:
        raise InputError(f"{path}: not a PLY file, it has no header from 'ply' to 'end_header'")
    header = re.sub(r"\r\n?", "\n", content[: end.start()].decode("latin-1"))
    found = re.search(r"^\s*format\s+(\w+)", header, re.MULTILINE)
    if found is None or found[1] not in _BYTE_ORDERS:
        raise InputError(
            f"{path}: malformed PLY header, its format is none of {', '.join(_BYTE_ORDERS)}"
        )
    order = _BYTE_ORDERS[found[1]]
    elements: list[_Element] = []
    for number, line in enumerate(header.splitlines(), start=1):
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdecimal():
                raise InputError(
                    f"{path}: line {number}: malformed PLY header, expected 'element NAME COUNT'"
                )
            elements.append(_Element(words[1], int(words[2])))
        elif words[:1] == ["property"]:
            is_list = words[1:2] == ["list"]
            kinds = [_TYPES.get(word, "") for word in words[1 + is_list : -1]]
            if (
                len(kinds) != 1 + is_list
                or not all(kinds)
                or (is_list and kinds[0][0] == "f")
                or not elements
            ):
                raise InputError(
                    f"{path}: line {number}: malformed PLY header, expected 'property TYPE NAME'"
                )
            *length, kind = (np.dtype(order + code) for code in kinds)
            elements[-1].properties.append(_Property(words[-1], kind, *length))
    if len({element.name for element in elements}) < len(elements):
        raise InputError(f"{path}: malformed PLY header, it lists an element twice")
    return order, elements, header, end.end()


def _text_tables(
    path: Path, body: bytes, elements: list[_Element]
) -> dict[str, dict[str, _Column]]:
    lines = [line for line in body.decode("latin-1").splitlines() if line.strip()]
    needed = sum(element.count for element in elements)
    if len(lines) < needed:
        raise _truncated(path, needed, "lines", len(lines))
    tables, start = {}, 0
    for element in elements:
        tables[element.name] = _text_rows(path, lines[start : start + element.count], element)
        start += element.count
    return tables


def _text_rows(path: Path, lines: list[str], element: _Element) -> dict[str, _Column]:
    """Return the columns of one element in text: its numbers are read like a binary body of doubles."""
    table = parse_table("\n".join(lines), num_rows=len(lines))
    numbers = parse_table(" ".join(lines), num_rows=1) if table is None else table
    if numbers is None and lines:
        raise InputError(f"{path}: an element {element.name} has a word that is no number")
    body = b"" if numbers is None else numbers.tobytes()
    found = _columns(body, 0, element.in_doubles)
    widths = np.array([len(line.split()) for line in lines] if table is None else [table.shape[1]])
    asked = np.zeros(len(lines), dtype=np.int64)
    asked[: len(found.ends)] = np.diff(found.ends, prepend=0) // _DOUBLE.itemsize
    wrong = np.flatnonzero(asked != widths)
    if len(wrong):
        kind, at = element.name if element.name in ("vertex", "face") else "element", wrong[0]
        raise InputError(
            f"{path}: {kind} {at} has {widths[at % len(widths)]} numbers, its own counts ask for {asked[at]}"
        )
    return found.columns


def _binary_tables(
    path: Path, body: bytes, elements: list[_Element]
) -> dict[str, dict[str, _Column]]:
    needed = sum(element.count * element.num_bytes for element in elements)
    if len(body) < needed:
        raise _truncated(path, needed, "bytes", len(body))
    tables, start = {}, 0
    for element in elements:
        found = _columns(body, start, element)
        tables[element.name] = found.columns
        start = int(found.ends[-1]) if len(found.ends) else start
        if start > len(body):
            raise InputError(
                f"{path}: truncated or damaged, {element.name} {len(found.ends) - 1} of {element.count} goes beyond "
                "its end"
            )
    return tables


def _columns(body: bytes, start: int, element: _Element) -> _Found:
    """Return the columns of an element that begins there, and where its rows end."""
    if not element.count or not element.properties:
        columns = {one.name: one.nothing for one in element.properties}
        return _Found(columns, np.empty(0, dtype=np.int64))
    return _equal_records(body, start, element) or _records(body, start, element)


def _equal_records(body: bytes, start: int, element: _Element) -> _Found | None:
    """Return the columns of records that are equally long, None where they are not."""
    fields: list[tuple[str, np.dtype[np.generic], tuple[int, ...]]] = []
    at = start
    for number, one in enumerate(element.properties):
        shape: tuple[int, ...] = ()
        if one.length is not None:
            shape = (_length(_anywhere(body, one.length), at),)
            fields.append((f"length{number}", one.length, ()))
            at += one.length.itemsize
        at += one.kind.itemsize * sum(shape, start=not shape)
        if at > len(body):
            return None
        fields.append((f"value{number}", one.kind, shape))
    kind = np.dtype(fields)
    if start + element.count * kind.itemsize > len(body):
        return None
    records = np.frombuffer(body, dtype=kind, count=element.count, offset=start)
    columns: dict[str, _Column] = {}
    for number, one in enumerate(element.properties):
        values = records[f"value{number}"]
        if one.length is None:
            columns[one.name] = values
            continue
        lengths = records[f"length{number}"]
        if (lengths != lengths[0]).any():
            return None
        columns[one.name] = values.ravel(), lengths.astype(np.int64)
    return _Found(columns, start + kind.itemsize * np.arange(1, element.count + 1))


def _records(body: bytes, at: int, element: _Element) -> _Found:
    """Return the columns of records whose lists are of different lengths; of none if one goes beyond the end."""
    starts = [array("q") for _ in element.properties]
    lengths = [array("q") for _ in element.properties]
    ends = array("q")
    rows = [
        (
            own_starts,
            own_lengths,
            one.kind.itemsize,
            None if one.length is None else _anywhere(body, one.length),
        )
        for own_starts, own_lengths, one in zip(starts, lengths, element.properties, strict=True)
    ]
    for _ in range(element.count):
        for own_starts, own_lengths, num_bytes, counts in rows:
            size = 1
            if counts is not None:
                size = _length(counts, at)
                at += counts.itemsize
            own_starts.append(at)
            own_lengths.append(size)
            at += size * num_bytes
        ends.append(at)
        if at > len(body):
            return _Found({}, np.array(ends, dtype=np.int64))
    columns: dict[str, _Column] = {}
    for number, one in enumerate(element.properties):
        sizes = np.array(lengths[number], dtype=np.int64)
        first = np.repeat(np.array(starts[number], dtype=np.int64), sizes)
        within = np.arange(len(first)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        values = _anywhere(body, one.kind)[first + within * one.kind.itemsize]
        columns[one.name] = values if one.length is None else (values, sizes)
    return _Found(columns, np.array(ends, dtype=np.int64))


def _anywhere(body: bytes, kind: np.dtype[np.generic]) -> NDArray[np.generic]:
    """Return the number of a kind that begins at each byte of a body."""
    num = max(len(body) - kind.itemsize + 1, 0)
    return np.ndarray((num,), dtype=kind, buffer=body, strides=(1,))


def _length(counts: NDArray[np.generic], at: int) -> int:
    """Return how many values a list has that begins there; more than there can be where that is no such number."""
    size = counts.item(at) if at < len(counts) else -1
    return int(size) if 0 <= size < _NO_LENGTH and size == int(size) else _NO_LENGTH


def _vertices(path: Path, table: dict[str, _Column]) -> FloatArray:
    named = {name.lower(): column for name, column in table.items()}
    columns = [named.get(axis) for axis in "xyz"]
    if any(column is None or isinstance(column, tuple) for column in columns):
        raise InputError(f"{path}: its vertices have no properties x, y and z")
    return np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])


def _index_lists(
    path: Path, element: _Element, table: dict[str, _Column]
) -> tuple[NDArray[np.generic], IntArray]:
    """Return the vertex numbers of faces or strips, one after the other, and how many each has."""
    lists = [one.name for one in element.properties if one.length is not None]
    named = [name for name in lists if name in _INDICES] or lists[: len(lists) == 1]
    found = table[named[0]] if named else None
    if not isinstance(found, tuple):
        if element.count:
            raise InputError(f"{path}: an element {element.name} has no list vertex_indices")
        return np.empty(0), np.empty(0, dtype=np.int64)
    return found


def _restarted(
    corners: NDArray[np.generic], sizes: IntArray
) -> tuple[NDArray[np.generic], IntArray]:
    """Return strips that begin anew where the number of a vertex is -1, as strips of their own."""
    values = corners.astype(np.float64)
    is_break = (values == -1) | (values == 2**32 - 1)
    strip = np.repeat(np.arange(len(sizes)), sizes)
    piece = np.cumsum(is_break) + strip
    return corners[~is_break], np.unique(piece[~is_break], return_counts=True)[1]


def _notes(elements: list[_Element], header: str) -> tuple[Note, ...]:
    names = {one.name.lower() for element in elements for one in element.properties}
    things = ["colours"] * bool(names & _COLOURS) + ["texture coordinates"] * bool(
        names & _TEXTURES
    )
    if "texturefile" in header.lower():
        things.append("textures")
    others = [e.name for e in elements if e.count and e.name not in ("vertex", "face", "tristrips")]
    return not_kept(things + [f"its elements {name!r}" for name in others])


def _truncated(path: Path, needed: int, unit: str, found: int) -> InputError:
    return InputError(
        f"{path}: truncated, its header promises at least {needed} {unit} of data and {found} follow"
    )
