"""Which way of the common frame is up, and which its front."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from collalign.options import FRAME_AXES, AlignOptions
from data_tools.arrays import ORTHOGONAL_TOL, FloatArray, read_only
from data_tools.errors import InputError


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedFrame:
    """What a user calls up and front, in the common frame.

    Attributes
    ----------
    up, front : str
        An axis of the common frame (``"z"``, ``"-y"``); empty where nobody said.
    """

    up: str = ""
    front: str = ""

    @classmethod
    def of(cls, options: AlignOptions) -> NamedFrame:
        """Return the names that a result has: axes stay, and landmarks are turned to z and x."""
        if not options.turns_frame:
            return cls(up=options.up, front=options.front)
        return cls(up="z", front="x" if options.front else "")

    @property
    def directions(self) -> tuple[FloatArray | None, FloatArray | None]:
        """Unit vectors (3,) upwards and to the front, None where nobody said."""
        up, front = (np.array(FRAME_AXES[name]) if name else None for name in (self.up, self.front))
        return up, front


def frame_turn(options: AlignOptions, marks: Mapping[str, FloatArray]) -> FloatArray:
    """Return the rotation from the reference's file to a frame with z up and x to the front.

    Parameters
    ----------
    options : AlignOptions
        Its ``up`` or ``front`` names landmarks. What is to the front is made perpendicular to what is up.
    marks : mapping of str to ndarray, shape (3,)
        Landmarks of the reference, in the coordinates of its file.

    Returns
    -------
    ndarray, shape (3, 3)

    Raises
    ------
    InputError
        If there is no such landmark, or up and front are one direction.
    """
    up = _direction("up", options.up, marks)
    front = _direction("front", options.front, marks) if options.front else np.eye(3)[np.abs(up).argmin()]
    front = front - (front @ up) * up
    if np.linalg.norm(front) < ORTHOGONAL_TOL:
        raise InputError(f"front: {options.front!r} and up, {options.up!r}, are the same direction; choose another")
    front /= np.linalg.norm(front)
    return read_only(np.stack([front, np.cross(up, front), up]))


def landmark_of(option: str, label: str, marks: Mapping[str, FloatArray]) -> FloatArray:
    """Return a landmark of the reference that an option names, shape (3,).

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if label not in marks:
        told = f"it has {', '.join(marks)}" if marks else "none are given; give its landmark file with --marks"
        raise InputError(f"{option}: the reference has no landmark {label!r}; {told}")
    return marks[label]


def _direction(option: str, text: str, marks: Mapping[str, FloatArray]) -> FloatArray:
    if text in FRAME_AXES:
        return np.array(FRAME_AXES[text])
    start, end = (landmark_of(option, label, marks) for label in text.split(":"))
    if not (length := np.linalg.norm(end - start)):
        raise InputError(f"{option}: the landmarks of {text!r} are at the same place; choose others")
    return np.asarray((end - start) / length)
