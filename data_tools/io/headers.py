"""Does a file hold what its header promises? Checked before any reader allocates memory or guesses."""

from __future__ import annotations

import re
from pathlib import Path

from data_tools.errors import InputError

_PLY_SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64", "int64", "uint64"), 8),
}

#: Of a PLY file: name, count, least size in bytes, and whether each property is a list.
_Element = tuple[str, int, int, tuple[bool, ...]]


def check_ply(path: Path, content: bytes) -> dict[str, int]:
    """Compare a PLY file's length with the counts of its header, and return them by element.

    Raises
    ------
    InputError
        If there is no PLY header, the body is too short for it, or a list in text has another length than its count.
    """
    end = re.search(rb"end_header[ \t]*\r?\n?", content[:100_000])
    if not content.startswith(b"ply") or end is None:
        raise InputError(f"{path}: not a PLY file, it has no header from 'ply' to 'end_header'")
    header = content[: end.start()].decode("ascii", errors="replace")
    is_text = re.search(r"^format\s+ascii", header, re.MULTILINE) is not None
    elements = _ply_elements(path, header)
    body = content[end.end() :]
    if is_text:
        lines = [line for line in body.splitlines() if line.strip()]
        found, unit, needed = len(lines), "lines", sum(count for _, count, _, _ in elements)
    else:
        found, unit = len(body), "bytes"
        needed = sum(count * size for _, count, size, _ in elements)
    if found < needed:
        raise InputError(
            f"{path}: truncated, its header promises at least {needed} {unit} of data and {found} follow"
        )
    if not any(name == "vertex" and count > 0 for name, count, _, _ in elements):
        raise InputError(f"{path}: its header lists no vertices")
    if is_text:
        _check_lists(path, lines, elements)
    return {name: count for name, count, _, _ in elements}


def check_stl(path: Path, content: bytes) -> None:
    """Check the length of a binary STL file, or that a text one is complete.

    Raises
    ------
    InputError
        If the file is truncated, or neither.
    """
    if len(content) >= 84 and len(content) == 84 + 50 * int.from_bytes(content[80:84], "little"):
        return
    if content.lstrip()[:5].lower() != b"solid":
        promised = int.from_bytes(content[80:84], "little") if len(content) >= 84 else 0
        raise InputError(
            f"{path}: not an STL file or truncated: no 'solid', and {len(content)} bytes where a binary header "
            f"promises {promised} triangles"
        )
    lower = content.lower()
    num_vertices, num_ends = len(re.findall(rb"\bvertex\b", lower)), len(re.findall(rb"\bendfacet\b", lower))
    if num_vertices != 3 * num_ends or b"endsolid" not in lower:
        raise InputError(f"{path}: truncated STL text, {num_vertices} vertices in {num_ends} complete triangles")


def _check_lists(path: Path, lines: list[bytes], elements: list[_Element]) -> None:
    """Refuse lines of text whose lists have other lengths than they say."""
    start = 0
    for name, count, _, lists in elements:
        for number, line in enumerate(lines[start : start + count] if any(lists) else ()):
            words, length = line.split(), 0
            for is_list in lists:
                told = words[length] if is_list and length < len(words) else b"0"
                length += 1 + (int(told) if told.isdigit() else 0)
            if length != len(words):
                kind = name if name in ("vertex", "face") else "element"
                raise InputError(f"{path}: {kind} {number} has {len(words)} numbers, its own counts ask for {length}")
        start += count


def _ply_elements(path: Path, header: str) -> list[_Element]:
    """Return the elements that the header lists."""
    elements: list[_Element] = []
    for number, line in enumerate(header.splitlines(), start=1):
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdecimal():
                raise InputError(f"{path}: line {number}: malformed PLY header, expected 'element NAME COUNT'")
            elements.append((words[1], int(words[2]), 0, ()))
        elif words[:1] == ["property"] and len(words) > 2 and elements:
            kind = words[2] if words[1] == "list" else words[1]
            name, count, total, lists = elements[-1]
            elements[-1] = (name, count, total + _PLY_SIZES.get(kind, 1), (*lists, words[1] == "list"))
    return elements
