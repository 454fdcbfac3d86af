"""Decisions made by hand in the report, read back as hard constraints for synchronization."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray, as_rotations, read_only
from data_tools.errors import InputError
from data_tools.io.files import read_text

FORMAT = "collalign-corrections"
VERSION = 1
_KINDS = ("pose", "confirmed")
_ADVICE = "use the report of the same folder, or delete the decisions that do not belong to it"


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """Decisions and the poses that they refer to.

    Attributes
    ----------
    decisions : dict of str to ndarray, shape (3, 3)
        ``R_common_shape`` of the shapes decided on, in the result that was looked at, whether chosen or confirmed.
    frame : dict of str to ndarray, shape (3, 3)
        ``R_common_shape`` of the certain shapes among which the decisions place the others, in the result that was
        looked at.
    source : str
        The file, for messages.
    """

    decisions: dict[str, FloatArray]
    frame: dict[str, FloatArray]
    source: str = "corrections"

    def fixed(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Poses that synchronization must keep, for :func:`collalign.align_collection`.

        Poses mean something only relative to each other: a single fixed shape would choose the common frame and
        change nothing. So the certain shapes stay where they were seen, and the doubtful ones may follow.

        Parameters
        ----------
        names : sequence of str
            Shapes of the collection to be synchronized again.

        Returns
        -------
        dict of str to ndarray, shape (3, 3)
            ``R_common_shape`` by name; empty if nothing was decided.

        Raises
        ------
        InputError
            If a shape decided on is not in the collection, or none of the certain ones is.
        """
        for shape in self.decisions:
            if shape not in names:
                raise InputError(f"{self.source}: {shape!r} is no shape of this collection; {_ADVICE}")
        if not self.decisions:
            return {}
        kept = {name: R for name, R in self.frame.items() if name in names}
        if self.frame and not kept:
            raise InputError(f"{self.source}: none of the shapes that it refers to is in this collection; {_ADVICE}")
        return kept | self.decisions


def fixed_by(files: Sequence[Corrections], names: Sequence[str]) -> dict[str, FloatArray]:
    """Return :meth:`Corrections.fixed` of several files about one result, as the pages of a large report give them.

    Raises
    ------
    InputError
        Also if two files decide about one shape.
    """
    fixed: dict[str, FloatArray] = {}
    decided: dict[str, FloatArray] = {}
    for one in files:
        fixed |= one.fixed(names)
        if both := sorted(one.decisions.keys() & decided.keys()):
            raise InputError(f"{one.source}: another file decides about {both[0]!r} as well; keep one")
        decided |= one.decisions
    return fixed | decided


def read_corrections(path: Path | str) -> Corrections:
    """Read the file that the report's "Download decisions" wrote.

    Raises
    ------
    InputError
        If the file is not such a file, decides twice about a shape, or holds a matrix that is no rotation.
    """
    source = Path(path)
    try:
        record = json.loads(read_text(source))
    except (ValueError, RecursionError) as error:
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
    decisions: dict[str, FloatArray] = {}
    for at, entry in enumerate(entries, start=1):
        shape, rotation = _decision(entry, f"{source}, decision {at}")
        if shape in decisions:
            raise InputError(f"{source}: two decisions about {shape!r}; keep one")
        decisions[shape] = rotation
    poses = {str(name): _rotation(matrix, f"{source}, frame of {name!r}") for name, matrix in frame.items()}
    return Corrections(decisions=decisions, frame=poses, source=str(source))


def _decision(entry: Any, where: str) -> tuple[str, FloatArray]:
    if not isinstance(entry, dict) or not isinstance(entry.get("shape"), str) or entry.get("decision") not in _KINDS:
        raise InputError(f"{where}: expected 'shape', 'decision' ({' or '.join(_KINDS)}) and 'rotation'")
    return entry["shape"], _rotation(entry.get("rotation"), f"{where} ({entry['shape']})")


def _rotation(matrix: Any, where: str) -> FloatArray:
    try:
        array = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: expected a 3 x 3 matrix of numbers") from None
    if array.shape != (3, 3):
        raise InputError(f"{where}: expected a 3 x 3 matrix, got shape {array.shape}")
    return read_only(as_rotations(array, where))
