"""Keys made of content: what was computed, from which bytes, with which options, by which version."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.store.records import encode
from data_tools.io.source import DIGEST_LENGTH


def fingerprint(algorithm_version: str, options: Any, *content_hashes: str) -> str:
    """Return the key of a computation.

    Parameters
    ----------
    algorithm_version : str
        Changes whenever the same input and options would give another answer.
    options : dataclass, mapping, or plain value
        Only the options that matter for the answer. 1 and 1.0 count as the same value.
    *content_hashes : str
        Hashes or keys of the inputs, in order.

    Returns
    -------
    str
        40 hexadecimal digits.

    Examples
    --------
    >>> fingerprint("1", {"points": 64}, "ab") == fingerprint("1", {"points": 64.0}, "ab")
    True
    """
    content = {"version": algorithm_version, "options": _canonical(options), "content": list(content_hashes)}
    return hashlib.sha256(encode(content)).hexdigest()[:DIGEST_LENGTH]


def pair_seed(seed: int, target: str, source: str) -> int:
    """Return the seed of a pair, the same in every order and company of shapes.

    Parameters
    ----------
    seed : int
        Of the collection.
    target, source : str
        What identifies the two shapes: in an alignment their keys, made of their contents and options, so that
        neither the names of files nor their places matter.

    Returns
    -------
    int
        In [0, 2^63), for :func:`numpy.random.default_rng`.
    """
    names = [name.encode("utf-8", "surrogateescape") for name in (target, source)]
    content = encode({"seed": int(seed), "names": names})
    return int.from_bytes(hashlib.sha256(content).digest()[:8], "big") >> 1


def _canonical(value: Any) -> Any:
    """Return options as plain values in which equal settings are equal bytes."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _canonical(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items()}
    if isinstance(value, set | frozenset):
        return sorted(_canonical(item) for item in value)
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value
