"""The weights by which poses of a scan on a model are judged: scans of generated models, on these and on others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign.confidence import overlap_model
from collalign.confidence.overlap_model import WHOLE_WEIGHTS, on_whole_evidence
from collalign.tools.match.in_part import NUM_POSES
from collalign.tools.match.on_whole import both_scales
from data_tools.poses import Similarity
from data_tools.surface.shape import Shape
from experiments.calibration.overlaps import JudgedPairs, finding
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.generated.part_scans import is_right, model_of, part_scans
from pairwise.features.on_whole import match_on_whole

#: Kinds of models. Those of other seeds, and of other kinds, are for tests.
KINDS = ("chairs", "hammers", "mugs", "desks", "blobs", "animals", "beds", "sofas")
#: Scans of each model on itself, and on the model of another kind, so many kinds on.
NUM_RIGHT, NUM_WRONG, OTHER = 5, 2, 3


def judged_scans(name: str, other: str, num_right: int, num_wrong: int) -> JudgedPairs:
    """Match scans of a kind of model on it and on another one, and say which poses are right."""
    model, rng = model_of(name), np.random.default_rng([KINDS.index(name), 86])
    evidence, right = [], []
    for whole, num in ((model, num_right), (model_of(other), num_wrong)):
        for scan in part_scans(model, num, rng):
            surfaces = both_scales(whole, Shape.from_arrays(scan.points))
            if surfaces is None:
                continue
            poses = match_on_whole(*surfaces, num_candidates=NUM_POSES, side_known=False)
            placed = Similarity.rigid(poses.rotations, poses.shifts).transform
            right.append([whole is model and is_right(model, pose, scan.pose) for pose in placed])
            evidence.append(on_whole_evidence(poses, WHOLE_WEIGHTS[-1]))
    return JudgedPairs.of_each(evidence, right)


def measure_wholes(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights on scans of all kinds, and judge each kind by those of the others."""
    scans = {
        name: judged_scans(
            name,
            KINDS[(KINDS.index(name) + OTHER) % len(KINDS)],
            *((1, 1) if quick else (NUM_RIGHT, NUM_WRONG)),
        )
        for name in collections
    }
    *now, least = WHOLE_WEIGHTS
    found = finding(np.array(now), scans)
    found = replace(found, value=(*np.ravel(found.value).tolist(), least))
    return {"WHOLE_WEIGHTS": found}


CALIBRATION = Calibration(
    module=overlap_model.__name__,
    constants=constants_of(overlap_model, "WHOLE_WEIGHTS"),
    measure=measure_wholes,
    collections=KINDS,
    score="minus the mean log loss of a scan, each kind of model judged by weights of the others",
)
