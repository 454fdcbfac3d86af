"""A shape file in memory, read once, so that reader and key of its result see the same bytes; where files lie."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import TypeAlias
from urllib.parse import unquote

from data_tools.errors import InputError
from data_tools.io.files import any_text, existing_file, open_regular

#: Larger files are refused before anything of them is read, in bytes.
MAX_FILE_BYTES = 4 * 2**30
#: What the arrays of a file may take in memory, in bytes: so much whatever its size, and so much more for each of its
#: bytes. A million points with two million triangles take 72 MB. Deflate packs ones that are all alike a thousandfold
#: and those of real surfaces less than twentyfold.
_FREE_BYTES, _BYTES_PER_BYTE = 64 * 2**20, 64
#: Hexadecimal digits of a digest, and of a key of the store: 160 bits of SHA-256.
DIGEST_LENGTH = 40


class Source:
    """One file; get it with :func:`read_source`.

    Attributes
    ----------
    path : Path
        What messages call it.
    content : bytes
    suffix : str
        Of the format, in lower case: the path's own, unless another one is given.
    is_file : bool
        Whether it came from the disk; otherwise the path is only the name of a shape that the caller holds.
    companions : mapping of str to bytes
        The files that it names as its data, which a glTF file has next to it, by the names it gives them.
    """

    def __init__(
        self,
        path: Path,
        content: bytes,
        *,
        suffix: str | None = None,
        companions: Mapping[str, bytes] | None = None,
    ) -> None:
        self.path = path
        self.content = content
        self.companions = dict(companions or {})
        self.suffix = (path.suffix if suffix is None else suffix).lower()
        self.is_file = suffix is None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Source) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((self.path, self.content))

    def absolute(self) -> Source:
        """Return the source itself: it is in memory, wherever it came from."""
        return self

    @property
    def name(self) -> str:
        """The file's name, or the shape's."""
        return self.path.name if self.is_file else str(self.path)

    def text(self) -> str:
        """Return the content as text with Unix line ends, whatever its encoding."""
        return any_text(self.content)

    @property
    def digest(self) -> str:
        """The digest of what was read, equal to :func:`hash_source` of the same file."""
        digest = hashlib.sha256(self.content)
        for content in self.companions.values():
            digest.update(content)
        return digest.hexdigest()[:DIGEST_LENGTH]


class Room:
    """The memory that the arrays of one file may take: in proportion to its size, or a small file could fill any.

    Parameters
    ----------
    name : str
        The file, for messages.
    num_bytes : int
        Its size.
    """

    def __init__(self, name: str, num_bytes: int) -> None:
        self._name, self._num_bytes = name, num_bytes
        self._most = min(_FREE_BYTES + _BYTES_PER_BYTE * num_bytes, MAX_FILE_BYTES)
        self._left = self._most

    @classmethod
    def of(cls, source: Source) -> Room:
        """Return the memory of a file in memory, with the files of its data."""
        sizes = (len(data) for data in (source.content, *source.companions.values()))
        return cls(str(source.path), sum(sizes))

    def take(self, num_bytes: int, advice: str = "save it without compression") -> None:
        """Count what is going to be unpacked or copied, in bytes, before memory is taken.

        Raises
        ------
        InputError
            If the file asks for more than its size allows; ``advice`` says how it can be read nevertheless.
        """
        self._left -= num_bytes
        if self._left < 0:
            raise InputError(
                f"{self._name}: promises more than a file of its size can hold, it is damaged or was made to fill "
                f"the memory. If it is right, {advice} ({self._num_bytes} bytes, at most {self._most} bytes of "
                "arrays)"
            )


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
        If there is no such file, or it or a file of its data cannot be read.
    InputError
        If it is empty or larger than :data:`MAX_FILE_BYTES`, with its data, or names data outside of its folder.
    """
    if isinstance(path, Source):
        return path
    path = existing_file(Path(path))
    content = _read(path)
    return Source(
        path, content, companions=_companions(path, content) if _has_companions(path) else {}
    )


def read_start(path: Origin, num: int) -> bytes:
    """Return the first bytes of a file.

    Raises
    ------
    UnavailableError
        If it is no regular file or cannot be read.
    """
    if isinstance(path, Source):
        return path.content[:num]
    with open_regular(path, MAX_FILE_BYTES) as stream:
        return stream.read(num)


def hash_source(path: Origin | str) -> str:
    """Return the digest of a file, 40 hexadecimal digits, without holding it in memory.

    Raises
    ------
    InputError
        As :func:`read_source`.
    """
    if isinstance(path, Source) or _has_companions(Path(path)):
        return read_source(path).digest
    with open_regular(existing_file(Path(path)), MAX_FILE_BYTES) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()[:DIGEST_LENGTH]


def _read(path: Path, max_bytes: int = MAX_FILE_BYTES) -> bytes:
    with open_regular(path, max_bytes) as stream:
        return stream.read(os.fstat(stream.fileno()).st_size)


def _has_companions(path: Path) -> bool:
    """Return whether files of this kind name others that hold their data."""
    return path.suffix.lower() == ".gltf"


def _companions(path: Path, content: bytes) -> dict[str, bytes]:
    """Return the files that a glTF file names as its buffers, all from its own folder; damage is for its reader."""
    try:
        buffers = json.loads(content)["buffers"]
        names = dict.fromkeys(
            buffer["uri"] for buffer in buffers if not buffer["uri"].startswith("data:")
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}
    found: dict[str, bytes] = {}
    read: dict[PurePosixPath, bytes] = {}  # one file under several names is read once
    room = MAX_FILE_BYTES - len(content)
    for name in names:
        place = PurePosixPath(unquote(name))
        if (
            len(name) > 255
            or place.is_absolute()
            or ".." in place.parts
            or {":", "\\", "\0"} & {*str(place)}
        ):
            raise InputError(
                f"{path}: names as its data no file of its own folder; others are not opened"
            )
        if place not in read:
            read[place] = _read(existing_file(path.parent / place), room)
            room -= len(read[place])
        found[name] = read[place]
    return found
