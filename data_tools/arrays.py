"""The only array validators of the project: every public function checks its arrays here.

Each validator returns a C-contiguous copy in the project's own type, so that the arithmetic behind it does not
depend on strides or on the caller's dtype, and later changes by the caller change nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_tools.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: Largest ``|R^T R - I|`` entry accepted as an orthogonal matrix given by a user.
ORTHOGONAL_TOL = 1e-6
#: Entries of an array that work in slabs holds at once: what fits the processor's cache is fastest.
CACHED_ENTRIES = 50_000


@dataclass(frozen=True, kw_only=True)
class Holds:
    """What a field holds in addition to its type, as ``Annotated[FloatArray, Holds(shape="k 3")]``.

    Attributes
    ----------
    shape : str
        Lengths of an array: numbers, ``_`` for any, and names, which stand for the same length in all fields of a
        dataclass; with ``?`` behind it the first may also be 0. Empty for any shape.
    rotations : bool
        Whether an array holds orthogonal matrices.
    lower : int
        No index is smaller.
    nan, positive : bool
        Whether a number, or numbers of an array, may be NaN; whether a number has to be positive and finite.
    """

    shape: str = ""
    rotations: bool = False
    lower: int = 0
    nan: bool = False
    positive: bool = False


def one_line(result: Any) -> str:
    """Return a dataclass in one line, as its ``__repr__``: numbers and words as they are, the rest by its size."""
    return f"{type(result).__name__}({', '.join(_words(result))})"


def _words(result: Any) -> Iterator[str]:
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, np.ndarray):
            yield f"{field.name}: {' x '.join(map(str, value.shape))}"
        elif isinstance(value, tuple | list | dict):
            yield f"{field.name}: {len(value)}"
        elif isinstance(value, float):
            yield f"{field.name}={value:.6g}"
        elif value is None or isinstance(value, bool | int | str | Enum):
            yield f"{field.name}={value!r}"


class Rows:
    """Base of dataclasses whose fields are arrays of one length, or such dataclasses: rows are taken and joined."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def take(self, index: IntArray) -> Self:
        """Return the rows at the given positions (m,)."""
        return type(self)(
            **{n: v.take(index) if isinstance(v, Rows) else v[index] for n, v in vars(self).items()}
        )

    def join(self, *others: Self) -> Self:
        """Return these rows and those of the others."""
        columns = {name: [getattr(one, name) for one in (self, *others)] for name in vars(self)}
        return type(self)(
            **{
                n: c[0].join(*c[1:]) if isinstance(c[0], Rows) else np.concatenate(c)
                for n, c in columns.items()
            }
        )


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return ``array`` (any shape) itself, marked as read-only."""
    array.flags.writeable = False
    return array


def extremes(points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the least and the largest of each coordinate of points (n, d), each of shape (d,).

    Extremes of a few long rows take a fortieth of the time of those of many short ones.
    """
    coordinates = np.ascontiguousarray(points.T)
    return coordinates.min(axis=1), coordinates.max(axis=1)


def rms_length(vectors: FloatArray) -> float:
    """Return the root mean square length of vectors (n, d): of centred points, their radius."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def sums_by_owner(rows: FloatArray, owner: IntArray, num: int) -> FloatArray:
    """Return the sums of the rows (n, m) of each owner, shape (num, m), given the owner of each row (n,)."""
    return np.stack(
        [np.bincount(owner, weights=column, minlength=num) for column in rows.T], axis=1
    )


def as_floats(
    values: ArrayLike, name: str, *, shape: Sequence[int | None] | None = None
) -> FloatArray:
    """Check a numeric array of any shape, or a given one, and return it as finite, C-contiguous float64.

    Parameters
    ----------
    values : array_like
        Any real array.
    name : str
        How the caller calls it, for the message.
    shape : sequence of int or None, optional
        Expected shape; ``None`` entries are free.

    Returns
    -------
    ndarray of float64
        A fresh C-contiguous copy.

    Raises
    ------
    InputError
        If it is not numeric, not finite or of another shape.
    """
    raw = np.asarray(values)
    if raw.dtype.kind not in "fiub":
        raise InputError(f"{name}: expected real numbers, got dtype {raw.dtype}")
    array = np.array(raw, dtype=np.float64, order="C")
    _check_shape(array.shape, name, shape)
    bad = array.size - int(np.isfinite(array).sum())
    if bad:
        raise InputError(
            f"{name}: {bad} of {array.size} values are NaN or infinite; remove them first"
        )
    return array


def as_points(
    points: ArrayLike, name: str, *, min_points: int = 1, dim: int | None = None
) -> FloatArray:
    """Check points given as rows and return an (n, d) float64 array.

    Parameters
    ----------
    points : array_like, shape (n, d)
        Points are rows.
    name : str
        How the caller calls them.
    min_points : int
        Fewest rows accepted.
    dim : int, optional
        Required number of columns.

    Raises
    ------
    InputError
        If the array is not two-dimensional, has too few rows, another number of columns, or non-finite values.
    """
    array = as_floats(points, name, shape=(None, dim))
    if array.shape[1] == 0:
        raise InputError(f"{name}: points have no coordinates, shape {array.shape}")
    if array.shape[0] < min_points:
        raise InputError(f"{name}: {array.shape[0]} points, at least {min_points} are needed")
    return array


def as_faces(faces: ArrayLike, name: str, *, num_vertices: int) -> IntArray:
    """Check triangles given as rows of vertex indices, shape (f, 3).

    Raises
    ------
    InputError
        If an index is not an integer, negative, or not below ``num_vertices``.
    """
    array = as_indices(faces, name, upper=num_vertices, shape=(None, 3))
    return array


def as_indices(
    indices: ArrayLike,
    name: str,
    *,
    upper: int,
    lower: int = 0,
    shape: Sequence[int | None] | None = None,
) -> IntArray:
    """Check integer indices in ``[lower, upper)``, of any shape or a given one, and return them as int64.

    Raises
    ------
    InputError
        If the values are not integers, out of range, or of another shape.
    """
    raw = np.asarray(indices)
    if raw.size == 0 and raw.dtype.kind == "f":
        raw = raw.astype(np.int64)
    if raw.dtype.kind not in "iu":
        raise InputError(f"{name}: expected integer indices, got dtype {raw.dtype}")
    if raw.size and (int(raw.min()) < lower or int(raw.max()) >= upper):
        raise InputError(
            f"{name}: indices run from {raw.min()} to {raw.max()}, expected them in [{lower}, {upper})"
        )
    array = np.array(raw, dtype=np.int64, order="C")
    _check_shape(array.shape, name, shape)
    return array


def as_mask(mask: ArrayLike, name: str, *, shape: Sequence[int | None]) -> BoolArray:
    """Check a boolean array of shape ``shape``; 0 and 1 are accepted as well.

    Raises
    ------
    InputError
        If it holds anything but booleans, zeros and ones, or has another shape.
    """
    raw = np.asarray(mask)
    if raw.dtype.kind != "b" and not np.isin(raw, (0, 1)).all():
        raise InputError(
            f"{name}: expected booleans, got dtype {raw.dtype} with other values than 0 and 1"
        )
    array = np.array(raw, dtype=np.bool_, order="C")
    _check_shape(array.shape, name, shape)
    return array


def as_weights(weights: ArrayLike | None, name: str, *, num: int) -> FloatArray:
    """Check non-negative weights (num,), not all zero; ``None`` means all ones.

    Raises
    ------
    InputError
        If a weight is negative or not finite, all are zero, or their number is not ``num``.
    """
    if weights is None:
        return np.ones(num)
    array = as_floats(weights, name, shape=(num,))
    if (array < 0).any():
        raise InputError(f"{name}: weights must not be negative, smallest is {array.min()}")
    if not (array > 0).any():
        raise InputError(f"{name}: all weights are zero")
    return array


def as_rotations(
    rotations: ArrayLike, name: str, *, group: str = "O", dim: int | None = None
) -> FloatArray:
    """Check orthogonal matrices, shape (..., d, d), of determinant +1 where ``group == "SO"``.

    Raises
    ------
    InputError
        If a matrix is not orthogonal to 1e-6, or is a reflection where rotations are asked for.
    """
    array = as_floats(rotations, name)
    if array.ndim < 2 or array.shape[-1] != array.shape[-2] or array.shape[-1] == 0:
        raise InputError(f"{name}: expected square matrices (..., d, d), got shape {array.shape}")
    if dim is not None and array.shape[-1] != dim:
        raise InputError(f"{name}: expected {dim} x {dim} matrices, got shape {array.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        gram = np.swapaxes(array, -1, -2) @ array
        error = float(np.abs(gram - np.eye(array.shape[-1])).max(initial=0.0))
    if not error <= ORTHOGONAL_TOL:  # NaN where squares overflow
        raise InputError(f"{name}: not orthogonal, |R^T R - I| reaches {error:.2g}")
    if group == "SO" and array.size and float(np.linalg.det(array).min()) < 0:
        raise InputError(f"{name}: contains a reflection (determinant -1) but group is 'SO'")
    return array


def _check_shape(found: tuple[int, ...], name: str, expected: Sequence[int | None] | None) -> None:
    if expected is None:
        return
    fits = len(found) == len(expected) and all(
        e is None or e == f for e, f in zip(expected, found, strict=True)
    )
    if not fits:
        words = ", ".join("any" if e is None else str(e) for e in expected)
        raise InputError(f"{name}: expected shape ({words}), got {found}")
