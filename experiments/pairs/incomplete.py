"""Pairs of shapes of which one or both lack a part, matched in part, beside other tools."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from collalign.engine.store.records import Record
from collalign.stages.incomplete.surfaces import NUM_POINTS
from data_tools.arrays import FloatArray
from data_tools.embedding.surface_points import surface_points
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.landmarked import CLASSES, CLASSES_FOLDER, RIGHT_DEG, TEETH_FOLDER, read_dataset
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.pairs.invariants import without_share
from experiments.peers.peer_pairs import MatchedPairs, kiss_pairs, open3d_pairs
from experiments.tables import Column, Row, Table
from pairwise.partial.match import match_partial
from pairwise.partial.surface import PartialSurface

SEED = 3
#: Pairs of each cell.
NUM_PAIRS = 8
#: Other tools on the same pairs, and the packages that they need.
PEERS: dict[str, tuple[Callable[[Sequence[Shape], int], MatchedPairs], tuple[str, ...]]] = {
    "open3d": (open3d_pairs, ("open3d",)),
    "kiss": (kiss_pairs, ("kiss_matcher", "small_gicp")),
}

_ABOUT = f"""
A quarter of a shape's vertices is cut off by a plane in a random direction, another one for every shape; then it is
turned at random. {NUM_PAIRS} pairs of each collection, the source or both cut, among the shapes at odd positions
(constants were chosen at even positions of teeth, glasses and ants): the best pose of
`pairwise.partial.match.match_partial`, and the best of its first eight, beside FPFH, RANSAC and point-to-plane ICP of
Open3D and KISS-Matcher with GICP, each on the same two meshes brought to one root mean square radius. So few pairs
tell 60 from 90 %, and no less; a tool that was not installed has no figures.
"""


def measure_pairs(cell: Cell) -> Record:
    """Match pairs of which one or both are cut; errors in degrees by tool, and processor seconds of ours."""
    settings, rng = cell.settings, np.random.default_rng(cell.settings["seed"])
    dataset = read_dataset(settings["collection"], cell.data)
    eligible = np.arange(len(dataset)) if dataset.chirality is None else np.flatnonzero(dataset.chirality == 1)
    pairs = list(itertools.combinations(eligible[1::2].tolist(), 2))
    found: dict[str, list[float]] = {key: [] for key in ("best", "top", "seconds", *PEERS)}
    for number in rng.permutation(len(pairs))[: settings["pairs"]]:
        i, j = pairs[number]
        turn = random_rotation(rng)
        target, source = dataset.shape(i), without_share(dataset.shape(j), rng.standard_normal(3), 0.25)
        if settings["cut"] == 2:
            target = without_share(target, rng.standard_normal(3), 0.25)
        source = Shape.from_arrays(source.vertices @ turn.T, source.faces, name=source.name)
        truth = dataset.rotation(i, j) @ turn.T
        with stopwatch() as elapsed:
            poses = match_partial(_surface(target), _surface(source))
        errors = rotation_angle_deg(np.stack([pose.R_target_source for pose in poses]), truth)
        found["best"].append(float(errors[0]))
        found["top"].append(float(errors[:8].min()))
        found["seconds"].append(elapsed.processor_s)
        for name, (match, packages) in PEERS.items():
            error = _peer_error(match, [target, source], truth) if all(map(find_spec, packages)) else float("nan")
            found[name].append(error)
    return dict(found)


def _surface(shape: Shape) -> PartialSurface:
    points = surface_points(shape, NUM_POINTS)
    return PartialSurface.from_user(points.points, points.normals, points.on_rim, oriented=points.oriented)


def _peer_error(
    match: Callable[[Sequence[Shape], int], MatchedPairs], shapes: Sequence[Shape], truth: FloatArray
) -> float:
    return float(rotation_angle_deg(match(shapes, 1).transforms[0, :3, :3], truth))


_PAIR_COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="cut", title="cut"),
    Column(key="pairs", title="pairs"),
    Column(key="best", title="right, %", format=".0f"),
    Column(key="top", title="one of the first 8, %", format=".0f"),
    Column(key="median", title="median error, deg", format=".1f"),
    Column(key="open3d", title="Open3D, %", format=".0f"),
    Column(key="kiss", title="KISS-Matcher, %", format=".0f"),
    Column(key="seconds", title="processor s a pair", format=".1f", clock=True),
)


def pair_row(settings: dict[str, Any], record: Record) -> Row:
    """Return the shares of right pairs; tools that were not there have none."""
    shares = {
        key: None if np.isnan(record[key]).any() else 100.0 * float(np.mean(np.array(record[key]) <= RIGHT_DEG))
        for key in ("best", "top", *PEERS)
    }
    return {
        "collection": settings["collection"],
        "cut": "one" if settings["cut"] == 1 else "both",
        "pairs": len(record["best"]),
        "median": float(np.median(record["best"])),
        "seconds": float(np.mean(record["seconds"])),
        **shares,
    }


def measure(bench: Bench) -> Outcome:
    """Run pairs, collections and scans."""
    bench.seeds.add(SEED)
    names = CLASSES[:1] if bench.quick else ("teeth", *CLASSES)
    pairs = {
        f"{name}, {cut} cut": {
            "collection": name,
            "cut": cut,
            "pairs": 1 if bench.quick else NUM_PAIRS,
            "seed": SEED,
        }
        for name, cut in itertools.product(names, (1, 2))
        if cut == 1 or name == "teeth"
    }
    of_pairs = bench.measure(measure_pairs, pairs)
    return Outcome(
        tables=(
            Table(
                caption=f"Right: within {RIGHT_DEG:.0f} degrees of the landmarks' rotation.",
                columns=_PAIR_COLUMNS,
                rows=tuple(pair_row(pairs[label], record) for label, record in of_pairs.items()),
            ),
        )
    )


EXPERIMENT = Experiment(
    name="incomplete",
    title="Shapes with a part cut off",
    about=_ABOUT,
    measure=measure,
    collections=(TEETH_FOLDER, CLASSES_FOLDER),
)
