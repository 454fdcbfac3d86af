"""Frozen dataclasses as records, and records as bytes: the same bytes every time, nothing trusted on the way back.

A record is a dict of names to ``None``, booleans, 64-bit integers, floats, strings, bytes, arrays, and lists and
dicts of these. No code is ever read from a record: there is no pickle, and an array is a number type out of a short
list, a shape, and raw little-endian bytes whose length has to agree with both.

What a record says is used only after the types, shapes, ranges and finiteness that the annotations ask for have been
checked, so that a store made by somebody else can be wrong but not harmful.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import msgpack
import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import Holds, as_floats, as_indices, as_mask, as_rotations, read_only
from data_tools.checks import check_choice
from data_tools.errors import InputError, StoreError
from data_tools.notes import Note

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
    packed: bytes = msgpack.packb(
        _plain(record, "record", 0), use_bin_type=True, unicode_errors="surrogatepass"
    )
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
        value = msgpack.unpackb(
            data,
            ext_hook=_array_from_bytes,
            raw=False,
            strict_map_key=True,
            unicode_errors="surrogatepass",  # file names need not be text
        )
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise StoreError(f"{name}: not a record ({error})") from None
    if not isinstance(value, dict):
        raise StoreError(f"{name}: not a record but {type(value).__name__}")
    _check_plain(value, name, 0)
    return value


def to_arrays(record: Record) -> dict[str, NDArray[Any]]:
    """Return the fields of a record for an NPZ archive: arrays as they are, and bytes (b,) of whatever else."""
    arrays = dict(record)
    for name, value in record.items():
        if not isinstance(value, np.ndarray):
            arrays[name] = np.frombuffer(encode({name: value}), dtype=np.uint8)
    return arrays


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Record:
    """Return the record of an archive from :func:`to_arrays`, in which no field is itself an array of bytes (b,).

    Raises
    ------
    StoreError
        If bytes are not a well-formed record.
    """
    packed = [name for name, value in arrays.items() if value.dtype == np.uint8 and value.ndim == 1]
    return {**arrays} | {name: decode(arrays[name].tobytes(), name).get(name) for name in packed}


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
        raise TypeError(
            f"{name}: a record cannot hold {array.dtype} arrays with {array.ndim} dimensions"
        )
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
        raise ValueError(
            f"{len(data) - start} bytes for an array of shape {shape} and type {dtype}"
        )
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


T = TypeVar("T")
#: What makes a value of a record, whose name is given for messages: a dataclass, or a function of both.
Reader: TypeAlias = type[T] | Callable[[Record, str], T]

#: Indices are below this.
MAX_INDEX = int(np.iinfo(np.int32).max) + 1


def to_record(value: Any) -> Record:
    """Return the fields of a dataclass as a record, all but ``name``: records depend on contents alone."""
    return {
        field.name: _of_field(getattr(value, field.name))
        for field in fields(value)
        if field.name != "name"
    }


def from_record(reader: Reader[T], record: Record, name: str) -> T:
    """Check a record and return what it holds.

    Parameters
    ----------
    reader : type or callable
        A dataclass, whose annotations say what each field holds (:class:`data_tools.arrays.Holds` adds shapes and
        ranges), or a function of a record and its name. Arrays come read-only, and other fields of the record do not
        matter; a field ``name`` is the record's name.
    record : dict
        From :func:`to_record`, or anything else.
    name : str
        What the record is of, for messages.

    Raises
    ------
    StoreError
        If a field is missing, of another type or shape, or impossible.
    """
    if not isinstance(reader, type):
        return reader(record, name)
    try:
        made: T = _made(reader, record | {"name": name})
        return made
    except KeyError as error:
        raise StoreError(f"stored record of {name}: {error} is missing") from None
    except (InputError, TypeError, ValueError) as error:
        raise StoreError(f"stored record of {name}: {error}") from None


def fields_of(reader: Reader[Any]) -> frozenset[str] | None:
    """Return which fields of a record are read; None for all of them."""
    return frozenset(_annotations(reader)) if isinstance(reader, type) else None


@cache
def _annotations(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in fields(kind)}


def _made(kind: Any, record: Record) -> Any:
    sizes: dict[str, int] = {}
    hints = _annotations(kind)
    return kind(**{name: _checked(hint, record[name], name, sizes) for name, hint in hints.items()})


def _of_field(value: Any) -> Any:
    """Return a value as records hold it."""
    if isinstance(value, Note):
        return value.record()
    if is_dataclass(value):
        return to_record(value)
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple):
        return [_of_field(item) for item in value]
    return value


def _checked(hint: Any, value: Any, name: str, sizes: dict[str, int]) -> Any:
    """Return a value of the kind that an annotation asks for; named lengths have to agree with each other."""
    holds = Holds()
    if get_origin(hint) is Annotated:
        hint, holds = get_args(hint)
    origin, inner = get_origin(hint), get_args(hint)
    if alias := getattr(origin, "__value__", None):  # NDArray is a named alias from NumPy 2.5 on
        origin, inner = np.ndarray, get_args(alias[inner])
    if origin in (Union, UnionType):
        (kind,) = (one for one in inner if one is not NoneType)
        return None if value is None else _checked(kind, value, name, sizes)
    if origin is np.ndarray:
        return _array(get_args(inner[1])[0], holds, value, name, sizes)
    if origin is Literal:
        check_choice(name, value, inner)
        return value
    if origin in (tuple, Sequence):
        return tuple(_checked(inner[0], item, name, sizes) for item in _instance(list, value, name))
    if origin in (dict, Mapping):
        return {
            key: _checked(inner[1], item, name, sizes)
            for key, item in _instance(dict, value, name).items()
        }
    if hint is Note:
        return Note.from_record(_instance(dict, value, name))
    if is_dataclass(hint):
        return _made(hint, _instance(dict, value, name))
    if issubclass(hint, Enum):
        if _instance(str, value, name) not in hint.__members__:
            raise InputError(f"{name}: {value!r} is none")
        return hint[value]
    return _number(holds, value, name) if hint is float else _instance(hint, value, name)


def _instance(kind: type, value: Any, name: str) -> Any:
    if type(value) is not kind:
        raise InputError(f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    return value


def _number(holds: Holds, value: Any, name: str) -> float:
    if type(value) not in (int, float):
        raise InputError(f"{name}: expected a number, got {type(value).__name__}")
    if value != value and not holds.nan:
        raise InputError(f"{name}: is NaN")
    if holds.positive and not 0 < value < np.inf:
        raise InputError(f"{name}: expected a positive number, got {value}")
    return float(value)


def _array(scalar: Any, holds: Holds, value: Any, name: str, sizes: dict[str, int]) -> NDArray[Any]:
    """Return a read-only array of a scalar type, of the shape that is asked for."""
    if not isinstance(value, np.ndarray):
        raise InputError(f"{name}: expected an array, got {type(value).__name__}")
    if scalar is Any:
        return value
    words = holds.shape.split() or ["_"] * value.ndim
    shape = [int(word) if word.isdigit() else sizes.get(word) for word in words]
    if words[:1] and words[0].endswith("?") and len(value):
        shape[0] = sizes[words[0].removesuffix("?")]
    if issubclass(scalar, np.bool_):
        array: NDArray[Any] = as_mask(value, name, shape=shape)
    elif issubclass(scalar, np.integer):
        upper = min(MAX_INDEX, int(np.iinfo(scalar).max) + 1)
        array = as_indices(value, name, lower=holds.lower, upper=upper, shape=shape)
    else:
        may_be_nan = holds.nan and value.dtype.kind == "f"
        unknown = np.isnan(value) if may_be_nan else np.zeros(value.shape, dtype=np.bool_)
        array = as_floats(np.where(unknown, 0.0, value), name, shape=shape)
        array[unknown] = np.nan
        array = as_rotations(array, name) if holds.rotations else array
    for word, length in zip(words, array.shape, strict=True):
        if word != "_" and not word.endswith("?"):
            sizes[word] = length
    return read_only(array.astype(scalar, copy=False))
