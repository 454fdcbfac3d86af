"""Where tuned constants come from: ``python -m experiments calibrate NAME`` measures again what they stand for.

A calibration joins :data:`CALIBRATIONS` with the constants of one estimator as the code has them and a function that
measures them on the collections it was given: it fits them, or tries other values of each. It prints both side by
side and changes nothing: a constant is changed in its own module, with the line that says where it comes from.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data_tools.errors import OptionsError
from experiments.calibration import (
    confidence,
    evidence,
    few_radii,
    fragments,
    incomplete,
    kind_parts,
    kinds,
    maps,
    margins,
    model,
    overlaps,
    radii,
    registration,
    sides,
    wholes,
)
from experiments.calibration.scan import Constant
from experiments.tables import Column, Table

CALIBRATIONS = {
    "confidence": confidence.CALIBRATION,
    "ellipsoids": few_radii.OF_ELLIPSOIDS,
    "evidence": evidence.CALIBRATION,
    "few_radii": few_radii.CALIBRATION,
    "fragments": fragments.CALIBRATION,
    "incomplete": incomplete.CALIBRATION,
    "kind_parts": kind_parts.CALIBRATION,
    "kinds": kinds.CALIBRATION,
    "maps": maps.CALIBRATION,
    "margins": margins.CALIBRATION,
    "model": model.CALIBRATION,
    "overlaps": overlaps.CALIBRATION,
    "radii": radii.CALIBRATION,
    "registration": registration.CALIBRATION,
    "sides": sides.CALIBRATION,
    "wholes": wholes.CALIBRATION,
}


def calibrate(
    name: str, data: Path, collections: Sequence[str] = (), *, quick: bool = False
) -> Table:
    """Return the constants of an estimator as the code has them and as they are measured now.

    Parameters
    ----------
    name : str
        One of :data:`CALIBRATIONS`.
    data : Path
        Folder of the public collections.
    collections : sequence of str
        Which of them; the estimator's own by default.
    quick : bool
        The smallest sizes only, to see that everything works.

    Raises
    ------
    OptionsError
        If there is no such calibration.
    """
    if name not in CALIBRATIONS:
        raise OptionsError(
            f"no calibration is called {name!r}; there are {', '.join(CALIBRATIONS)}"
        )
    found = CALIBRATIONS[name]
    used = tuple(collections) or found.collections
    measured = found.measure(data, used, quick)
    scored = f" Scores: {found.score}." if found.score else ""
    return Table(
        caption=f"Constants of {found.module}, measured on {', '.join(used)}.{scored}",
        columns=(
            Column(key="constant", title="constant"),
            Column(key="code", title="in the code"),
            Column(key="measured", title="measured"),
            Column(key="now", title="score of the code", format=".4f"),
            Column(key="best", title="score of the measured", format=".4f"),
            Column(key="left_out", title="of what the other collections measure", format=".4f"),
        ),
        rows=tuple(
            {
                "constant": constant,
                "code": _words(value),
                "measured": _words(measured[constant].value),
                "now": measured[constant].now,
                "best": measured[constant].best,
                "left_out": measured[constant].left_out,
            }
            for constant, value in found.constants.items()
        ),
    )


def _words(value: Constant) -> str:
    return ", ".join(f"{one:.4g}" for one in value) if isinstance(value, tuple) else f"{value:.4g}"
