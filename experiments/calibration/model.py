"""The priors of the pairs' likelihood, against the true rotations of public collections."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collalign.align import align_collection
from collalign.engine.run_options import RunOptions
from collalign.options import AlignOptions
from collalign.synchronization import model
from data_tools.rotations import rotation_angle_deg
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.collections.aligning import pose_some
from experiments.collections.landmarked import RIGHT_DEG

#: Shapes of each collection, all pairs of which are matched.
NUM_SHAPES, NUM_QUICK = 16, 4


def measure_model(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Measure the priors of the pairs' likelihood against the true rotations, over all pairs of some shapes.

    A candidate is right within :data:`~experiments.collections.landmarked.RIGHT_DEG` of the truth. The noise per axis
    is the root mean square angle of the right candidates over the square root of three.
    """
    angles_rad, num_pairs, num_best, num_others = [], 0, 0, 0
    num = NUM_QUICK if quick else NUM_SHAPES
    for collection in collections:
        with tempfile.TemporaryDirectory() as name:
            settings: dict[str, Any] = {"collection": collection, "shapes": num, "seed": 0}
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
    found = {
        "noise_rad": float(np.sqrt(np.mean(np.square(angles_rad)) / 3.0)),
        "outliers": 1.0 - len(angles_rad) / num_pairs,
        "log_odds": float(np.log((num_best + 1) / (num_others + 1))),
    }
    return {name: Finding(value=value) for name, value in found.items()}


CALIBRATION = Calibration(
    module=model.__name__,
    constants=constants_of(model.PRIORS, "noise_rad", "outliers", "log_odds"),
    measure=measure_model,
    collections=("teeth", "glasses", "ant"),
)
