"""Certificates: the dual variables of a relaxation, saved without pickle and checked by independent code."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from os import PathLike
from os.path import isfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import read_only
from data_tools.errors import InputError
from pairwise.problem.problem import Problem

#: Written into every file; a file of another version is refused.
FORMAT = "collalign certificate 1"

#: The problem's arrays within ``Certificate.arrays``, in the order in which they are hashed; ``candidates`` are the
#: matches that are allowed.
PROBLEM_ARRAYS = ("candidates", "weights", "constant_cost", "pattern", "special_blocks")

#: Bytes of all arrays of a file together; more is refused before it is read.
MAX_BYTES = 2**28
#: How an npz archive begins.
_ZIP_MARK = b"PK"


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
        if not isfile(path):  # a pipe would be waited for
            raise InputError(f"{path}: cannot be read as a certificate (no such file, or not a regular one)")
        try:
            with open(path, "rb") as file:  # a bare array would be read whole, whatever it claims to hold
                if file.read(len(_ZIP_MARK)) != _ZIP_MARK:
                    raise InputError("not an archive")
            with np.load(path, allow_pickle=False) as archive:
                if sum(entry.file_size for entry in archive.zip.infolist()) > MAX_BYTES:
                    raise InputError(f"more than {MAX_BYTES} bytes")
                content = {name: archive[name] for name in archive.files}
        except Exception as error:  # damaged archives fail in every way there is
            raise InputError(f"{path}: cannot be read as a certificate ({error})") from error
        if str(content.get("format")) != FORMAT:
            raise InputError(f"{path}: not a certificate of this version, expected the entry format = {FORMAT!r}")
        missing = {"kind", "problem_hash", "bound"} - content.keys()
        if missing or content["bound"].shape != () or content["bound"].dtype.kind != "f":
            raise InputError(
                f"{path}: damaged certificate, missing or malformed entries {sorted(missing) or 'bound'}"
            )
        arrays = {name[6:]: read_only(values) for name, values in content.items() if name.startswith("array_")}
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
