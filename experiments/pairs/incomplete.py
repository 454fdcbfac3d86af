"""Pairs of shapes of which one or both lack a part, matched in part, beside other tools."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from collalign.engine.store.records import Record
from collalign.options import AUTO
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.landmarked import CLASSES, CLASSES_FOLDER, RIGHT_DEG, TEETH_FOLDER, read_dataset
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.pairs.incomplete_sets import (
    COMPLETE_COLUMNS,
    CUT_COLUMNS,
    RANDOM,
    ROSTRUM,
    SCAN_COLUMNS,
    SCAN_PAIR_COLUMNS,
    SCANS_FOLDER,
    TOLD,
    chance_of,
    complete_row,
    cut_row,
    measure_complete_collection,
    measure_cut_collection,
    measure_scan_collection,
    measure_scan_pairs,
    scan_pair_rows,
    scan_row,
    surface_of,
)
from experiments.pairs.invariants import without_share
from experiments.peers.peer_pairs import MatchedPairs, kiss_pairs, open3d_pairs
from experiments.tables import Column, Row, Table
from pairwise.partial.match import match_partial

SEED = 3
#: Folder of the mouse skulls.
SKULLS_FOLDER = "mouse_skulls62"
#: Collection, shapes, how many are cut, by how much, whether that is told, and what is cut off.
CUT_SETS = (
    ("teeth", 20, 6, 0.25, TOLD, RANDOM),
    ("teeth", 20, 6, 0.25, AUTO, RANDOM),
    ("teeth", 20, 3, 0.5, TOLD, RANDOM),
    ("ant", 10, 3, 0.25, AUTO, RANDOM),
    ("teddy", 10, 3, 0.25, AUTO, RANDOM),
    ("mouse skulls", 20, 4, 0.33, TOLD, ROSTRUM),
)
#: Collections that lack nothing, and how many of their shapes are aligned.
COMPLETE_SETS = (("glasses", 20), ("teeth", 12))
#: Pairs of each cell.
NUM_PAIRS = 8
#: Other tools on the same pairs, and the packages that they need.
PEERS: dict[str, tuple[Callable[[Sequence[Shape], int], MatchedPairs], tuple[str, ...]]] = {
    "open3d": (open3d_pairs, ("open3d",)),
    "kiss": (kiss_pairs, ("kiss_matcher", "small_gicp")),
}

_ABOUT = f"""
**Pairs.** A quarter of a shape's vertices is cut off by a plane in a random direction, another one for every shape;
then it is turned at random. {NUM_PAIRS} pairs of each collection, the source or both cut, among the shapes at odd
positions (constants were chosen at even positions of teeth, glasses and ants): the best pose of
`pairwise.partial.match.match_partial`, and the best of its first eight, beside FPFH, RANSAC and point-to-plane ICP of
Open3D and KISS-Matcher with GICP, each on the same two meshes brought to one root mean square radius. So few pairs
tell 60 from 90 %, and no less; a tool that was not installed has no figures. In doubt: a chance below
{100 * DOUBT:.0f} % against its rivals (`collalign.confidence.incomplete_model`).

**Collections.** Shapes drawn from a collection in random poses, some of them without a part (a share of the vertices,
beyond a random plane; of mouse skulls the front, with the rostrum), aligned with default options by
`collalign align`, told which are incomplete (`--incomplete`) or not told.

**Scans.** The ten range scans of the Stanford bunny in random poses, none of which is complete; as a collection
(`--incomplete all --scaling rigid`), and every two that share at least 30 % of their dense samples. Matching samples
of which some stay unmatched, refined on 400 dense points, was removed: of these pairs it had 12, 92 and 100 % right
with 64 samples, and 25, 85 and 100 % with 120 (overlaps of 30 to 50, to 70 and to 100 %).

**Complete sets.** What looking for incomplete shapes changes and costs where nothing is missing.
"""


_TEXT = """
Of shapes that differ the right pose is nearly always among the candidates; what fails is to tell it from its
rivals. Tried once, beside this experiment: of 24 pairs of ants and 24 of teddy bears at even positions, 46 and 75 %
are right, and the pose sought is among 120 candidates of 92 and 100 %. Ranking these again by other cutoffs and
resolutions, by local descriptors at two scales (means of heights and of normals in balls), by one side alone, or by
the residual and the bending after a smooth deformation gains at most two pairs and loses as many in other classes,
so further candidates (FPFH) and these judges were left out. Ants of which the legs are elsewhere are ambiguous
between head and rear. Pairs of scans that overlap by less than a half are mostly wrong, and in doubt; all ten
together are right, since each is posed on all others.
"""


def measure_pairs(cell: Cell) -> Record:
    """Match pairs of which one or both are cut; errors in degrees by tool, and processor seconds of ours."""
    settings, rng = cell.settings, np.random.default_rng(cell.settings["seed"])
    dataset = read_dataset(settings["collection"], cell.data)
    eligible = np.arange(len(dataset)) if dataset.chirality is None else np.flatnonzero(dataset.chirality == 1)
    pairs = list(itertools.combinations(eligible[1::2].tolist(), 2))
    found: dict[str, list[float]] = {key: [] for key in ("best", "top", "chance", "seconds", *PEERS)}
    for number in rng.permutation(len(pairs))[: settings["pairs"]]:
        i, j = pairs[number]
        turn = random_rotation(rng)
        target, source = dataset.shape(i), without_share(dataset.shape(j), rng.standard_normal(3), 0.25)
        if settings["cut"] == 2:
            target = without_share(target, rng.standard_normal(3), 0.25)
        source = Shape.from_arrays(source.vertices @ turn.T, source.faces, name=source.name)
        truth = dataset.rotation(i, j) @ turn.T
        with stopwatch() as elapsed:
            poses = match_partial(surface_of(target), surface_of(source))
        errors = rotation_angle_deg(np.stack([found.pose.rotation for found in poses]), truth)
        found["best"].append(float(errors[0]))
        found["top"].append(float(errors[:8].min()))
        found["chance"].append(chance_of(poses))
        found["seconds"].append(elapsed.processor_s)
        for name, (match, packages) in PEERS.items():
            error = _peer_error(match, [target, source], truth) if all(map(find_spec, packages)) else float("nan")
            found[name].append(error)
    return dict(found)


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
    Column(key="noticed", title="wrong ones in doubt"),
    Column(key="doubtful", title="right ones in doubt"),
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
    wrong, doubtful = np.array(record["best"]) > RIGHT_DEG, np.array(record["chance"]) < DOUBT
    return {
        "noticed": f"{int((wrong & doubtful).sum())} of {int(wrong.sum())}",
        "doubtful": int((~wrong & doubtful).sum()),
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
    of_pairs = bench.measure(measure_pairs, pairs, version="3")
    table = Table(
        caption=f"Pairs. Right: within {RIGHT_DEG:.0f} degrees of the landmarks' rotation.",
        columns=_PAIR_COLUMNS,
        rows=tuple(pair_row(pairs[label], record) for label, record in of_pairs.items()),
    )
    return Outcome(tables=(table, *(() if bench.quick else _sets(bench))), text=_TEXT)


def _sets(bench: Bench) -> tuple[Table, ...]:
    """Run what takes whole collections."""
    sets = {
        f"{collection}, {cut} of {shapes} {way}": {
            "collection": collection,
            "shapes": shapes,
            "cut": cut,
            "share": share,
            "way": way,
            "what": what,
            "seed": SEED,
        }
        for collection, shapes, cut, share, way, what in CUT_SETS
    }
    scans = {"scans": 10, "seed": SEED}
    complete = {name: {"collection": name, "shapes": num, "seed": SEED} for name, num in COMPLETE_SETS}
    of_sets = bench.measure(measure_cut_collection, sets, version="2")
    of_scans = bench.measure(measure_scan_collection, {"scans": scans}, version="2")
    of_scan_pairs = bench.measure(measure_scan_pairs, {"pairs of scans": scans}, version="3")
    of_complete = bench.measure(measure_complete_collection, complete, apart=True)
    return (
        Table(
            name="collections",
            caption=f"Collections. Right: within {RIGHT_DEG:.0f} degrees of the truth, and of the right side.",
            columns=CUT_COLUMNS,
            rows=tuple(cut_row(sets[label], record) for label, record in of_sets.items()),
        ),
        Table(
            name="scans",
            caption="The scans as a collection.",
            columns=SCAN_COLUMNS,
            rows=tuple(scan_row(record) for record in of_scans.values()),
        ),
        Table(
            name="scan_pairs",
            caption="Pairs of scans.",
            columns=SCAN_PAIR_COLUMNS,
            rows=tuple(row for record in of_scan_pairs.values() for row in scan_pair_rows(record)),
        ),
        Table(
            name="complete",
            caption="Complete sets.",
            columns=COMPLETE_COLUMNS,
            rows=tuple(complete_row(complete[label], record) for label, record in of_complete.items()),
        ),
    )


EXPERIMENT = Experiment(
    name="incomplete",
    title="Shapes with a part cut off",
    about=_ABOUT,
    measure=measure,
    collections=(TEETH_FOLDER, CLASSES_FOLDER, SKULLS_FOLDER, SCANS_FOLDER),
)
