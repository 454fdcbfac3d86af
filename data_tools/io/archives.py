"""NPZ and NPY files from anybody: their size is known before memory is taken for them; nothing is unpickled."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from data_tools.errors import InputError, UnavailableError
from data_tools.io.source import Room

_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    ValueError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)
#: How NumPy compresses; other methods unpack without a limit whatever the archive promises.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_HEADER_READERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def load_arrays(content: bytes, name: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of an NPZ archive, of any shape, by name.

    Parameters
    ----------
    content : bytes
        Of the file.
    name : str
        The file, for messages.

    Raises
    ------
    InputError
        If it is no archive, damaged, holds objects, is not compressed as NumPy does it, or unpacks to more than a
        file of its size may hold.
    """
    stream = io.BytesIO(content)
    if not zipfile.is_zipfile(stream):
        raise InputError(f"{name}: not an NPZ archive, or truncated")
    try:
        with zipfile.ZipFile(stream) as archive:
            members = {
                info.filename: info for info in archive.infolist() if info.filename.endswith(".npy")
            }
            if odd := [file for file, one in members.items() if one.compress_type not in _METHODS]:
                raise InputError(
                    f"{name}: {odd[0]} is compressed in a way that is not read; save it with `numpy.savez_compressed`"
                )
            Room(name, len(content)).take(sum(info.file_size for info in members.values()))
            found = {}
            for file, info in members.items():
                with archive.open(info) as member:
                    found[file.removesuffix(".npy")] = load_array(
                        member, info.file_size, f"{name}: {file}"
                    )
            return found
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{name}: damaged archive") from error


def load_array(stream: IO[bytes], num_bytes: int, name: str) -> NDArray[Any]:
    """Return the array of a NPY file, whose header must promise exactly the bytes that are there.

    Parameters
    ----------
    stream : binary stream
    num_bytes : int
        What it holds.
    name : str
        The file, for messages.

    Raises
    ------
    InputError
        If it is no such file, holds objects, or another number of bytes than it promises.
    """
    shape, fortran, dtype = _header(stream, name)
    if dtype.hasobject:
        raise InputError(f"{name} holds Python objects (a pickle), which are never read")
    try:
        left = num_bytes - stream.tell()
        if math.prod(shape) * dtype.itemsize != left:
            raise InputError(f"{name} promises another number of bytes than the {left} that follow")
        values = (
            np.frombuffer(bytearray(stream.read()), dtype=dtype)
            if left
            else np.empty(0, dtype=dtype)
        )
        return values.reshape(shape, order="F" if fortran else "C")
    except InputError:
        raise
    except MemoryError as error:
        raise UnavailableError(f"{name} does not fit in memory") from error
    except _DAMAGE as error:
        raise InputError(f"{name} is damaged, or no NPY file") from error


def _header(stream: IO[bytes], name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return the shape and type of an array, and whether its first axis runs fastest."""
    try:
        version = np.lib.format.read_magic(stream)
        if version in _HEADER_READERS:
            return _HEADER_READERS[version](stream)
    except Exception as error:  # it is parsed as Python, which fails in every way there is
        raise InputError(f"{name} is damaged, or no NPY file") from error
    raise InputError(f"{name} is of NPY version {version}, which is not read")
