"""Records as bytes: plain values and arrays in msgpack, the same bytes every time, nothing trusted on the way back.

A record is a dict of names to ``None``, booleans, 64-bit integers, floats, strings, bytes, arrays, and lists and
dicts of these. No code is ever read from a record: there is no pickle, and an array is a number type out of a short
list, a shape, and raw little-endian bytes whose length has to agree with both.
"""

from __future__ import annotations

import math
import struct
from typing import Any, TypeAlias

import msgpack
import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import read_only
from data_tools.errors import StoreError

Record: TypeAlias = dict[str, Any]

#: msgpack extension type of arrays.
_ARRAY_EXTENSION = 1
#: Number types that a record may hold, by their code in the encoding.
_DTYPES = ("<f8", "<f4", "<i8", "<i4", "|u1", "|b1")
_CODES = {np.dtype(name): code for code, name in enumerate(_DTYPES)}
_MAX_DIMENSIONS = 4
_MAX_DEPTH = 6


def encode(record: Record) -> bytes:
    """Encode a record; equal records give equal bytes, whatever the order of their keys.

    Parameters
    ----------
    record : dict
        Tuples become lists and NumPy scalars plain numbers; arrays are stored in C order.

    Raises
    ------
    TypeError
        If a value is of a kind that records do not hold.
    """
    if not isinstance(record, dict):
        raise TypeError(f"a record is a dict, got {type(record).__name__}")
    packed: bytes = msgpack.packb(_plain(record, "record", 0), use_bin_type=True)
    return packed


def decode(data: bytes, name: str) -> Record:
    """Decode a record and check every value in it; arrays come back read-only.

    Parameters
    ----------
    data : bytes
        What :func:`encode` gave, or anything else.
    name : str
        What the bytes are, for the message.

    Raises
    ------
    StoreError
        If the bytes are not a well-formed record.
    """
    try:
        value = msgpack.unpackb(data, ext_hook=_array_from_bytes, raw=False, strict_map_key=True)
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise StoreError(f"{name}: not a record ({type(error).__name__}: {error})") from None
    if not isinstance(value, dict):
        raise StoreError(f"{name}: not a record but {type(value).__name__}")
    _check_plain(value, name, 0)
    return value


def _plain(value: Any, name: str, depth: int) -> Any:
    """Return the value in the types that msgpack knows, dicts in the order of their keys."""
    if depth > _MAX_DEPTH:
        raise TypeError(f"{name}: nested deeper than {_MAX_DEPTH} levels")
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value):
            raise TypeError(f"{name}: keys of a record are strings")
        return {key: _plain(value[key], f"{name}.{key}", depth + 1) for key in sorted(value)}
    if isinstance(value, list | tuple):
        return [_plain(item, name, depth + 1) for item in value]
    if isinstance(value, np.ndarray):
        return msgpack.ExtType(_ARRAY_EXTENSION, _array_to_bytes(value, name))
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return value
    raise TypeError(f"{name}: a record cannot hold {type(value).__name__}")


def _array_to_bytes(array: NDArray[Any], name: str) -> bytes:
    code = _CODES.get(array.dtype)
    if code is None or array.ndim > _MAX_DIMENSIONS:
        raise TypeError(f"{name}: a record cannot hold {array.dtype} arrays with {array.ndim} dimensions")
    header = struct.pack(f"<BB{array.ndim}Q", code, array.ndim, *array.shape)
    return header + array.tobytes(order="C")


def _array_from_bytes(extension: int, data: bytes) -> NDArray[Any]:
    if extension != _ARRAY_EXTENSION or len(data) < 2:
        raise ValueError(f"extension {extension} with {len(data)} bytes is not an array")
    code, num_dimensions = data[0], data[1]
    start = 2 + 8 * num_dimensions
    if code >= len(_DTYPES) or num_dimensions > _MAX_DIMENSIONS or len(data) < start:
        raise ValueError(f"array of type {code} with {num_dimensions} dimensions")
    shape = struct.unpack_from(f"<{num_dimensions}Q", data, 2)
    dtype = np.dtype(_DTYPES[code])
    if max(shape, default=0) >= 2**31 or math.prod(shape) * dtype.itemsize != len(data) - start:
        raise ValueError(f"{len(data) - start} bytes for an array of shape {shape} and type {dtype}")
    if dtype.kind == "b" and data[start:].strip(b"\x00\x01"):
        raise ValueError("a boolean array with other bytes than 0 and 1")
    return read_only(np.frombuffer(data, dtype=dtype, offset=start).reshape(shape).copy())


def _check_plain(value: Any, name: str, depth: int) -> None:
    """Refuse what msgpack can hold but a record cannot: deep nesting, timestamps."""
    if depth > _MAX_DEPTH:
        raise StoreError(f"{name}: nested deeper than {_MAX_DEPTH} levels")
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                raise StoreError(f"{name}: a key is {type(key).__name__}, not a string")
            _check_plain(item, name, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _check_plain(item, name, depth + 1)
    elif value is not None and not isinstance(value, bool | int | float | str | bytes | np.ndarray):
        raise StoreError(f"{name}: holds a {type(value).__name__}")
