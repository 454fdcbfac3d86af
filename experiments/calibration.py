"""Where tuned constants come from: ``python -m experiments calibrate NAME`` measures again what they stand for.

A calibration joins :data:`CALIBRATIONS` with the constants of one estimator as the code has them and a function that
measures them on the collections it was given. It prints both side by side and changes nothing: a constant is changed
in its own module, with the line that says where it comes from.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.align import align_collection
from collalign.engine.options import RunOptions
from collalign.options import AlignOptions
from collalign.stages.trust import model as trust_model
from collalign.synchronization.problem import model
from data_tools.errors import OptionsError
from data_tools.rotations import rotation_angle_deg
from experiments.collections.aligning import pose_some
from experiments.collections.landmarked import COLLECTIONS, RIGHT_DEG
from experiments.confidence.families import FAMILIES
from experiments.confidence.fit import measure_weights
from experiments.tables import Column, Table

#: Measures constants by name, from the folder of the public collections and the names of those to be used.
Measure = Callable[[Path, Sequence[str]], Mapping[str, float]]


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The constants of one estimator and how they are measured.

    Attributes
    ----------
    module : str
        Where they are.
    constants : mapping of str to float
        As the code has them.
    measure : callable
        Takes the folder of the collections and the names of some of them, returns the constants' values there.
    collections : tuple of str
        Those that are used by default; classes that are held back for results are not among them.
    """

    module: str
    constants: Mapping[str, float]
    measure: Measure
    collections: tuple[str, ...]


def measure_model(data: Path, collections: Sequence[str], *, num_shapes: int = 16) -> dict[str, float]:
    """Measure the priors of the pairs' likelihood against the true rotations, over all pairs of some shapes.

    A candidate is right within :data:`~experiments.collections.landmarked.RIGHT_DEG` of the truth. The noise per axis
    is the root mean square angle of the right candidates over the square root of three.
    """
    angles_rad, num_pairs, num_best, num_others = [], 0, 0, 0
    for collection in collections:
        with tempfile.TemporaryDirectory() as name:
            settings: dict[str, Any] = {"collection": collection, "shapes": num_shapes, "seed": 0}
            posed, group = pose_some(settings, data, Path(name))
            options = AlignOptions(group="O" if group == "O" else "SO", refine=False)
            aligned = align_collection(name, options=options, run=RunOptions(jobs=1))
        at = [posed.names.index(shape) for shape in aligned.names]
        for pair in aligned.pairs:
            truth = posed.relative[at[pair.target], at[pair.source]]
            errors = np.nan_to_num(rotation_angle_deg(pair.rotations[:, :3, :3], truth), nan=180.0)
            right = int(np.argmin(errors))
            num_pairs += 1
            if errors[right] > RIGHT_DEG:
                continue
            angles_rad.append(np.deg2rad(errors[right]))
            if len(errors) > 1:
                num_best, num_others = num_best + (right == 0), num_others + (right > 0)
    return {
        "PRIOR_NOISE_RAD": float(np.sqrt(np.mean(np.square(angles_rad)) / 3.0)),
        "PRIOR_OUTLIERS": 1.0 - len(angles_rad) / num_pairs,
        "PRIOR_LOG_ODDS": float(np.log((num_best + 1) / (num_others + 1))),
    }


CALIBRATIONS = {
    "model": Calibration(
        module="collalign.synchronization.problem.model",
        constants={
            "PRIOR_NOISE_RAD": model.PRIOR_NOISE_RAD,
            "PRIOR_OUTLIERS": model.PRIOR_OUTLIERS,
            "PRIOR_LOG_ODDS": model.PRIOR_LOG_ODDS,
        },
        measure=measure_model,
        collections=("teeth", "glasses", "ant"),
    ),
    "confidence": Calibration(
        module="collalign.stages.trust.model",
        constants={
            "AGREEMENT_WEIGHT": trust_model.AGREEMENT_WEIGHT,
            "MARGIN_WEIGHT": trust_model.MARGIN_WEIGHT,
            "CONSTANT": trust_model.CONSTANT,
        },
        measure=measure_weights,
        collections=(*COLLECTIONS, *(name for name, family in FAMILIES.items() if not family.symmetric)),
    ),
}


def calibrate(name: str, data: Path, collections: Sequence[str] = ()) -> Table:
    """Return the constants of an estimator as the code has them and as they are measured now.

    Parameters
    ----------
    name : str
        One of :data:`CALIBRATIONS`.
    data : Path
        Folder of the public collections.
    collections : sequence of str
        Which of them; the estimator's own by default.

    Raises
    ------
    OptionsError
        If there is no such calibration.
    """
    if name not in CALIBRATIONS:
        raise OptionsError(f"no calibration is called {name!r}; there are {', '.join(CALIBRATIONS)}")
    found = CALIBRATIONS[name]
    used = tuple(collections) or found.collections
    measured = found.measure(data, used)
    return Table(
        caption=f"Constants of {found.module}, measured on {', '.join(used)}.",
        columns=(
            Column(key="constant", title="constant"),
            Column(key="code", title="in the code", format=".4g"),
            Column(key="measured", title="measured", format=".4g"),
        ),
        rows=tuple(
            {"constant": constant, "code": value, "measured": measured[constant]}
            for constant, value in found.constants.items()
        ),
    )
