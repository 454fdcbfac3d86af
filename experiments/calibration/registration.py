"""How surfaces are registered, by how well landmarks are carried from their own poses."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.registration import register
from collalign.registration.surface import TUNED, RegistrationSurface
from data_tools.arrays import FloatArray
from data_tools.poses import fitting_similarity, moved_by
from data_tools.surface.closest import SurfaceLocator
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.collections.landmarked import read_dataset

#: Specimens of each collection, drawn at random; each is registered to the next.
NUM_SHAPES, NUM_QUICK = 4, 2
SEED = 5
_CONSTANTS = (
    "widths",
    "amplitudes",
    "noise",
    "normal_noise",
    "tangential",
    "cutoff",
    "num_independent",
)
_OF_POSE = ("pose_noise", "pose_cutoff")


@dataclass(frozen=True, kw_only=True, eq=False)
class LandmarkedPair:
    """A source at its landmarks' pose on a target, where its landmarks are on it, and where they should go."""

    target: RegistrationSurface
    source: RegistrationSurface
    landmarks: FloatArray
    goals: FloatArray

    def error(self) -> float:
        """Return the mean distance of carried landmarks from their goals, in the target's radii."""
        places = SurfaceLocator(self.source.vertices, self.source.faces).closest(self.landmarks)
        found, _ = register.register(self.target, self.source)
        return float(
            np.linalg.norm(places.on(found.vertices) - self.goals, axis=1).mean()
            / self.target.radius
        )


def draw_pairs(data: Path, collection: str, quick: bool) -> list[LandmarkedPair]:
    """Pose each of some specimens on the next one by their landmarks."""
    dataset = read_dataset(collection, data)
    assert dataset.landmarks is not None  # the collections here have some
    eligible = (
        np.arange(len(dataset))
        if dataset.chirality is None
        else np.flatnonzero(dataset.chirality == 1)
    )
    chosen = (
        np.random.default_rng(SEED)
        .permutation(eligible)[: NUM_QUICK if quick else NUM_SHAPES]
        .tolist()
    )
    surfaces = [RegistrationSurface.from_shape(dataset.shape(which)) for which in chosen]
    pairs = []
    for at, (target, source) in enumerate(itertools.pairwise(surfaces)):
        goals, marks = dataset.landmarks[chosen[at]], dataset.landmarks[chosen[at + 1]]
        known = np.isfinite(goals).all(axis=1) & np.isfinite(marks).all(axis=1)
        goals, marks = goals[known], marks[known]
        pose = fitting_similarity(goals, marks, np.ones(len(goals)))
        pairs.append(
            LandmarkedPair(
                target=target,
                source=source.placed(pose),
                landmarks=moved_by(pose, marks),
                goals=goals,
            )
        )
    return pairs


def measure_registration(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Carry landmarks with other values."""
    drawn = {collection: draw_pairs(data, collection, quick) for collection in collections}

    def score(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(register, {"TUNED": TUNED._replace(**dict[str, Any](changed))}):
            return -float(np.mean([pair.error() for pair in drawn[collection]]))

    return scan(CALIBRATION.constants, collections, score, quick=quick)


CALIBRATION = Calibration(
    module="collalign.registration",
    constants=constants_of(TUNED, *_CONSTANTS, *_OF_POSE),
    measure=measure_registration,
    collections=("teeth", "mouse skulls"),
    score="mean error of landmarks in root mean square radii, negative",
)
