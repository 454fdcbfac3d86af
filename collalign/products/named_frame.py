"""Which way of the common frame is up, and which its front."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collalign.options import FILE_ORIGIN, FRAME_AXES, AlignOptions, numbers_of
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
        """Return the names that a result has: axes stay, and what rotates the frame comes to z and x."""
        if not options.rotates_frame:
            return cls(up=options.up, front=options.front)
        return cls(up="z", front="x" if options.front else "")

    @property
    def directions(self) -> tuple[FloatArray | None, FloatArray | None]:
        """Unit vectors (3,) upwards and to the front, None where nobody said."""
        up, front = (np.array(FRAME_AXES[name]) if name else None for name in (self.up, self.front))
        return up, front


def without_names(options: AlignOptions, marks: Mapping[str, FloatArray]) -> AlignOptions:
    """Return options whose directions and origin are numbers where they were landmarks of the reference.

    Parameters
    ----------
    options : AlignOptions
    marks : mapping of str to ndarray, shape (3,)
        Landmarks of the reference, in the coordinates of its file.

    Raises
    ------
    InputError
        If there is no such landmark, or two are at the same place.
    """
    up, front = (_line(name, getattr(options, name), marks) for name in ("up", "front"))
    origin = options.origin
    if origin not in ("", FILE_ORIGIN) and numbers_of(origin) is None:
        origin = _words(_landmark("origin", origin, marks))
    return replace(options, up=up, front=front, origin=origin)


def frame_rotation(options: AlignOptions) -> FloatArray:
    """Return the rotation from the reference's file to a frame with z up and x to the front, shape (3, 3).

    What is to the front is made perpendicular to what is up.

    Raises
    ------
    InputError
        If up and front are one direction.
    """
    up = _direction(options.up)
    front = _direction(options.front) if options.front else np.eye(3)[np.abs(up).argmin()]
    front = front - (front @ up) * up
    if np.linalg.norm(front) < ORTHOGONAL_TOL:
        raise InputError(
            f"front: {options.front!r} and up, {options.up!r}, are the same direction; choose another"
        )
    front /= np.linalg.norm(front)
    return read_only(np.stack([front, np.cross(up, front), up]))


def frame_origin(options: AlignOptions) -> FloatArray | None:
    """Return the point of the reference's file that is the origin of the common frame, shape (3,), None for none."""
    if not options.origin:
        return None
    return np.zeros(3) if options.origin == FILE_ORIGIN else np.array(numbers_of(options.origin))


def _direction(text: str) -> FloatArray:
    found = np.array(FRAME_AXES.get(text) or numbers_of(text))
    return found / np.linalg.norm(found)


def _line(option: str, text: str, marks: Mapping[str, FloatArray]) -> str:
    if ":" not in text:
        return text
    start, end = (_landmark(option, label, marks) for label in text.split(":"))
    if not np.linalg.norm(end - start):
        raise InputError(
            f"{option}: the landmarks of {text!r} are at the same place; choose others"
        )
    return _words(end - start)


def _landmark(option: str, label: str, marks: Mapping[str, FloatArray]) -> FloatArray:
    if label not in marks:
        hint = (
            f"it has {', '.join(marks)}"
            if marks
            else "none are given; give its landmark file with --marks"
        )
        raise InputError(f"{option}: the reference has no landmark {label!r}; {hint}")
    return marks[label]


def _words(numbers: FloatArray) -> str:
    return ",".join(map(repr, numbers.tolist()))
