"""The door of all verifiers: a certificate's arrays, each checked, copied to one type, and all of them used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import InputError

#: Numbers beyond this, in the problem's own unit, are refused: their products would overflow.
LARGEST = 1e100


def in_unit(values: FloatArray, exponent: int, name: str) -> FloatArray:
    """Return ``values / 2 ** exponent``, shape (...); what becomes smaller than the smallest number vanishes.

    Raises
    ------
    InputError
        If a value exceeds ``LARGEST`` then.
    """
    with np.errstate(over="ignore", under="ignore"):
        scaled = np.ldexp(values, -exponent)
    if not np.abs(scaled).max(initial=0.0) <= LARGEST:
        raise InputError(f"{name} contains values that are too large for this problem")
    return scaled


class CertificateArrays:
    """Hands out the arrays of a certificate as plain float64, bool and int64, whatever type they were given in.

    Floating-point numbers are divided by a power of two, the unit of the problem, which rounds nothing; numbers that
    vanish by this are other dual variables, and any prove a valid bound.

    Parameters
    ----------
    arrays : mapping of str to array
        As a file or a caller gives them; nothing about them is believed.
    exponent : int, optional
        The unit is ``2 ** exponent``; None leaves numbers as they are, however large.
    known : sequence of str
        Names that somebody else reads.
    """

    def __init__(self, arrays: Mapping[str, Any], exponent: int | None = None, known: Sequence[str] = ()) -> None:
        if not isinstance(arrays, Mapping):
            raise InputError("certificate: its arrays are not a mapping of names to arrays")
        self._arrays, self._exponent = arrays, exponent
        self._unread = set(arrays) - set(known)

    def __contains__(self, name: str) -> bool:
        return name in self._arrays

    def floats(self, name: str, shape: Sequence[int | None]) -> FloatArray:
        """Return a float64 copy in the problem's unit; ``None`` in the shape stands for any length.

        Raises
        ------
        InputError
            If the array is missing, of another shape, no floating-point array, not finite or too large.
        """
        values = np.array(self._take(name, shape, "f"), dtype=np.float64, order="C")
        if not np.isfinite(values).all():
            raise InputError(f"certificate: {name} contains values that are not finite")
        return values if self._exponent is None else in_unit(values, self._exponent, f"certificate: {name}")

    def bools(self, name: str, shape: Sequence[int | None]) -> BoolArray:
        """Return a copy of a boolean array of this shape; raises as :meth:`floats`."""
        return np.array(self._take(name, shape, "b"), dtype=np.bool_, order="C")

    def indices(self, name: str, shape: Sequence[int | None], upper: Sequence[int] | int) -> IntArray:
        """Return an int64 copy, of this shape, of integers in [0, upper); raises as :meth:`floats`."""
        raw = np.asarray(self._take(name, shape, "iu"))
        if not ((raw >= 0) & (raw < np.asarray(upper))).all():
            raise InputError(f"certificate: {name} contains numbers outside [0, {upper})")
        return np.array(raw, dtype=np.int64, order="C")

    def refuse_rest(self, kind: str) -> None:
        """Refuse arrays that nobody asked for: they would belong to another kind of proof, or hide a claim."""
        if self._unread:
            names = ", ".join(sorted(map(str, self._unread))[:5])
            raise InputError(f"certificate: arrays that kind {kind!r} does not have: {names}")

    def _take(self, name: str, shape: Sequence[int | None], kinds: str) -> NDArray[Any]:
        if name not in self._arrays:
            raise InputError(f"certificate: {name} is missing")
        values = self._arrays[name]
        if not isinstance(values, np.ndarray) or values.dtype.kind not in kinds:
            raise InputError(f"certificate: {name} has the wrong type, {getattr(values, 'dtype', type(values))}")
        fits = len(values.shape) == len(shape)
        if not fits or any(e is not None and e != f for e, f in zip(shape, values.shape, strict=True)):
            words = ", ".join("any" if e is None else str(e) for e in shape)
            raise InputError(f"certificate: {name} has shape {values.shape}, expected ({words})")
        self._unread.discard(name)
        return values
