"""How large the ellipsoids of landmarks carried from one, two or three templates must be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collalign.confidence import radius_model as radii
from data_tools.arrays import FloatArray
from experiments.calibration.few_radii import QUICK_SETTINGS, SETTINGS, was_carried
from experiments.calibration.scan import Calibration, Finding
from experiments.collections.carrying import measure_few
from experiments.experiment import Cell

#: Specimens; classes whose limbs differ are not among them.
COLLECTIONS = ("teeth", "mouse skulls", "long bones")


def measure_ellipsoids(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Measure how large ellipsoids must be for nine of ten errors of every collection."""
    settings = QUICK_SETTINGS if quick else SETTINGS
    records = [
        measure_few(Cell(data=data, settings={**settings, "dataset": one})) for one in collections
    ]
    return {"ELLIPSOIDS_OF_FEW": fit_ellipsoids([one for one in records if was_carried(one)])}


def fit_ellipsoids(records: Sequence[Mapping[str, Any]]) -> Finding:
    """Return the least factors with which the ellipsoids of every collection hold nine of ten errors.

    Parameters
    ----------
    records : sequence of mapping
        Of :func:`experiments.collections.carrying.measure_few`. Their ``held k`` are errors in parts of the present
        ellipsoids: within those below 1.
    """
    numbers = range(1, radii.MIN_TEMPLATES)
    held = [[np.array(record[f"held {k}"]) for k in numbers] for record in records]
    needed = np.array([[_quantile(one) for one in of] for of in held])
    value = np.array(radii.ELLIPSOIDS_OF_FEW) * needed.max(axis=0)
    others = [np.delete(needed, at, axis=0) for at in range(len(needed))]
    without = [one.max(axis=0) if len(one) else np.full(len(value), np.nan) for one in others]
    return Finding(
        value=tuple(value.tolist()),
        now=_shares(held, np.ones((len(held), len(needed[0])))),
        best=_shares(held, np.repeat(needed.max(axis=0)[None], len(held), axis=0)),
        left_out=_shares(held, np.array(without)),
    )


def _quantile(ratios: FloatArray) -> float:
    return float(np.quantile(ratios[np.isfinite(ratios)], radii.COVERAGE))


def _shares(held: Sequence[Sequence[FloatArray]], factors: FloatArray) -> float:
    """Return the mean share of errors within ellipsoids that are so many times as large."""
    shares = [
        np.mean(ratios[np.isfinite(ratios)] <= factor)
        for of, row in zip(held, factors, strict=True)
        for ratios, factor in zip(of, row, strict=True)
    ]
    return float(np.mean(shares))


CALIBRATION = Calibration(
    module=radii.__name__,
    constants={"ELLIPSOIDS_OF_FEW": radii.ELLIPSOIDS_OF_FEW},
    measure=measure_ellipsoids,
    collections=COLLECTIONS,
    score="share of errors within the ellipsoids, mean of the collections",
)
