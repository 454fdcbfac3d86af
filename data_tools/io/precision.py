"""What single precision costs: coordinates far from the origin, as those of maps, come in coarse steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.notes import Note

#: The code of the note of a shape in coarse steps.
COARSE = "coarse-steps"


def fits_single(vertices: FloatArray) -> bool:
    """Return whether single precision moves no point by more than a millionth of the shape's size."""
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    if not len(finite):
        return True
    with np.errstate(over="ignore"):
        moved = np.abs(finite.astype(np.float32) - finite).max()
    return bool(moved <= 1e-6 * np.ptp(finite, axis=0).max())


def coarse_note(vertices: FloatArray) -> tuple[Note, ...]:
    """Return a note where coordinates are in single precision, in steps above a thousandth of the shape's size.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
        Finite.

    Returns
    -------
    tuple of Note
        One with the step and its share of the size, or none.
    """
    with np.errstate(all="ignore"):  # of what is beyond single precision
        is_single = (vertices.astype(np.float32) == vertices).all(axis=0)
        steps = np.where(
            is_single, np.spacing(np.abs(vertices).max(axis=0).astype(np.float32)), 0.0
        )
    step, size = float(steps.max()), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if not step > 1e-3 * size:
        return ()
    return (Note(COARSE, values={"step": step, "share": step / size}),)


def coarse_coordinates(notes: Mapping[str, Sequence[Note]]) -> tuple[Note, ...]:
    """Return the note that names the shapes of a collection in coarse steps; none if there are none.

    Parameters
    ----------
    notes : mapping of str to sequence of Note
        The notes of each shape by its name.
    """
    found = {
        name: one.values["step"] for name, own in notes.items() for one in own if one.code == COARSE
    }
    steps = tuple(float(step) for step in found.values() if not isinstance(step, tuple))
    return (Note("coarse-coordinates", tuple(found), {"steps": steps}),) if found else ()
