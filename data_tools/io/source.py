"""A shape file in memory, read once: the reader and the key of its result see the same bytes.

A GLTF file keeps its numbers in other files of its folder, and these count as its content.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

from data_tools.errors import InputError
from data_tools.io.files import existing_file, open_regular

#: Larger files are refused before anything of them is read, in bytes.
MAX_FILE_BYTES = 4 * 2**30
#: The same for the text of a GLTF file, which is parsed as a whole.
MAX_GLTF_BYTES = 256 * 2**20
#: Hexadecimal digits of a digest: 160 bits of SHA-256.
DIGEST_LENGTH = 40


class Source:
    """One file and those that it names; get it with :func:`read_source`.

    Attributes
    ----------
    path : Path
        What messages call it.
    content : bytes
    suffix : str
        Of the format, in lower case: the path's own, unless another one is given.
    is_file : bool
        Whether it came from the disk; otherwise the path is only the name of a shape that the caller holds.
    """

    def __init__(self, path: Path, content: bytes, *, suffix: str | None = None) -> None:
        self.path = path
        self.content = content
        self.suffix = (path.suffix if suffix is None else suffix).lower()
        self.is_file = suffix is None
        self._siblings: dict[str, bytes] = {}

    def absolute(self) -> Source:
        """Return the source itself: it is in memory, wherever it came from."""
        return self

    @property
    def name(self) -> str:
        """The file's name, or the shape's."""
        return self.path.name if self.is_file else str(self.path)

    def __getitem__(self, name: str) -> bytes:
        """Return the content of a buffer that this file names, from its folder only (trimesh calls it a resolver).

        Raises
        ------
        InputError
            If the name leads elsewhere, or the buffer cannot be read.
        KeyError
            If the file names no such buffer.
        """
        if name not in self.buffers:
            raise KeyError(name)
        if name not in self._siblings:
            self._siblings[name] = _read(sibling_path(self.path, name))
        return self._siblings[name]

    @cached_property
    def buffers(self) -> tuple[str, ...]:
        """The files of its folder that this one names."""
        return _buffers(self.path, self.content)

    def text(self, encoding: str = "utf-8") -> str:
        """Return the content as text with Unix line ends; bytes that are none become replacement characters."""
        return self.content.decode(encoding, "replace").replace("\r\n", "\n").replace("\r", "\n")

    @property
    def digest(self) -> str:
        """The digest of what was read, equal to :func:`hash_source` of the same files."""
        own = hashlib.sha256(self.content).hexdigest()
        return _combined(own, [(name, self._sibling_digest(name)) for name in self.buffers])

    def _sibling_digest(self, name: str) -> str:
        try:
            return hashlib.sha256(self[name]).hexdigest()
        except InputError:
            return ""


#: Where a shape comes from: a file, or what was read of it or made of an object in memory.
Origin: TypeAlias = Path | Source


def location(origin: Origin) -> str:
    """Return the file of a shape as text; empty for a shape that came from memory."""
    if isinstance(origin, Source):
        return str(origin.path) if origin.is_file else ""
    return str(origin)


def inputs_of(files: Iterable[Origin]) -> set[Path]:
    """Return files and their folders, in none of which results may lie, nor they in the results' folder."""
    return {path for file in files if isinstance(file, Path) for path in (file, file.parent)}


def read_source(path: Origin | str) -> Source:
    """Read a file; a source is returned as it is.

    Raises
    ------
    UnavailableError
        If there is no such file or it cannot be read.
    InputError
        If it is empty or larger than :data:`MAX_FILE_BYTES`.
    """
    if isinstance(path, Source):
        return path
    path = existing_file(Path(path))
    return Source(path, _read(path))


def read_start(path: Origin, num: int) -> bytes:
    """Return the first bytes of a file.

    Raises
    ------
    UnavailableError
        If it is no regular file or cannot be read.
    """
    if isinstance(path, Source):
        return path.content[:num]
    with open_regular(path, _limit(path)) as stream:
        return stream.read(num)


def hash_source(path: Origin | str) -> str:
    """Return the digest of a file and of those that it names, 40 hexadecimal digits, without holding it in memory.

    Raises
    ------
    InputError
        As :func:`read_source`.
    """
    if isinstance(path, Source):
        return path.digest
    path = existing_file(Path(path))
    own, siblings = _digest(path), []
    if path.suffix.lower() == ".gltf":
        for name in _buffers(path, _read(path)):
            try:
                siblings.append((name, _digest(sibling_path(path, name))))
            except InputError:
                siblings.append((name, ""))
    return _combined(own, siblings)


def sibling_path(path: Path, name: str) -> Path:
    """Return the path of a file that another one names.

    Raises
    ------
    InputError
        If it is not in the same folder.
    """
    folder = path.parent.resolve()
    found = (folder / name.strip()).resolve() if "\x00" not in name else folder
    if found.parent != folder:
        raise InputError(f"{path}: names {name[:60]!r}, which is outside of its folder")
    return found


def _limit(path: Path) -> int:
    return MAX_GLTF_BYTES if path.suffix.lower() == ".gltf" else MAX_FILE_BYTES


def _read(path: Path) -> bytes:
    with open_regular(path, _limit(path)) as stream:
        return stream.read(os.fstat(stream.fileno()).st_size)


def _digest(path: Path) -> str:
    with open_regular(path, _limit(path)) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _combined(own: str, siblings: list[tuple[str, str]]) -> str:
    if not siblings:
        return own[:DIGEST_LENGTH]
    return hashlib.sha256(json.dumps([own, siblings]).encode()).hexdigest()[:DIGEST_LENGTH]


def _buffers(path: Path, content: bytes) -> tuple[str, ...]:
    """Return the files that a GLTF text names as its buffers; damaged ones name none."""
    if path.suffix.lower() != ".gltf":
        return ()
    try:
        buffers = json.loads(content).get("buffers", [])
        names = [entry["uri"] for entry in buffers if "uri" in entry]
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        return ()
    return tuple(name for name in names if isinstance(name, str) and not name.startswith("data:"))
