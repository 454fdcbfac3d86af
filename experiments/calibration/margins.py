"""How much a pose's margin over its best rival is worth, on pairs of which one shape was cut."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from collalign.confidence import overlap_model as certainty
from data_tools.arrays import FloatArray
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.collections.landmarked import RIGHT_DEG, read_dataset
from experiments.pairs.incomplete_sets import margin_of, surface_of
from experiments.pairs.invariants import without_share
from pairwise.partial.match import match_partial

#: Pairs of each collection, among its shapes at even positions, and how much is cut off the source.
NUM_PAIRS, NUM_QUICK, SEED, SHARE = 16, 2, 23, 0.25


def cut_pairs(data: Path, collection: str, num: int) -> FloatArray:
    """Return the margin of each pair's best pose, and whether that is right, shape (m, 2)."""
    dataset, rng = read_dataset(collection, data), np.random.default_rng(SEED)
    eligible = np.arange(len(dataset)) if dataset.chirality is None else np.flatnonzero(dataset.chirality == 1)
    pairs = list(itertools.combinations(eligible[::2].tolist(), 2))
    found = []
    for number in rng.permutation(len(pairs))[:num]:
        i, j = pairs[number]
        turn = random_rotation(rng)
        cut = without_share(dataset.shape(j), rng.standard_normal(3), SHARE)
        source = Shape.from_arrays(cut.vertices @ turn.T, cut.faces, name=cut.name)
        poses = match_partial(surface_of(dataset.shape(i)), surface_of(source))
        error = rotation_angle_deg(poses[0].pose.rotation, dataset.rotation(i, j) @ turn.T)
        found.append([margin_of(poses), float(error <= RIGHT_DEG)])
    return np.array(found)


def measure_margins(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Try other slopes."""
    pairs = {one: cut_pairs(data, one, NUM_QUICK if quick else NUM_PAIRS) for one in collections}

    def score(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(certainty, changed):
            chances = np.array([certainty.certainty(margin) for margin in pairs[collection][:, 0]])
        right = pairs[collection][:, 1] > 0
        return float(np.log(np.where(right, chances, 1.0 - chances)).mean())

    return scan(CALIBRATION.constants, collections, score, quick=quick)


CALIBRATION = Calibration(
    module=certainty.__name__,
    constants=constants_of(certainty, "SLOPE"),
    measure=measure_margins,
    collections=("ant", "fish", "teddy", "human", "glasses", "chair"),
    score=f"mean logarithm of the chance stated of what is so, {SHARE:.0%} cut off one of two shapes",
)
