"""The weights by which poses of two images of a scene are judged: all pairs of frames of generated and real rooms."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from collalign.confidence import overlap_model
from collalign.confidence.overlap_model import SCENE_WEIGHTS
from collalign.stages.incomplete.scans import NUM_CANDIDATES
from data_tools.arrays import BoolArray, FloatArray
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.local_surface import PART_CELL
from data_tools.poses import moved_by, pose_angle_deg
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.datasets import read_truth_folder
from experiments.generated.rooms import depth_frames, room, way_round
from pairwise.features.overlap import match_overlapping

#: A real room, and generated ones: name, seed and number of frames. The scoreboard draws others.
REAL = "depth_room20"
GENERATED = {
    "room": (False, 0, 20),
    "long room": (False, 1, 30),
    "corridor": (True, 0, 20),
    "long corridor": (True, 1, 30),
}
NUM_QUICK = 4
#: A pose is right within so many degrees, and if it takes the middle of the source within so many cells.
RIGHT_DEG, RIGHT_CELLS = 10.0, 5.0
#: How much the squared weights count beside the mean log loss.
RIDGE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedPair:
    """What is known of the poses of a pair: mismatch and consensus (p, 2), and which are right (p,)."""

    evidence: FloatArray
    right: BoolArray


def frames_of(name: str, data: Path) -> tuple[list[Shape], FloatArray]:
    """Return images of a room and their poses (n, 4, 4), file to room."""
    if name == REAL:
        dataset = read_truth_folder(data / REAL)
        rows = json.loads((data / REAL / "truth.json").read_text())["shapes"]
        shapes = [dataset.shape(i) for i in range(len(rows))]
        return shapes, np.linalg.inv(np.array([row["pose"] for row in rows]))
    corridor, seed, num = GENERATED[name]
    rng = np.random.default_rng([seed, 77])
    parts, way = room(rng, corridor=corridor), way_round(num, rng, corridor=corridor)
    return list(depth_frames(parts, way, rng)), way


def judged_pairs(shapes: Sequence[Shape], poses: FloatArray) -> list[JudgedPair]:
    """Match every two images, and say which poses are right."""
    cell = PART_CELL * float(np.median([centre_and_radius(shape)[1] for shape in shapes]))
    surfaces = [surface_cells(shape, cell, of_scene=True) for shape in shapes]
    pairs = []
    for i, j in itertools.combinations(range(len(shapes)), 2):
        target, source = surfaces[i], surfaces[j]
        if target is None or source is None:
            continue
        found = match_overlapping(target, source, num_candidates=NUM_CANDIDATES)
        truth, middle = np.linalg.inv(poses[i]) @ poses[j], source.points.mean(axis=0)
        off = np.linalg.norm(
            found.rotations @ middle + found.shifts - moved_by(truth, middle), axis=1
        )
        right = pose_angle_deg(found.rotations, truth[:3, :3]) <= RIGHT_DEG
        right &= off <= RIGHT_CELLS * cell
        evidence = np.column_stack([found.mismatch, found.consensus])
        pairs.append(JudgedPair(evidence=evidence, right=np.asarray(right)))
    return pairs


def log_loss(weights: FloatArray, pairs: Sequence[JudgedPair]) -> float:
    """Return the mean minus log-probability of what is right: one of the poses, or none."""
    losses = []
    for pair in pairs:
        consensus = np.log(pair.evidence[:, 1] + SCENE_WEIGHTS[3])
        scores = weights[0] * pair.evidence[:, 0] + weights[1] * consensus - weights[2]
        every = np.append(scores, 0.0)
        is_right = np.append(pair.right, not pair.right.any())
        losses.append(logsumexp(every) - logsumexp(every[is_right]))
    return float(np.mean(losses))


def fit_weights(drawn: Sequence[Sequence[JudgedPair]]) -> FloatArray:
    """Return the weights of the least log loss; collections count alike."""

    def loss(weights: FloatArray) -> float:
        mean = float(np.mean([log_loss(weights, pairs) for pairs in drawn]))
        return mean + RIDGE * float(weights @ weights)

    return np.asarray(minimize(loss, np.zeros(3), method="BFGS").x)


def measure_scenes(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights on all collections, and judge each by those of the others of another kind."""
    drawn = {}
    for name in collections:
        shapes, poses = frames_of(name, data)
        few = NUM_QUICK if quick else len(shapes)
        drawn[name] = judged_pairs(shapes[:few], poses[:few])
    weights = fit_weights(list(drawn.values()))
    without = [
        log_loss(fit_weights(others), pairs)
        for name, pairs in drawn.items()
        for others in [[drawn[other] for other in drawn if _kind(other) != _kind(name)]]
        if others
    ]
    losses = [
        float(np.mean([log_loss(some, pairs) for pairs in drawn.values()]))
        for some in (np.array(SCENE_WEIGHTS[:3]), weights)
    ]
    found = Finding(
        value=(*weights.tolist(), SCENE_WEIGHTS[3]),
        now=-losses[0],
        best=-losses[1],
        left_out=-float(np.mean(without)) if without else float("nan"),
    )
    return {"SCENE_WEIGHTS": found}


def _kind(name: str) -> str:
    return name.removeprefix("long ")


CALIBRATION = Calibration(
    module=overlap_model.__name__,
    constants=constants_of(overlap_model, "SCENE_WEIGHTS"),
    measure=measure_scenes,
    collections=(REAL, *GENERATED),
    score="minus the mean log loss of a pair, each kind of room judged by weights of the others",
)
