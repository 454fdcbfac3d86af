"""What single precision costs: coordinates far from the origin, as those of maps, come in coarse steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from data_tools.arrays import FloatArray

#: Begins the note of a shape in coarse steps.
COARSE = "coordinates in steps of "


def fits_single(vertices: FloatArray) -> bool:
    """Whether single precision moves no point by more than a millionth of the shape's size."""
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    if not len(finite):
        return True
    with np.errstate(over="ignore"):
        moved = np.abs(finite.astype(np.float32) - finite).max()
    return bool(moved <= 1e-6 * np.ptp(finite, axis=0).max())


def coarse_note(vertices: FloatArray) -> tuple[str, ...]:
    """Return a note where coordinates are in single precision, in steps above a thousandth of the shape's size.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
        Finite.

    Returns
    -------
    tuple of str
        One sentence with the step and its share of the size, or none.
    """
    with np.errstate(all="ignore"):  # of what is beyond single precision
        is_single = (vertices.astype(np.float32) == vertices).all(axis=0)
        steps = np.where(is_single, np.spacing(np.abs(vertices).max(axis=0).astype(np.float32)), 0.0)
    step, size = float(steps.max()), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if not step > 1e-3 * size:
        return ()
    return (f"{COARSE}{step:.3g}, {step / size:.1%} of its size: finer detail was lost when it was saved",)


def coarse_sentence(notes: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return the sentence that names shapes in coarse steps, what that costs, and what helps; none if there are none.

    Parameters
    ----------
    notes : mapping of str to sequence of str
        The notes of each shape by its name.
    """
    coarse = [
        f"{name} ({note.removeprefix(COARSE).split(':')[0]})"
        for name, own in notes.items()
        for note in own
        if note.startswith(COARSE)
    ]
    if not coarse:
        return ()
    coarse = coarse[:10] + [f"and {len(coarse) - 10} more"] * (len(coarse) > 10)
    return (
        "Coordinates in coarse steps, since single precision has few digits far from the origin: "
        f"{', '.join(coarse)}. Detail below a step is lost, so poses are less exact or wrong. Shift the originals "
        "close to the origin before they are saved in single precision, or save them in double precision or as text "
        "with all digits.",
    )
