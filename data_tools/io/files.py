"""Files that are complete or not there at all, what they may be called, and folders in the order people expect."""

from __future__ import annotations

import codecs
import errno
import hashlib
import io
import os
import re
import secrets
import shutil
import stat
import sys
import tomllib
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import Any

from data_tools.errors import InputError, UnavailableError, printable

#: Longer texts and rows of stores are refused before they are read, in bytes: manifests, summaries, records are far
#: shorter, and a damaged length field could ask for any memory.
MAX_TEXT_BYTES = 256 * 2**20
#: For ``os.open``: no pipe is waited for, no child inherits the file, bytes come as they are; each system has some.
_AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: Longest stem that leaves room for every ending, in bytes.
_MAX_STEM_BYTES = 200
_NUM_HASH_DIGITS = 12
#: Most tables in tables of a configuration; options have two.
_MAX_NESTING = 20


def write_atomic(path: Path, content: bytes) -> Path:
    """Write a file through a temporary neighbour and a rename: readers see all of it or nothing.

    Parameters
    ----------
    path : Path
        Its folder is made if it does not exist.
    content : bytes

    Returns
    -------
    Path
        The same path.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(
        f".{os.getpid()}-{secrets.token_hex(8)}"
    )  # a long name has no room for more
    try:
        with temporary.open("xb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return path


def own_copy(path: Path) -> None:
    """Put a copy in the place of a file that has other names too (hard links), so that writing leaves those alone."""
    try:
        if path.stat().st_nlink < 2:
            return
    except FileNotFoundError:
        return
    temporary = path.with_name(f".{os.getpid()}-{secrets.token_hex(8)}")
    try:
        shutil.copy2(path, temporary)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def open_regular(path: Path, max_bytes: int) -> Iterator[BufferedReader]:
    """Open a regular file of bearable size: a pipe would be waited for, and a device never ends.

    Raises
    ------
    UnavailableError
        If it cannot be opened or is no regular file.
    InputError
        If it is larger.
    """
    try:
        with open(os.open(path, os.O_RDONLY | _AT_ONCE), "rb") as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise UnavailableError(f"{path}: is not a regular file")
            if status.st_size > max_bytes:
                raise InputError(
                    f"{path}: {status.st_size} bytes, at most {max_bytes} are read; make it smaller first"
                )
            yield stream
    except OSError as error:
        raise UnavailableError(f"{path}: cannot be read ({error.strerror or error})") from error


def resolved(path: Path) -> Path:
    """Return the path without links.

    Raises
    ------
    InputError
        If it leads through a loop of links, or is too long.
    """
    try:
        found = path.resolve()
        found.lstat()
    except FileNotFoundError:
        return found
    except (OSError, RuntimeError) as error:
        reason = (getattr(error, "strerror", None) or "its links lead round in a loop").lower()
        raise InputError(
            f"{str(path)[:200]}: cannot be used ({reason}); name another place"
        ) from None
    return found


def system_reason(error: OSError) -> str:
    """Say why a file could not be written or read; of a full disk also what else may be used up, and what to do."""
    if error.errno in (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)):
        return (
            "the disk is full, or has no room for one more file, or your quota is used up; `df` and `df -i` show "
            "free bytes and free files. Make room, or name a place on another disk"
        )
    return error.strerror or str(error)


def read_text(path: Path, encoding: str = "utf-8") -> str:
    """Return the text of a regular file.

    Raises
    ------
    InputError
        As :func:`open_regular`.
    UnicodeDecodeError
        If it is no text of this encoding.
    """
    with open_regular(path, MAX_TEXT_BYTES) as stream:
        content = stream.read()
    return content.decode(encoding)


def read_any_text(path: Path) -> str:
    """Return a text that any program wrote, in composed Unicode (NFC), in which names are compared.

    It is UTF-16 where a mark or its zero bytes say so, else UTF-8, else Windows-1252 or Latin-1, which spreadsheets
    write.

    Raises
    ------
    InputError
        As :func:`open_regular`.
    """
    with open_regular(path, MAX_TEXT_BYTES) as stream:
        return composed(any_text(stream.read()))


def any_text(content: bytes) -> str:
    """Return a file's bytes as text with Unix line ends, in any encoding, as :func:`read_any_text`; never fails."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif b"\0" in content[:2]:  # the first character of a table is one of ASCII
        encodings = ["utf-16-be" if content[:1] == b"\0" else "utf-16-le"]
    else:
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in [*encodings, "latin-1"]:
        with suppress(UnicodeDecodeError):
            return content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    raise AssertionError  # Latin-1 decodes everything


def beginning_of(path: Path) -> str:
    """Return the first characters of a file in any encoding, none if it is unreadable."""
    with suppress(InputError), open_regular(path, sys.maxsize) as stream:
        return any_text(stream.read(io.DEFAULT_BUFFER_SIZE))
    return ""


def read_toml(path: Path | str) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises
    ------
    InputError
        If it cannot be read, is not TOML, or is nested more deeply than any configuration.
    """
    path = Path(path)
    try:
        content = tomllib.loads(read_text(path))
    except InputError:
        raise
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not TOML ({error})") from None
    except ValueError:
        raise InputError(f"{path}: not a configuration, a number in it is too long") from None
    except RecursionError:
        raise _nested_too_deeply(path) from None
    inside: list[Any] = [content]
    for _ in range(_MAX_NESTING):
        tables = (one.values() if isinstance(one, dict) else one for one in inside)
        inside = [value for table in tables for value in table if isinstance(value, dict | list)]
    if inside:
        raise _nested_too_deeply(path)
    return content


def _nested_too_deeply(path: Path) -> InputError:
    return InputError(f"{path}: not a configuration, its lists or tables are nested too deeply")


def composed(name: str) -> str:
    """Return a name in composed Unicode (NFC), in which names are compared: file systems may keep accents apart."""
    return unicodedata.normalize("NFC", name)


def natural_key(name: str) -> tuple[tuple[tuple[int, int | str], ...], str]:
    """Return a sort key under which ``tooth2`` comes before ``tooth10``; case counts only between equals."""
    parts = re.split(r"(\d+)", name.casefold())
    return tuple((0, int(part)) if part.isdecimal() else (1, part) for part in parts if part), name


def readable_name(path: Path) -> str:
    """Return a file's name as text that can be printed, saved and compared (NFC).

    Bytes that are no UTF-8 become escapes, and so do control characters.
    """
    return printable(composed(os.fsencode(path.name).decode("utf-8", "backslashreplace")))


def readable_stem(path: Path) -> str:
    """Return a file's name without its suffix, as :func:`readable_name` does: what a shape of it is called."""
    return readable_name(path).removesuffix(path.suffix)


def existing_file(path: Path) -> Path:
    """Return the path of a file that exists and is not empty.

    Raises
    ------
    UnavailableError
        If it does not exist, is a folder or cannot be read.
    InputError
        If it is empty.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise UnavailableError(f"{path}: no such file")
        if not path.is_file():
            raise UnavailableError(f"{path}: is not a file")
        if path.stat().st_size == 0:
            raise InputError(f"{path}: the file is empty")
    except OSError as error:
        raise UnavailableError(f"{path}: cannot be read ({error.strerror or error})") from error
    return path


def file_stem(name: str) -> str:
    """Return the name of a shape as a file name, which cannot leave the folder or be refused by a file system."""
    readable = name.encode("utf-8", "backslashreplace").decode("utf-8")
    stem = re.sub(r'[\x00-\x1f<>:"/\\|?*]', "_", readable).strip(" .") or "shape"
    if len(stem.encode()) <= _MAX_STEM_BYTES:
        return stem
    digest = hashlib.sha256(stem.encode()).hexdigest()[:_NUM_HASH_DIGITS]
    return (
        stem.encode()[: _MAX_STEM_BYTES - len(digest) - 1].decode("utf-8", "ignore") + "-" + digest
    )


def file_stems(names: Iterable[str]) -> list[str]:
    """Return file stems of several shapes, made distinct (also where case does not count) by a number at the end."""
    return distinct_forms(names, file_stem, same=str.casefold)


def distinct_forms(
    names: Iterable[str], form: Callable[[str], str], *, same: Callable[[str], str] = str
) -> list[str]:
    """Return another form of each of several names, made distinct by a number at the end.

    Parameters
    ----------
    names : iterable of str
    form : callable
        Returns the form of a name.
    same : callable
        Forms for which it returns the same are not distinct.
    """
    taken: set[str] = set()
    forms = []
    for name in names:
        distinct, number = form(name), 2
        while same(distinct) in taken:
            distinct, number = f"{form(name)}-{number}", number + 1
        taken.add(same(distinct))
        forms.append(distinct)
    return forms
