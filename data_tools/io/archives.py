"""NPZ archives from anybody: their size is known before memory is taken for them, and nothing is unpickled."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import RawShape, no_faces
from data_tools.io.source import MAX_FILE_BYTES, Source

#: Names of the points in an NPZ archive of a shape, the first found is read.
POINT_KEYS = ("vertices", "points", "positions", "xyz", "verts", "V")
#: Likewise of the triangles.
FACE_KEYS = ("faces", "triangles", "F")
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    ValueError,
    NotImplementedError,
    RuntimeError,
)
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
        If it is no archive, damaged, holds objects, or unpacks to more than a file may hold.
    """
    stream = io.BytesIO(content)
    if not zipfile.is_zipfile(stream):
        raise InputError(f"{name}: not an NPZ archive, or truncated")
    try:
        with zipfile.ZipFile(stream) as archive:
            members = {
                info.filename: info for info in archive.infolist() if info.filename.endswith(".npy")
            }
            total = sum(info.file_size for info in members.values())
            if total > MAX_FILE_BYTES:
                raise InputError(f"{name}: unpacks to {total} bytes, more than {MAX_FILE_BYTES}")
            return {
                file.removesuffix(".npy"): _array(archive, info, name)
                for file, info in members.items()
            }
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{name}: damaged archive") from error


def read_npz(source: Source) -> RawShape:
    """Return the first array of :data:`POINT_KEYS`, and of :data:`FACE_KEYS` if there are any; no pickles."""
    arrays = load_arrays(source.content, str(source.path))
    key = next((k for k in POINT_KEYS if k in arrays), None)
    if key is None:
        raise InputError(f"{source.path}: holds none of the arrays {', '.join(POINT_KEYS)}")
    return RawShape(arrays[key], next((arrays[k] for k in FACE_KEYS if k in arrays), no_faces()))


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> NDArray[Any]:
    """Unpack one array, whose header must promise exactly the bytes that are there."""
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in _HEADER_READERS:
            raise InputError(
                f"{name}: {info.filename} is of NPY version {version}, which is not read"
            )
        shape, fortran, dtype = _HEADER_READERS[version](stream)
        if dtype.hasobject:
            raise InputError(
                f"{name}: {info.filename} holds Python objects (a pickle), which are never read"
            )
        left = info.file_size - stream.tell()
        if math.prod(shape) * dtype.itemsize != left:
            raise InputError(
                f"{name}: {info.filename} promises {math.prod(shape) * dtype.itemsize} bytes, {left} follow"
            )
        values = (
            np.frombuffer(bytearray(stream.read()), dtype=dtype)
            if left
            else np.empty(0, dtype=dtype)
        )
    return values.reshape(shape, order="F" if fortran else "C")
