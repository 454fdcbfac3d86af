"""Collections of which some shapes lack a part, and what looking for such shapes changes where none does."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.align import align_collection
from collalign.engine.records import Record
from collalign.engine.run_options import RunOptions
from collalign.options import AUTO, NEVER, AlignOptions
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray, IntArray
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.landmarked import CLASSES_FOLDER, RIGHT_DEG, TEETH_FOLDER, read_dataset
from experiments.collections.posed import PosedCollection, pose_collection
from experiments.datasets import Dataset
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.tables import Column, Row, Table

SEED = 3
#: Folder of the mouse skulls.
SKULLS_FOLDER = "mouse_skulls62"
#: What is cut off: beyond a plane of random direction, or the front of a skull.
RANDOM, ROSTRUM = "random", "rostrum"
#: Landmarks at the front end of a mouse skull.
_SKULL_TIP = (0, 1)
#: How the incomplete shapes become known: they are named, or looked for (:data:`collalign.options.AUTO`).
TOLD = "told"
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


_ABOUT = """
**Collections.** Shapes drawn from a collection in random poses, some of them without a part (a share of the vertices,
beyond a random plane; of mouse skulls the front, with the rostrum), aligned with default options by
`collalign align`, told which are incomplete (`--incomplete`) or not told.

**Complete sets.** What looking for incomplete shapes changes and costs where nothing is missing.

Scans, none of which is complete, have a page of their own (`scans`).
"""


def without_share(shape: Shape, direction: FloatArray, share: float) -> Shape:
    """Return the shape without the share of its vertices that lies farthest in a direction."""
    heights = shape.vertices @ direction
    kept = heights <= np.quantile(heights, 1.0 - share)
    number = np.cumsum(kept) - 1
    faces = number[shape.faces[kept[shape.faces].all(axis=1)]]
    used = np.unique(faces)
    rank = np.full(kept.sum(), -1)
    rank[used] = np.arange(len(used))
    return Shape.from_arrays(shape.vertices[kept][used], rank[faces], name=shape.name)


@contextmanager
def _cut_collection(
    settings: dict[str, Any], data: Path
) -> Iterator[tuple[PosedCollection, list[str]]]:
    """Write some shapes of a collection in random poses, some of them cut; also yield the names of these."""
    dataset = read_dataset(settings["collection"], data)
    rng = np.random.default_rng(settings["seed"])
    chosen = rng.permutation(len(dataset))[: settings["shapes"]]
    with tempfile.TemporaryDirectory() as name:
        posed = pose_collection(dataset, chosen, Path(name), rng)
        cut = [dataset.names[i] for i in chosen[: settings["cut"]]]
        for i in chosen[: settings["cut"]]:
            file = Path(name) / f"{dataset.names[i]}.ply"
            shape = read_shape(file)
            direction = rng.standard_normal(3)
            if settings["what"] == ROSTRUM:
                direction = _to_the_tip(dataset, int(i), shape.vertices)
            write_mesh(file, without_share(shape, direction, settings["share"]))
        yield posed, sorted(cut)


def _to_the_tip(dataset: Dataset, which: int, posed: FloatArray) -> FloatArray:
    """Return the direction to the front of a skull whose vertices were rotated."""
    stored = dataset.shape(which).vertices
    tip = dataset.landmarks[which, list(_SKULL_TIP)].mean(axis=0)  # type: ignore[index]
    ahead = (stored - stored.mean(axis=0)) @ (tip - stored.mean(axis=0))
    return np.asarray((posed - posed.mean(axis=0)).T @ ahead)


def measure_cut_collection(cell: Cell) -> Record:
    """Align a collection of which some shapes are cut, told or not, and the others without them."""
    settings = cell.settings
    with (
        _cut_collection(settings, cell.data) as (posed, cut),
        tempfile.TemporaryDirectory() as name,
    ):
        options = AlignOptions(
            incomplete=",".join(cut) if settings["way"] == TOLD else settings["way"]
        )
        run = RunOptions(jobs=1, store=Path(name) / "store.sqlite")
        with stopwatch() as elapsed:
            aligned = align_collection(posed.folder, options=options, run=run, progress=False)
        whole = [posed.folder / f"{shape}.ply" for shape in posed.names if shape not in cut]
        without = align_collection(
            whole, options=replace(options, incomplete=NEVER), run=run, progress=False
        )
    kept = [aligned.names.index(shape) for shape in without.names]
    return {
        "names": list(aligned.names),
        "shape_deg": posed.shape_errors_deg(aligned.rotations, aligned.names),
        "confidence": np.array(aligned.confidence),
        "cut": cut,
        "named": [aligned.names[one.shape] for one in aligned.incomplete],
        "without_deg": posed.shape_errors_deg(without.rotations, without.names),
        "as_without": bool(np.array_equal(aligned.transforms[kept], without.transforms)),
        "processor_s": elapsed.processor_s,
    }


def measure_complete_collection(cell: Cell) -> Record:
    """Align a collection that lacks nothing, with and without looking for incomplete shapes."""
    settings = cell.settings
    dataset = read_dataset(settings["collection"], cell.data)
    rng = np.random.default_rng(settings["seed"])
    chosen: IntArray = rng.permutation(len(dataset))[: settings["shapes"]]
    found, seconds = {}, {}
    with tempfile.TemporaryDirectory() as name:
        posed = pose_collection(dataset, chosen, Path(name), rng)
        for way in (NEVER, AUTO):
            with stopwatch() as elapsed:
                found[way] = align_collection(
                    posed.folder,
                    options=AlignOptions(incomplete=way),
                    run=RunOptions(jobs=1),
                    progress=False,
                )
            seconds[way] = elapsed.processor_s
    return {
        "same": bool(np.array_equal(found[AUTO].transforms, found[NEVER].transforms)),
        "named": [found[AUTO].names[one.shape] for one in found[AUTO].incomplete],
        "never_s": seconds[NEVER],
        "auto_s": seconds[AUTO],
    }


CUT_COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="shapes", title="shapes"),
    Column(key="cut", title="cut"),
    Column(key="share", title="cut off, %", format=".0f"),
    Column(key="way", title="incomplete shapes are"),
    Column(key="named", title="cut ones named"),
    Column(key="wrongly", title="whole ones named"),
    Column(key="right", title="cut ones right"),
    Column(key="whole", title="whole ones right"),
    Column(key="without", title="of these, without the cut ones"),
    Column(key="worst", title="worst cut one, deg", format=".1f"),
    Column(key="noticed", title="wrong ones in doubt"),
    Column(key="same", title="whole ones the same as without"),
    Column(key="seconds", title="CPU s", format=".0f", clock=True),
)
COMPLETE_COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="shapes", title="shapes"),
    Column(key="named", title="named incomplete"),
    Column(key="same", title="same transforms"),
    Column(key="ratio", title="CPU time, looked for : not", format=".2f", clock=True),
)


def cut_row(settings: dict[str, Any], record: Record) -> Row:
    """Return what became of the cut shapes, and of the others."""
    names, errors, cut = record["names"], np.array(record["shape_deg"]), set(record["cut"])
    is_cut = np.array([name in cut for name in names])
    wrong, doubtful = errors > RIGHT_DEG, np.array(record["confidence"]) < DOUBT
    return {
        "collection": settings["collection"],
        "shapes": len(names),
        "cut": len(cut),
        "share": 100.0 * settings["share"],
        "way": "told"
        if settings["way"] == TOLD
        else "looked for"
        if settings["way"] == AUTO
        else "unknown",
        "named": len(cut & set(record["named"])),
        "wrongly": len(set(record["named"]) - cut),
        "right": int((~wrong & is_cut).sum()),
        "whole": int((~wrong & ~is_cut).sum()),
        "without": int((np.array(record["without_deg"]) <= RIGHT_DEG).sum()),
        "worst": float(errors[is_cut].max()),
        "noticed": f"{int((wrong & doubtful).sum())} of {int(wrong.sum())}",
        "same": "yes" if record["as_without"] else "no",
        "seconds": record["processor_s"],
    }


def complete_row(settings: dict[str, Any], record: Record) -> Row:
    """Return whether looking for incomplete shapes changed anything where there are none, and its cost."""
    return {
        "collection": settings["collection"],
        "shapes": settings["shapes"],
        "named": len(record["named"]),
        "same": "yes" if record["same"] else "no",
        "ratio": record["auto_s"] / record["never_s"],
    }


def measure(bench: Bench) -> Outcome:
    """Align all sets; with ``--quick`` four ants of which one is cut."""
    bench.seeds.add(SEED)
    cut_sets = (("ant", 4, 1, 0.25, TOLD, RANDOM),) if bench.quick else CUT_SETS
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
        for collection, shapes, cut, share, way, what in cut_sets
    }
    complete = {
        name: {"collection": name, "shapes": num, "seed": SEED}
        for name, num in COMPLETE_SETS
        if not bench.quick
    }
    of_sets = bench.measure(measure_cut_collection, sets, version="3")
    of_complete = bench.measure(measure_complete_collection, complete, apart=True)
    return Outcome(
        tables=(
            Table(
                caption=f"Collections. Right: within {RIGHT_DEG:.0f} degrees of the truth, and of the right side.",
                columns=CUT_COLUMNS,
                rows=tuple(cut_row(sets[label], record) for label, record in of_sets.items()),
            ),
            Table(
                name="complete",
                caption="Complete sets.",
                columns=COMPLETE_COLUMNS,
                rows=tuple(
                    complete_row(complete[label], record) for label, record in of_complete.items()
                ),
            ),
        )
    )


EXPERIMENT = Experiment(
    name="incomplete",
    title="Shapes with a part cut off",
    about=_ABOUT,
    measure=measure,
    collections=(TEETH_FOLDER, CLASSES_FOLDER, SKULLS_FOLDER),
)
