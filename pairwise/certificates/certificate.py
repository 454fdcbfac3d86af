"""Certificates: the dual variables of a relaxation and the problem they are about, saved without pickle."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_tools.arrays import BoolArray, FloatArray, IntArray, as_points, read_only
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.files import open_regular
from pairwise.problem import Problem, num_left_over
from pairwise.rotation_pattern import RotationPattern

#: Numbers beyond this, in the problem's own unit, are refused: their products would overflow.
LARGEST_VALUE = 1e100


def in_unit(values: FloatArray, exponent: int, name: str) -> FloatArray:
    """Return ``values / 2 ** exponent``, shape (...); what becomes smaller than the smallest number vanishes.

    Raises
    ------
    InputError
        If a value exceeds ``LARGEST_VALUE`` then.
    """
    with np.errstate(over="ignore", under="ignore"):
        scaled = np.ldexp(values, -exponent)
    if not np.abs(scaled).max(initial=0.0) <= LARGEST_VALUE:
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

    def __init__(
        self, arrays: Mapping[str, Any], exponent: int | None = None, known: Sequence[str] = ()
    ) -> None:
        if not isinstance(arrays, Mapping):
            raise InputError("certificate: its arrays are not a mapping of names to arrays")
        self._arrays, self._exponent = arrays, exponent
        self._unread = set(arrays) - set(known)

    def __contains__(self, name: str) -> bool:
        return name in self._arrays

    def floats(self, name: str, shape: Sequence[int | None]) -> FloatArray:
        """Return a float64 copy of shape ``shape`` in the problem's unit; ``None`` in it stands for any length.

        Raises
        ------
        InputError
            If the array is missing, of another shape, no floating-point array, not finite or too large.
        """
        values = np.array(self._take(name, shape, "f"), dtype=np.float64, order="C")
        if not np.isfinite(values).all():
            raise InputError(f"certificate: {name} contains values that are not finite")
        return (
            values
            if self._exponent is None
            else in_unit(values, self._exponent, f"certificate: {name}")
        )

    def bools(self, name: str, shape: Sequence[int | None]) -> BoolArray:
        """Return a copy of a boolean array of shape ``shape``; raises as :meth:`floats`."""
        return np.array(self._take(name, shape, "b"), dtype=np.bool_, order="C")

    def indices(
        self, name: str, shape: Sequence[int | None], upper: Sequence[int] | int
    ) -> IntArray:
        """Return an int64 copy, of shape ``shape``, of integers in [0, upper); raises as :meth:`floats`."""
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
            raise InputError(
                f"certificate: {name} has the wrong type, {getattr(values, 'dtype', type(values))}"
            )
        fits = len(values.shape) == len(shape)
        if not fits or any(
            e is not None and e != f for e, f in zip(shape, values.shape, strict=True)
        ):
            words = ", ".join("any" if e is None else str(e) for e in shape)
            raise InputError(f"certificate: {name} has shape {values.shape}, expected ({words})")
        self._unread.discard(name)
        return values


#: Constant costs are computed from invariants, which another processor rounds in another way: relative difference.
_COST_TOL = 1e-12


def read_problem(target: ArrayLike, source: ArrayLike, certificate: Certificate) -> Problem:
    """Return the problem that a certificate says it is of, for points of shape (n, d) and (k, d).

    Allowed matches, weights, constant costs, pattern and group are the certificate's own words: look at them
    before you believe a bound that was not checked against a problem of yours.

    Raises
    ------
    InputError
        If an array is missing or malformed, if together they make no problem, or if it is not the problem whose hash
        the certificate bears.
    """
    problem = build_problem(
        as_points(target, "target"), as_points(source, "source"), certificate.arrays
    )
    if (
        not isinstance(certificate.problem_hash, str)
        or hash_problem(problem) != certificate.problem_hash
    ):
        raise InputError(
            "certificate: is for another problem (the hash of points and options differs)"
        )
    return problem


def build_problem(q: FloatArray, p: FloatArray, arrays: Mapping[str, Any]) -> Problem:
    """Build the problem of points (n, d) and (k, d) and of a certificate's arrays, once they fit each other."""
    (n, d), k = q.shape, len(p)
    if k > n or p.shape[1] != d:
        raise InputError(
            f"target and source: {q.shape} and {p.shape} points make no problem (k <= n, one dimension)"
        )
    given = CertificateArrays(arrays)
    weights = given.floats("weights", (k,))
    if (weights < 0).any() or not (weights > 0).any():
        raise InputError("certificate: weights must not be negative, nor all zero")
    pattern = given.bools("pattern", (d, d))
    blocks = given.indices("special_blocks", (None, 2), upper=d + 1)
    _check_blocks(pattern, blocks)
    problem = Problem(
        target=q,
        source=p,
        pattern=RotationPattern(pattern, tuple((int(a), int(b)) for a, b in blocks)),
        allowed=given.bools("candidates", (n, k)),
        weights=weights,
        constant_cost=given.floats("constant_cost", (n, k)),
    )
    if num_left_over(problem.allowed):
        raise InputError("certificate: no injective map fits the matches that it allows")
    return problem


def cost_deviation(stated: Problem, found: Problem) -> float:
    """Return how much the energies of two problems may differ, once it is sure that they are the same.

    Raises
    ------
    InputError
        If they differ in anything but the rounding of constant costs.
    """
    ours, theirs = (
        {**problem_arrays(p), "target": p.target, "source": p.source} for p in (stated, found)
    )
    other = [name for name in sorted({*ours, *theirs}) if name not in ours or name not in theirs]
    other += [
        n
        for n in ours
        if n in theirs and n != "constant_cost" and not np.array_equal(ours[n], theirs[n])
    ]
    ours_cost, theirs_cost = stated.constant_cost, found.constant_cost
    if ours_cost.shape != theirs_cost.shape or not np.allclose(
        ours_cost, theirs_cost, rtol=_COST_TOL, atol=0.0
    ):
        other.append("constant_cost")
    if other:
        raise InputError(
            f"certificate: is for another problem than yours, which differs in {', '.join(other)}"
        )
    return float(np.abs(ours_cost - theirs_cost).max(axis=0).sum())


def _check_blocks(pattern: BoolArray, blocks: IntArray) -> None:
    """Refuse rotation blocks that are empty, overlap, or are not separate, and patterns of singular matrices."""
    taken = np.zeros(len(pattern), dtype=bool)
    for start, stop in blocks:
        inside = np.zeros(len(pattern), dtype=bool)
        inside[start:stop] = True
        if (
            stop - start < 2
            or (taken & inside).any()
            or (pattern & (inside[:, None] != inside)).any()
        ):
            raise InputError(
                f"certificate: special_blocks has [{start}, {stop}], which is no block of the pattern"
            )
        taken |= inside
    if num_left_over(pattern):
        raise InputError("certificate: every matrix with its pattern is singular")


#: Written into every file; a file of another version is refused.
FORMAT = "collalign certificate 1"

#: The problem's arrays within ``Certificate.arrays``, in the order in which they are hashed; ``candidates`` are the
#: matches that are allowed.
PROBLEM_ARRAYS = ("candidates", "weights", "constant_cost", "pattern", "special_blocks")

#: Bytes of a file; a larger one is refused before it is read.
MAX_BYTES = 2**28


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """Dual variables of a relaxation, which prove a lower bound of the matching energy to anybody.

    Attributes
    ----------
    kind : str
        What kind of proof the arrays are: the name of a verifier of :mod:`pairwise.certificates.verify`.
    arrays : dict of str to ndarray
        The dual variables, and the pattern, group, weights, allowed matches and constant costs they are for.
    problem_hash : str
        SHA-256 of the problem's arrays, so that a certificate of another problem is refused.
    bound : float
        The lower bound that the solver claims; the verifier recomputes its own.
    """

    kind: str
    arrays: dict[str, NDArray[Any]]
    problem_hash: str
    bound: float

    def save(self, path: str | PathLike[str]) -> None:
        """Write the certificate as an npz archive without pickled objects.

        Parameters
        ----------
        path : path
            Its directory must exist. NumPy appends ``.npz`` where it is missing.
        """
        header: dict[str, Any] = {
            "format": FORMAT,
            "kind": self.kind,
            "problem_hash": self.problem_hash,
            "bound": self.bound,
        }
        header |= {f"array_{name}": values for name, values in self.arrays.items()}
        np.savez(path, allow_pickle=False, **header)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Certificate:
        """Read a certificate; its numbers are checked by :func:`pairwise.verify_certificate`, not here.

        Raises
        ------
        InputError
            If the file is missing, damaged, or not a certificate.
        """
        with open_regular(Path(path), MAX_BYTES) as file:
            content = load_arrays(file.read(), str(path))
        if str(content.get("format")) != FORMAT:
            raise InputError(
                f"{path}: not a certificate of this version, expected the entry format = {FORMAT!r}"
            )
        missing = {"kind", "problem_hash", "bound"} - content.keys()
        if missing or content["bound"].shape != () or content["bound"].dtype.kind != "f":
            raise InputError(
                f"{path}: damaged certificate, missing or malformed entries {sorted(missing) or 'bound'}"
            )
        arrays = {
            name[6:]: read_only(values)
            for name, values in content.items()
            if name.startswith("array_")
        }
        return cls(
            kind=str(content["kind"]),
            arrays=arrays,
            problem_hash=str(content["problem_hash"]),
            bound=float(content["bound"]),
        )


def problem_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """Return the part of a problem that travels in its certificates: all but the points.

    Returns
    -------
    dict of str to ndarray
        ``candidates`` and ``constant_cost`` (n, k), ``weights`` (k,), ``pattern`` (d, d), ``special_blocks``
        (b, 2), and numbers of shape ().
    """
    arrays: dict[str, NDArray[Any]] = {
        "candidates": problem.allowed,
        "weights": problem.weights,
        "constant_cost": problem.constant_cost,
        "pattern": problem.pattern.mask,
        "special_blocks": np.array(problem.pattern.special_blocks, dtype=np.int64).reshape(-1, 2),
    }
    return arrays


def hash_problem(problem: Problem) -> str:
    """Return the SHA-256 of a problem's points and other arrays, with shapes and types."""
    digest = hashlib.sha256()
    named = {"target": problem.target, "source": problem.source, **problem_arrays(problem)}
    for name, values in named.items():
        little_endian = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        digest.update(f"{name} {values.dtype.kind}{values.dtype.itemsize} {values.shape};".encode())
        digest.update(little_endian.tobytes())
    return digest.hexdigest()
