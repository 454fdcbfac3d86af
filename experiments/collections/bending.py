"""Collections that bend, from random poses at default options, compared with what the best poses could come to."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection, synchronize
from collalign.engine.records import Record
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray
from experiments.clock import stopwatch
from experiments.collections.aligning import pose_some
from experiments.collections.landmarked import CLASSES_FOLDER, RIGHT_DEG, TEETH_FOLDER
from experiments.collections.posed import GROSS_DEG, PosedCollection
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.seen import seen_note
from experiments.tables import Column, Row, Table

#: Shapes drawn of each collection.
SETS = {
    "human": 20,
    "armadillo": 20,
    "scape": 20,
    "centaur": 6,
    "ant": 20,
    "glasses": 20,
    "teddy": 20,
    "chair": 20,
    "fish": 20,
    "plane": 20,
    "bird": 20,
    "teeth": 20,
    "mouse skulls": 20,
}
NUM_DRAWS = 5
#: Small collections of the same classes, where few pairs can contradict a wrong one.
FEW, NUM_SMALL_DRAWS = 6, 12
SMALL_SETS = ("human", "armadillo", "scape", "ant", "glasses", "teddy", "chair", "fish")
#: Raised when what is recorded changes.
VERSION = "3"

_ABOUT = f"""
Every collection in random poses, default options, {NUM_DRAWS} draws of poses (and of shapes, where there are more).
The truth of two shapes is the rotation that their landmarks ask for, or all vertices where meshes are registered.
Where bodies bend, these rotations contradict each other around cycles, and no poses fit all of them: *best possible*
are the poses that are synchronized from the true rotations themselves. Mirrored pairs count as gross. The second
table draws {NUM_SMALL_DRAWS} times {FEW} shapes of a class.

{seen_note(("teeth", "shrec07", "scape"))}
"""


def measure_bending(cell: Cell) -> Record:
    """Align one draw of one collection.

    Settings: ``collection``, ``shapes``, ``seed``.

    Returns
    -------
    dict
        ``errors`` and ``possible`` (pairs,) in degrees, 180 where mirrored, of the poses found and of the best ones;
        ``shapes`` (N,) in degrees, ``confidence`` (N,), ``processor_s``.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        posed, _ = pose_some(cell.settings, cell.data, folder)
        with stopwatch() as elapsed:
            found = align_collection(
                folder, run=RunOptions(jobs=1), options=AlignOptions(), progress=False
            )
        return {
            "errors": _complete(posed.pair_errors_deg(found.rotations, found.names)),
            "possible": _complete(posed.pair_errors_deg(best_possible(posed), posed.names)),
            "shapes": posed.shape_errors_deg(found.rotations, found.names),
            "confidence": found.confidence,
            "processor_s": elapsed.processor_s,
        }


def best_possible(posed: PosedCollection) -> FloatArray:
    """Return the poses that all true relative rotations together ask for, shape (N, 3, 3)."""
    edges = list(itertools.combinations(range(len(posed.names)), 2))
    group = "O" if (np.linalg.det(posed.relative) < 0).any() else "SO"
    return synchronize(
        edges, np.stack([posed.relative[edge] for edge in edges]), group=group
    ).rotations


def _complete(errors: FloatArray) -> FloatArray:
    return np.nan_to_num(errors, nan=180.0)


def row_of(name: str, records: list[Record]) -> Row:
    """Return the row of the draws of one collection."""
    errors = [record["errors"] for record in records]
    wrong = np.concatenate([record["shapes"] > RIGHT_DEG for record in records])
    doubted = np.concatenate([record["confidence"] < DOUBT for record in records])
    gross = [100.0 * float((one > GROSS_DEG).mean()) for one in errors]
    return {
        "collection": name,
        "shapes": len(records[0]["shapes"]),
        "draws": len(records),
        "gross": float(np.mean(gross)),
        "worst": max(gross),
        "median": float(np.median(np.concatenate(errors))),
        "possible_gross": 100.0
        * float(np.mean([(record["possible"] > GROSS_DEG).mean() for record in records])),
        "possible_median": float(
            np.median(np.concatenate([record["possible"] for record in records]))
        ),
        "wrong": int(wrong.sum()),
        "right": 100.0 * float((~wrong).mean()),
        "unnoticed": int((wrong & ~doubted).sum()),
        "right_in_doubt": int((~wrong & doubted).sum()),
        "seconds": float(np.median([record["processor_s"] for record in records])),
    }


COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="shapes", title="shapes"),
    Column(key="draws", title="draws"),
    Column(key="gross", title=f"pairs beyond {GROSS_DEG:.0f} deg, %", format=".1f"),
    Column(key="worst", title="worst draw, %", format=".1f"),
    Column(key="median", title="median, deg", format=".1f"),
    Column(key="possible_gross", title="best possible: pairs beyond, %", format=".1f"),
    Column(key="possible_median", title="best possible: median, deg", format=".1f"),
    Column(key="wrong", title=f"shapes beyond {RIGHT_DEG:.0f} deg"),
    Column(key="unnoticed", title=f"of these at {DOUBT} or more"),
    Column(key="right_in_doubt", title="right shapes in doubt"),
    Column(key="seconds", title="CPU, s", format=".0f", clock=True),
)

SMALL_COLUMNS = (
    *(column for column in COLUMNS if column.key not in ("worst", "median", "possible_median")),
    Column(key="right", title=f"shapes within {RIGHT_DEG:.0f} deg, %", format=".1f"),
)


def measure(bench: Bench) -> Outcome:
    """Measure all collections, whole and in small parts; with ``--quick`` one draw of the centaur alone."""
    if bench.quick:
        return Outcome(tables=(_table(bench, COLUMNS, {"centaur": SETS["centaur"]}, 1),))
    small = dict.fromkeys(SMALL_SETS, FEW)
    whole = _table(bench, COLUMNS, SETS, NUM_DRAWS)
    few = _table(
        bench, SMALL_COLUMNS, small, NUM_SMALL_DRAWS, name="few", caption=f"{FEW} shapes each."
    )
    return Outcome(tables=(whole, few))


def _table(
    bench: Bench,
    columns: tuple[Column, ...],
    sets: Mapping[str, int],
    draws: int,
    *,
    name: str = "",
    caption: str = "",
) -> Table:
    """Measure so many draws of some collections, and return their table."""
    seeds = range(draws)
    bench.seeds.update(seeds)
    rows = []
    for collection, num in sets.items():
        cells = {
            f"{collection} {num} {seed}": {"collection": collection, "shapes": num, "seed": seed}
            for seed in seeds
        }
        row = row_of(
            collection, list(bench.measure(measure_bending, cells, version=VERSION).values())
        )
        rows.append({column.key: row[column.key] for column in columns})
    return Table(name=name, columns=columns, rows=tuple(rows), caption=caption)


EXPERIMENT = Experiment(
    name="bending",
    title="Collections that bend, and rigid ones",
    about=_ABOUT,
    measure=measure,
    collections=(CLASSES_FOLDER, TEETH_FOLDER, "scape71", "tosca_centaur6", "mouse_skulls62"),
)
