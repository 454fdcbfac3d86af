"""The weights of the confidence, fitted on random sub-collections."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collalign.confidence import pose_model as model
from collalign.products.trust import DOUBT
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.collections.landmarked import COLLECTIONS
from experiments.confidence.draws import measure_run, measure_runs
from experiments.confidence.families import FAMILIES
from experiments.confidence.fit import fit_weights, left_out, training_rows
from experiments.experiment import Cell

NAMES = ("AGREEMENT_WEIGHT", "MARGIN_WEIGHT", "LOCAL_WEIGHT", "LEAD_WEIGHT", "POSE_CONSTANT")
#: Runs of each collection, and their seed: another one than that of the experiment.
NUM_RUNS, NUM_QUICK, SEED = 8, 1, 29


def measure_weights(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the logistic model to evidence and truth of the shapes of random sub-collections."""
    records = measure_runs(
        lambda cells: {
            label: measure_run(Cell(data=data, settings=settings))
            for label, settings in cells.items()
        },
        dict.fromkeys(collections, NUM_QUICK if quick else NUM_RUNS),
        SEED,
    )
    seen, right, kind = training_rows(records)
    weights, constant = fit_weights(seen, right, kind)
    code = [getattr(model, name) for name in NAMES[:-1]], model.POSE_CONSTANT
    stated = [*(1.0 / (1.0 + np.exp(-(seen @ w + c))) for w, c in (code, (weights, constant)))]
    stated.append(left_out(seen, right, kind))
    now, best, without = (float(right[chance >= DOUBT].mean()) for chance in stated)
    values = dict(zip(NAMES, [*weights.tolist(), constant], strict=True))
    return {
        name: Finding(value=value, now=now, best=best, left_out=without)
        for name, value in values.items()
    }


CALIBRATION = Calibration(
    module=model.__name__,
    constants=constants_of(model, *NAMES),
    measure=measure_weights,
    collections=(
        *COLLECTIONS,
        *(name for name, family in FAMILIES.items() if not family.symmetric),
    ),
    score=f"share of the shapes at {DOUBT} or more that are right, all weights together",
)
