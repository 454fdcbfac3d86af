"""Decisions made by hand in the report, read back as hard constraints for synchronization."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from data_tools.arrays import FloatArray, IntArray, as_rotations, read_only
from data_tools.errors import InputError

FORMAT = "collalign-corrections"
VERSION = 1
_KINDS = ("pose", "confirmed")


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """One decision.

    Attributes
    ----------
    shape : str
    kind : {"pose", "confirmed"}
        Whether another pose was chosen or the present one called right.
    R_common_shape : ndarray, shape (3, 3)
        The right pose, in the common frame of the result in which it was decided.
    """

    shape: str
    kind: Literal["pose", "confirmed"]
    R_common_shape: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """Decisions and the frame that they refer to.

    Attributes
    ----------
    decisions : tuple of Decision
    frame : dict of str to ndarray, shape (3, 3)
        Rotation of every shape in the result that was looked at. A decision only means something relative to it.
    source : str
        The file, for messages.
    """

    decisions: tuple[Decision, ...]
    frame: dict[str, FloatArray]
    source: str = "corrections"

    def fixed(self, names: Sequence[str]) -> tuple[IntArray, FloatArray]:
        """Decided shapes and their rotations, all in the frame of the result that was looked at.

        Parameters
        ----------
        names : sequence of str
            Shapes of the collection to be synchronized again.

        Returns
        -------
        indices : ndarray of int, shape (m,)
        rotations : ndarray, shape (m, 3, 3)

        Raises
        ------
        InputError
            If a decided shape is not in the collection.
        """
        place = {name: at for at, name in enumerate(names)}
        for decision in self.decisions:
            if decision.shape not in place:
                raise InputError(
                    f"{self.source}: {decision.shape!r} is no shape of this collection; "
                    "use the report of the same folder, or delete this decision from the file"
                )
        indices = np.array([place[decision.shape] for decision in self.decisions], dtype=np.int64)
        rotations = np.array([decision.R_common_shape for decision in self.decisions]).reshape(-1, 3, 3)
        return read_only(indices), read_only(rotations)

    def constraints(self, names: Sequence[str]) -> tuple[IntArray, FloatArray]:
        """Relative rotations that the decisions demand, whatever gauge the next result has.

        A decided shape a is held against every shape b that the report showed, at its decided pose if there is one
        and at its shown pose otherwise: ``R_a_b = R_common_a.T @ R_common_b``.

        Parameters
        ----------
        names : sequence of str

        Returns
        -------
        edges : ndarray of int, shape (E, 2)
            Rows (a, b); every unordered pair at most once.
        rotations : ndarray, shape (E, 3, 3)
            ``R_a_b``, taking b's coordinates to a's.

        Raises
        ------
        InputError
            If a decided shape is not in the collection.
        """
        indices, rotations = self.fixed(names)
        pose = {at: self.frame[name] for at, name in enumerate(names) if name in self.frame}
        decided = dict(zip(indices.tolist(), rotations, strict=True))
        pose |= decided
        edges = [(a, b) for a in sorted(decided) for b in sorted(pose) if b != a and not (b in decided and b < a)]
        relative = np.array([pose[a].T @ pose[b] for a, b in edges]).reshape(-1, 3, 3)
        return read_only(np.array(edges, dtype=np.int64).reshape(-1, 2)), read_only(relative)


def read_corrections(path: Path | str) -> Corrections:
    """Read the file that the report's "Download decisions" wrote.

    Raises
    ------
    InputError
        If the file is not such a file, decides twice about a shape, or holds a matrix that is no rotation.
    """
    source = Path(path)
    try:
        record = json.loads(source.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(
            f"{source}: cannot be read as JSON ({error}); download the decisions from the report again"
        ) from error
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"{source}: not a file of decisions; it is the one that report.html offers for download")
    if record.get("version") != VERSION:
        raise InputError(f"{source}: decisions of version {record.get('version')}, this program reads {VERSION}")
    entries, frame = record.get("decisions"), record.get("frame")
    if not isinstance(entries, list) or not isinstance(frame, dict):
        raise InputError(f"{source}: 'decisions' must be a list and 'frame' an object; download them again")
    decisions = tuple(_decision(entry, f"{source}, decision {at}") for at, entry in enumerate(entries, start=1))
    names = [decision.shape for decision in decisions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{source}: two decisions about {twice[0]!r}; keep one")
    poses = {str(name): _rotation(matrix, f"{source}, frame of {name!r}") for name, matrix in frame.items()}
    missing = [name for name in names if name not in poses]
    if missing:
        raise InputError(f"{source}: the frame lacks {missing[0]!r}, about which it decides; download the file again")
    return Corrections(decisions=decisions, frame=poses, source=str(source))


def _decision(entry: Any, where: str) -> Decision:
    if not isinstance(entry, dict) or not isinstance(entry.get("shape"), str) or entry.get("decision") not in _KINDS:
        raise InputError(f"{where}: expected 'shape', 'decision' ({' or '.join(_KINDS)}) and 'rotation'")
    matrix = _rotation(entry.get("rotation"), f"{where} ({entry['shape']})")
    return Decision(shape=entry["shape"], kind=entry["decision"], R_common_shape=matrix)


def _rotation(matrix: Any, where: str) -> FloatArray:
    try:
        array = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where}: expected a 3 x 3 matrix of numbers") from None
    if array.shape != (3, 3):
        raise InputError(f"{where}: expected a 3 x 3 matrix, got shape {array.shape}")
    return read_only(as_rotations(array, where))
