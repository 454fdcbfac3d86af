"""The weights by which poses of two surfaces that share a part are judged, and what hints and cameras add to them.

What is known of the poses of all pairs of a kind is gathered once, and kept in ``.cache/overlaps``.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from collalign.confidence import overlap_model
from collalign.confidence.overlap_model import (
    HARMLESS,
    ORDER_ODDS,
    OVERLAP_WEIGHTS,
    ROUGH_DEG,
    ROUGH_ODDS,
    hinted_evidence,
    overlap_evidence,
)
from collalign.stages.incomplete.scan_pairs import DESCRIBING, NUM_CANDIDATES, OVERLAPPING
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.local_surface import PART_CELL, LocalSurface, shows_scene
from data_tools.poses import moved_by, pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Finding
from experiments.collections.landmarked import read_dataset
from experiments.datasets import read_truth_folder
from experiments.generated.rooms import depth_frames, room, way_round
from experiments.pairs.incomplete import without_share
from experiments.provenance import ROOT
from pairwise.features.depth_images import sight_conflicts
from pairwise.features.overlap import match_overlapping
from pairwise.features.poses import rotations_by

CACHE = ROOT / ".cache" / "overlaps"
#: A real room, and generated ones: name, seed and number of frames. The scoreboard draws others.
REAL = "depth_room20"
GENERATED = {
    "room": (False, 0, 20),
    "long room": (False, 1, 30),
    "corridor": (True, 0, 20),
    "long corridor": (True, 1, 30),
}
#: Depth images of objects, so many from all around, in the second kind without their lines of sight, ...
VIEWED, NUM_VIEWS, UNSEEN = ("human", "bird", "chair", "teddy", "ant", "blob"), 12, ", unseen"
#: ... and what is left of objects of which either of two shares is cut off.
CUT, CUT_OFF, NUM_CUT = ("chair pieces", "teddy pieces"), (0.3, 0.6), 8
NUM_QUICK = 4
#: A pose is right within so many degrees, and if it takes the middle of the source within so many cells.
RIGHT_DEG, RIGHT_CELLS = 10.0, 5.0
#: What hints may add to log-odds.
MOST_ODDS = 12.0
#: Joined poses are nearly right: they have up to so many times as much in front of what was seen as right ones.
JOINED = 2.5
#: How much the squared weights count beside the mean log loss. Of 1e-5 to 1e-4 frames of rooms are judged best by it
#: where weights are fitted on the others.
RIDGE = 2.5e-5
#: What is stated at the first should be right that often; so much of what is right should be stated at the second.
SURE, USABLE = 0.95, 0.9


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedPairs:
    """What is known of all poses of some pairs.

    Attributes
    ----------
    evidence : ndarray, shape (p, k)
        As :func:`collalign.confidence.overlap_model.overlap_evidence` returns it, and what hints would say.
    right : ndarray of bool, shape (p,)
    pair : ndarray of int, shape (p,)
        Number of the pair of each, in order.
    """

    evidence: FloatArray
    right: BoolArray
    pair: IntArray

    @classmethod
    def of_each(
        cls, evidence: Sequence[FloatArray], right: Sequence[Sequence[bool] | BoolArray]
    ) -> JudgedPairs:
        """Return in one what is known of each pair."""
        return cls(
            evidence=np.concatenate(evidence),
            right=np.concatenate([np.asarray(own, dtype=np.bool_) for own in right]),
            pair=np.repeat(np.arange(len(right)), [len(own) for own in right]),
        )


def shapes_of(name: str, data: Path) -> tuple[list[Shape], FloatArray]:
    """Return shapes of a kind and their poses (n, 4, 4), file to common frame."""
    if name == REAL:
        dataset = read_truth_folder(data / REAL)
        rows = json.loads((data / REAL / "truth.json").read_text())["shapes"]
        shapes = [dataset.shape(i) for i in range(len(rows))]
        return shapes, np.linalg.inv(np.array([row["pose"] for row in rows]))
    kind = name.removesuffix(UNSEEN).removesuffix(" pieces")
    if kind in GENERATED:
        corridor, seed, num = GENERATED[kind]
        rng = np.random.default_rng([seed, 77])
        parts, way = room(rng, corridor=corridor), way_round(num, rng, corridor=corridor)
        return list(depth_frames(parts, way, rng)), way
    rng = np.random.default_rng([85, *kind.encode()])
    whole = blob(rng, num_vertices=3000) if kind == "blob" else read_dataset(kind, data).shape(0)
    if name in CUT:
        shares = [CUT_OFF[n % 2] for n in range(NUM_CUT)]
        shapes = [without_share(whole, rng.standard_normal(3), share) for share in shares]
    else:
        angles = 2.0 * np.pi * np.arange(NUM_VIEWS) / NUM_VIEWS
        sights = np.column_stack([np.cos(angles), np.sin(angles), np.full(NUM_VIEWS, 0.2)])
        views = [range_view(whole, sight, noise=0.003, rng=rng) for sight in sights]
        shapes = [Shape.from_arrays(view) for view in views]
    return shapes, np.tile(np.eye(4), (len(shapes), 1, 1))


def described(name: str, shapes: Sequence[Shape]) -> list[LocalSurface]:
    """Return the surfaces of a kind in cells of one size."""
    cell = PART_CELL * float(np.median([centre_and_radius(shape)[1] for shape in shapes]))
    surfaces = [one for shape in shapes if (one := surface_cells(shape, cell)) is not None]
    if shows_scene(surfaces):
        surfaces = [
            one
            for shape in shapes
            if (one := surface_cells(shape, cell, of_scene=True)) is not None
        ]
    if name.endswith(UNSEEN):
        none = read_only(np.empty((0, 3)))
        surfaces = [replace(one, sights=none, places=none) for one in surfaces]
    return surfaces


def judged_pairs(
    surfaces: Sequence[LocalSurface], poses: FloatArray, num_candidates: int = NUM_CANDIDATES
) -> JudgedPairs:
    """Match every two surfaces, and say which poses are right."""
    evidence, right = [], []
    for i, j in itertools.combinations(range(len(surfaces)), 2):
        target, source = surfaces[i], surfaces[j]
        found = match_overlapping(target, source, num_candidates=num_candidates)
        truth, middle = np.linalg.inv(poses[i]) @ poses[j], source.points.mean(axis=0)
        moved = found.rotations @ middle + found.shifts
        off = np.linalg.norm(moved - moved_by(truth, middle), axis=1)
        is_right = pose_angle_deg(found.rotations, truth[:3, :3]) <= RIGHT_DEG
        right.append(is_right & (off <= RIGHT_CELLS * target.cell))
        rough = nearly(truth[:3, :3], np.random.default_rng([i, j]))
        hints = hinted_evidence(found.rotations, in_order=j == i + 1, rough=rough[None])
        evidence.append(np.column_stack([overlap_evidence(found), hints]))
    return JudgedPairs.of_each(evidence, right)


def nearly(rotation: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return a rough rotation (3, 3): off by an even choice of angles, up to that at which it is still right."""
    angle, axis = np.radians(rng.uniform(0.0, ROUGH_DEG)), random_rotation(rng)[0]
    return np.asarray(rotations_by(angle * axis[None])[0] @ rotation)


def harmless_share(surfaces: Sequence[LocalSurface], poses: FloatArray) -> float:
    """Return how much is in front of what was seen at right poses, at most; 0 without places."""
    seen = [i for i, surface in enumerate(surfaces) if len(surface.places)]
    shares = []
    for i, j in itertools.combinations(seen, 2):
        truth = np.linalg.inv(poses[i]) @ poses[j]
        ends = surfaces[i], surfaces[j], truth[None, :3, :3], truth[None, :3, 3]
        shares.append(float(sight_conflicts(*ends)[0].max()))
    return max(shares, default=0.0)


def pairs_of(name: str, data: Path, *, quick: bool = False) -> JudgedPairs:
    """Return what is known of the pairs of a kind, from the cache where it is there."""
    versions = f"{DESCRIBING.version}-{OVERLAPPING.version}-{np.size(OVERLAP_WEIGHTS)}"
    path = CACHE / f"{name.replace(' ', '_')}-{versions}.npz"
    if path.exists() and not quick:
        with np.load(path) as stored:
            return JudgedPairs(**stored)
    shapes, poses = shapes_of(name, data)
    few = NUM_QUICK if quick else len(shapes)
    pairs = judged_pairs(described(name, shapes[:few]), poses[:few])
    if not quick:
        CACHE.mkdir(parents=True, exist_ok=True)
        np.savez(path, **vars(pairs))
    return pairs


def chances_of_pairs(weights: FloatArray, pairs: JudgedPairs) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of how probable each pose is (p,), and that none is of each pair with poses (m,)."""
    odds = pairs.evidence @ weights
    starts = np.flatnonzero(np.diff(pairs.pair, prepend=-1))
    total = np.logaddexp(np.logaddexp.reduceat(odds, starts), 0.0)
    counts = np.diff(starts, append=len(odds))
    return odds - np.repeat(total, counts), -total


def log_loss(weights: FloatArray, pairs: JudgedPairs) -> float:
    """Return the mean minus log-probability of what is right: one of the poses, or none."""
    chances, none = chances_of_pairs(weights, pairs)
    starts = np.flatnonzero(np.diff(pairs.pair, prepend=-1))
    of_right = np.logaddexp.reduceat(np.where(pairs.right, chances, -np.inf), starts)
    return -float(np.mean(np.where(np.isinf(of_right), none, of_right)))


def fit_weights(kinds: Sequence[JudgedPairs]) -> FloatArray:
    """Return the weights of the least log loss; kinds count alike."""

    def loss(weights: FloatArray) -> float:
        mean = float(np.mean([log_loss(weights, pairs) for pairs in kinds]))
        return mean + RIDGE * float(weights @ weights)

    start = np.zeros(kinds[0].evidence.shape[1])
    return np.asarray(minimize(loss, start, method="BFGS").x)


def stated_and_right(weights: FloatArray, pairs: JudgedPairs) -> tuple[int, int, int, int]:
    """Return how many poses are right, and stated at .9 of these; how many are stated at .95, and wrong of these."""
    chances = np.exp(chances_of_pairs(weights, pairs)[0])
    sure = chances >= SURE
    return (
        int(pairs.right.sum()),
        int((chances[pairs.right] >= USABLE).sum()),
        int(sure.sum()),
        int((sure & ~pairs.right).sum()),
    )


def _kind(name: str) -> str:
    return name.removeprefix("long ").removesuffix(UNSEEN)


def weights_without(kinds: Mapping[str, JudgedPairs]) -> dict[str, FloatArray]:
    """Return for each kind the weights fitted on the others."""
    return {
        name: fit_weights([pairs for other, pairs in kinds.items() if _kind(other) != _kind(name)])
        for name in kinds
        if any(_kind(other) != _kind(name) for other in kinds)
    }


def finding(now: FloatArray, kinds: Mapping[str, JudgedPairs]) -> Finding:
    """Fit the weights on all kinds, and judge each by those of the others."""
    fitted = fit_weights(list(kinds.values()))
    without = [log_loss(some, kinds[name]) for name, some in weights_without(kinds).items()]
    losses = [
        np.mean([log_loss(some, pairs) for pairs in kinds.values()]) for some in (now, fitted)
    ]
    return Finding(
        value=tuple(fitted.tolist()),
        now=-float(losses[0]),
        best=-float(losses[1]),
        left_out=-float(np.mean(without)) if without else float("nan"),
    )


def with_weights(kinds: Mapping[str, JudgedPairs]) -> dict[str, JudgedPairs]:
    """Return the kinds with other columns of evidence: log-odds by the weights of the code, and what hints say."""
    weights = np.ravel(OVERLAP_WEIGHTS)
    known = slice(len(weights))
    return {
        name: replace(
            pairs,
            evidence=np.column_stack(
                [pairs.evidence[:, known] @ weights, pairs.evidence[:, len(weights) :]]
            ),
        )
        for name, pairs in kinds.items()
    }


def hint_finding(now: float, column: int, kinds: Mapping[str, JudgedPairs]) -> Finding:
    """Fit what a hint adds to log-odds, and judge each kind by what is best for the others."""

    def score(odds: float, chosen: Sequence[str]) -> float:
        weights = np.array([1.0, 0.0, 0.0])
        weights[column] = odds
        return -float(np.mean([log_loss(weights, kinds[name]) for name in chosen]))

    def best(chosen: Sequence[str]) -> float:
        found = minimize_scalar(
            lambda odds: -score(odds, chosen), bounds=(0.0, MOST_ODDS), method="bounded"
        )
        return float(found.x)

    names = [*kinds]
    others = {name: [other for other in names if _kind(other) != _kind(name)] for name in names}
    without = [score(best(rest), [name]) for name, rest in others.items() if rest]
    value = best(names)
    return Finding(
        value=value,
        now=score(now, names),
        best=score(value, names),
        left_out=float(np.mean(without)) if without else float("nan"),
    )


def measure_overlaps(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Gather what is known of all kinds, and fit the weights on it, then what hints add to them."""
    kinds = {name: pairs_of(name, data, quick=quick) for name in collections}
    weights = np.ravel(OVERLAP_WEIGHTS)
    plain = {
        name: replace(pairs, evidence=pairs.evidence[:, : len(weights)])
        for name, pairs in kinds.items()
    }
    hinted = with_weights(kinds)
    in_order = {name: pairs for name, pairs in hinted.items() if name not in CUT}
    harmless = []
    for name in collections if not quick else ():
        if name in (REAL, *GENERATED):
            shapes, poses = shapes_of(name, data)
            harmless.append(harmless_share(described(name, shapes), poses))
    return {
        "OVERLAP_WEIGHTS": finding(weights, plain),
        "ORDER_ODDS": hint_finding(ORDER_ODDS, 1, in_order),
        "ROUGH_ODDS": hint_finding(ROUGH_ODDS, 2, hinted),
        "HARMLESS": Finding(value=JOINED * max(harmless, default=HARMLESS / JOINED)),
    }


CALIBRATION = Calibration(
    module=overlap_model.__name__,
    constants={
        "OVERLAP_WEIGHTS": tuple(np.ravel(OVERLAP_WEIGHTS).tolist()),
        "ORDER_ODDS": ORDER_ODDS,
        "ROUGH_ODDS": ROUGH_ODDS,
        "HARMLESS": HARMLESS,
    },
    measure=measure_overlaps,
    collections=(
        REAL,
        *GENERATED,
        *VIEWED,
        *(name + UNSEEN for name in (*VIEWED, "room")),
        *CUT,
    ),
    score="minus the mean log loss of a pair, each kind judged by weights of the others",
)
