"""Decisions made by hand in the report, read back as hard constraints for synchronization."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.options import ALL, AUTO, NEVER
from data_tools.arrays import FloatArray, as_floats, as_rotations, read_only
from data_tools.errors import InputError
from data_tools.io.files import composed, read_text
from data_tools.names import match_names, nearest_names, warn_of_near
from data_tools.poses import Similarity

FORMAT = "collalign-corrections"
VERSION = 2
_KINDS = ("pose", "confirmed")
_ADVICE = "use the report of the same folder, or delete the decisions that do not belong to it"


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """Decisions and the poses that they refer to.

    Attributes
    ----------
    decisions : dict of str to ndarray, shape (3, 3) or (4, 4)
        ``R_common_shape`` of the shapes decided on, in the result that was looked at, whether chosen or confirmed; of
        incomplete ones that were placed as well, the transform from the file to the common frame.
    frame : dict of str to ndarray, shape (3, 3) or (4, 4)
        The same of the certain shapes, which stay; decisions are about the others.
    incomplete : tuple of str
        The shapes that were incomplete in that result.
    source : str
        The file, for messages.
    """

    decisions: dict[str, FloatArray]
    frame: dict[str, FloatArray]
    incomplete: tuple[str, ...] = ()
    source: str = "corrections"


def fixed_by(
    files: Sequence[Corrections], names: Sequence[str], incomplete: str = AUTO
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return the poses that synchronization must keep, ``fixed`` and ``kept`` of :func:`collalign.align_collection`.

    Poses mean something only relative to each other: a single fixed shape would choose the common frame and
    change nothing. So the certain shapes stay where they were seen, complete or not, and the doubtful ones may
    follow.

    Parameters
    ----------
    files : sequence of Corrections
        About one result, as the pages of a large report give them.
    names : sequence of str
        Shapes of the collection to be synchronized again.
    incomplete : str
        ``AlignOptions.incomplete`` of that run.

    Returns
    -------
    fixed, kept : dict of str to ndarray, shape (3, 3) or (4, 4)
        Rotation or transform to the common frame, by name: of the shapes decided on, and of those that stay; empty
        if nothing was decided.

    Raises
    ------
    InputError
        If a shape decided on is not in the collection, or none of the certain ones is; if two files decide about one
        shape, or one about an incomplete shape that ``incomplete`` says is complete.
    """
    asked = () if incomplete == NEVER else [name.strip() for name in incomplete.split(",")]
    named = match_names(asked, names).values()
    kept: dict[str, FloatArray] = {}
    decided: dict[str, FloatArray] = {}
    for one in (_called(one, names) for one in files):
        for shape in one.decisions:
            if shape not in names:
                raise InputError(
                    f"{one.source}: {shape!r} is no shape of this collection{nearest_names(shape, names)}; {_ADVICE}"
                )
            if shape in decided:
                raise InputError(
                    f"{one.source}: another file decides about {shape!r} as well; keep one"
                )
            if shape in one.incomplete and incomplete not in (AUTO, ALL) and shape not in named:
                raise InputError(
                    f"{one.source}: {shape!r} was incomplete there; name it in --incomplete as well"
                )
        frame = {name: pose for name, pose in one.frame.items() if name in names}
        placed = any(len(pose) == 4 for pose in one.decisions.values())
        if (
            one.decisions
            and (one.frame or placed)
            and not any(len(pose) == 4 or not placed for pose in frame.values())
        ):
            raise InputError(
                f"{one.source}: none of the shapes that it refers to is in this collection; {_ADVICE}"
            )
        kept |= frame if one.decisions else {}
        decided |= one.decisions
    return decided, {name: pose for name, pose in kept.items() if name not in decided}


def _called(one: Corrections, names: Sequence[str]) -> Corrections:
    """Return decisions by the names of shapes, where they are by names that nearly agree."""
    found = match_names([*one.decisions, *one.frame, *one.incomplete], names)
    warn_of_near(one.source, found)
    return replace(
        one,
        decisions={found.get(name, name): pose for name, pose in one.decisions.items()},
        frame={found.get(name, name): pose for name, pose in one.frame.items()},
        incomplete=tuple(found.get(name, name) for name in one.incomplete),
    )


def read_corrections(path: Path | str) -> Corrections:
    """Read the file that the report's "Download decisions" wrote.

    Raises
    ------
    InputError
        If the file is not such a file, decides twice about a shape, or holds a matrix that is no rotation.
    """
    source = Path(path)
    try:
        record = json.loads(composed(read_text(source)))
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{source}: cannot be read as JSON ({error}); download the decisions from the report again"
        ) from error
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(
            f"{source}: not a file of decisions; it is the one that report.html offers for download"
        )
    if record.get("version") not in range(1, VERSION + 1):
        raise InputError(
            f"{source}: decisions of version {record.get('version')}, this program reads 1 to {VERSION}"
        )
    entries, frame, incomplete = (
        record.get("decisions"),
        record.get("frame"),
        record.get("incomplete", []),
    )
    if not (isinstance(entries, list) and isinstance(frame, dict) and isinstance(incomplete, list)):
        raise InputError(
            f"{source}: 'decisions' and 'incomplete' must be lists and 'frame' an object; download them again"
        )
    decisions: dict[str, FloatArray] = {}
    for at, entry in enumerate(entries, start=1):
        shape, pose = _decision(entry, f"{source}, decision {at}")
        if shape in decisions:
            raise InputError(f"{source}: two decisions about {shape!r}; keep one")
        if len(pose) == 4 and shape not in incomplete:
            raise InputError(
                f"{source}, decision {at}: {shape!r} has a translation and a scale, but is complete. Delete them: "
                "place and size follow from the rotation. Only the shapes in 'incomplete' have their own"
            )
        decisions[shape] = pose
    poses = {str(name): _pose(one, f"{source}, frame of {name!r}") for name, one in frame.items()}
    return Corrections(
        decisions=decisions, frame=poses, incomplete=tuple(map(str, incomplete)), source=str(source)
    )


def _decision(entry: Any, where: str) -> tuple[str, FloatArray]:
    if (
        not isinstance(entry, dict)
        or not isinstance(entry.get("shape"), str)
        or entry.get("decision") not in _KINDS
    ):
        raise InputError(
            f"{where}: expected 'shape', 'decision' ({' or '.join(_KINDS)}) and 'rotation'"
        )
    return entry["shape"], _pose(entry, f"{where} ({entry['shape']})")


def _pose(entry: Any, where: str) -> FloatArray:
    """Return a rotation (3, 3), or where translation and scale are given as well the transform (4, 4)."""
    if not isinstance(entry, dict):
        return _rotation(entry, where)
    rotation = _rotation(entry.get("rotation"), where)
    if "translation" not in entry and "scale" not in entry:
        return rotation
    shift = _numbers(entry.get("translation"), f"{where}, translation", 3)
    scale = _numbers(entry.get("scale"), f"{where}, scale")
    if not scale > 0:
        raise InputError(f"{where}: scale is {scale}, must be positive")
    return read_only(Similarity(rotation=rotation, scale=scale, shift=shift).transform)


def _rotation(matrix: Any, where: str) -> FloatArray:
    return read_only(as_rotations(_numbers(matrix, where, 3, 3), where))


def _numbers(values: Any, where: str, *shape: int) -> FloatArray:
    try:
        return as_floats(np.asarray(values, dtype=np.float64), where, shape=shape)
    except (TypeError, ValueError, OverflowError):
        expected = f"{' x '.join(map(str, shape))} finite numbers" if shape else "a finite number"
        raise InputError(f"{where}: expected {expected}") from None
