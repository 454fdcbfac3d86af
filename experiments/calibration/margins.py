"""How much the energies of rival poses are worth, on pairs of which one shape was cut."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from collalign.confidence import incomplete_model
from data_tools.arrays import FloatArray
from data_tools.embedding.surface_points import spread_points
from data_tools.partial_surface import MOST_POINTS, PartialSurface
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, scan
from experiments.collections.landmarked import RIGHT_DEG, read_dataset
from experiments.pairs.incomplete import without_share
from pairwise.partial_match import match_partial

#: Pairs of each collection, among its shapes at even positions, and how much is cut off the source.
NUM_PAIRS, NUM_QUICK, SEED, SHARE = 16, 2, 23, 0.25


def cut_pairs(data: Path, collection: str, num: int) -> list[tuple[FloatArray, FloatArray, bool]]:
    """Return each pair's rotations, the logarithms of their energies, and whether the best one is right."""
    dataset, rng = read_dataset(collection, data), np.random.default_rng(SEED)
    eligible = (
        np.arange(len(dataset))
        if dataset.chirality is None
        else np.flatnonzero(dataset.chirality == 1)
    )
    pairs = list(itertools.combinations(eligible[::2].tolist(), 2))
    found = []
    for number in rng.permutation(len(pairs))[:num]:
        i, j = pairs[number]
        rotation = random_rotation(rng)
        cut = without_share(dataset.shape(j), rng.standard_normal(3), SHARE)
        source = Shape.from_arrays(cut.vertices @ rotation.T, cut.faces, name=cut.name)
        poses = match_partial(surface_of(dataset.shape(i)), surface_of(source))
        if not poses:  # no energies to judge
            continue
        error = rotation_angle_deg(poses[0].pose.rotation, dataset.rotation(i, j) @ rotation.T)
        rotations = np.stack([one.pose.rotation for one in poses])
        found.append((rotations, np.log([one.energy for one in poses]), bool(error <= RIGHT_DEG)))
    return found


def surface_of(shape: Shape) -> PartialSurface:
    """Return what is matched of a shape."""
    return spread_points(shape, MOST_POINTS)


def measure_margins(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Try other weights."""
    pairs = {one: cut_pairs(data, one, NUM_QUICK if quick else NUM_PAIRS) for one in collections}

    def score(collection: str, changed: Mapping[str, Constant]) -> float:
        weight = float(changed.get("PAIR_WEIGHT", incomplete_model.PAIR_WEIGHT))  # type: ignore[arg-type]
        chances = [
            (incomplete_model.share_of_best(rotations, -weight * logs), right)
            for rotations, logs, right in pairs[collection]
        ]
        return float(
            np.mean([np.log(chance if right else 1.0 - chance) for chance, right in chances])
        )

    return scan(CALIBRATION.constants, collections, score, quick=quick)


CALIBRATION = Calibration(
    module=incomplete_model.__name__,
    constants=constants_of(incomplete_model, "PAIR_WEIGHT"),
    measure=measure_margins,
    collections=("ant", "fish", "teddy", "human", "glasses", "chair"),
    score=f"mean logarithm of the chance stated of what is so, {SHARE:.0%} cut off one of two shapes",
)
