"""Every mechanism of a run switched off, one at a time: what moves, and what it costs."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.align import matched_samples
from collalign.engine.records import Record
from collalign.engine.session import Session
from collalign.output.collection import Collection
from collalign.products.pair import are_weighed
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.collections.landmarked import CLASSES, MORE_CLASSES, RIGHT_DEG, read_dataset
from experiments.collections.posed import GROSS_DEG, MIRRORED_DEG, PosedCollection, pose_collection
from experiments.collections.switches import (
    ALWAYS,
    BENT,
    MAPS,
    OPEN,
    PAIRS,
    SHAPES,
    SWITCHES,
    Remembered,
    switched_off,
)
from experiments.confidence.families import FAMILIES, NUM_VERTICES, Family, pose_family
from experiments.confidence.reliability import SURE, USABLE
from experiments.datasets import read_canonical_class
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.pairs.incomplete import without_share
from experiments.peers.bones import bone
from experiments.tables import Column, Row, Table

CAPOD_FOLDER, CAPOD = "capod7", ("guitar", "spider", "dolphin", "gun", "horse", "piano")
#: Collections by what they are called: where their shapes come from, and how many are drawn.
SETS: dict[str, dict[str, Any]] = {
    **{name: {"source": name, "shapes": 8} for name in (*CLASSES, *MORE_CLASSES, *CAPOD)},
    "scape": {"source": "scape", "shapes": 10},
    "armadillo": {"source": "armadillo", "shapes": 10},
    "teeth": {"source": "teeth", "shapes": 12},
    "teeth, sparse": {"source": "teeth", "shapes": 24, "pairs": "adaptive"},
    "mouse skulls": {"source": "mouse skulls", "shapes": 10},
    "few humans": {"source": "human", "shapes": 6},
    "few planes": {"source": "plane", "shapes": 6},
    "teeth, two cut": {"source": "teeth", "shapes": 10, "cut": 2},
    "skulls, two cut": {"source": "mouse skulls", "shapes": 10, "cut": 2},
    "crowns, mirrored": {"source": "crowns, mirrored", "shapes": 10},
    "hard chairs": {"source": "chairs, bumpy", "shapes": 10},
    "bent figures": {"source": "bent figures", "shapes": 9},
    "chairs, four copies": {"source": "chairs", "shapes": 8, "copies": 4},
    "long bones": {"source": "long bones", "shapes": 12},
}
NUM_DRAWS = 2
#: Share of a shape that is cut off.
CUT_SHARE = 0.35
VERSION = "2"

LONG_BONES = Family(
    members=lambda num, rng: tuple(
        bone(*sphere_mesh(NUM_VERTICES), rng, f"bone{i:02d}") for i in range(num)
    )
)

_ABOUT = f"""
Every collection in random poses at default options, {NUM_DRAWS} draws; then the same again with one mechanism of a
run switched off, shapes and pairs from the same store. A row sums all collections, and says what the mechanism moves:
*gross* are pairs beyond {GROSS_DEG:.0f} deg (mirrored ones among them), *wrong and sure* are shapes beyond
{RIGHT_DEG:.0f} deg at {SURE} or more, *right and usable* are shapes within, at {USABLE} or more, *median* is the mean
over collections of the median error of pairs. A mechanism is switched off only where it can do anything; elsewhere
the figures of the complete run count. Weights are not fitted again. Refinement, rival poses and mirror images are
computed once for the same arguments; the time saved is what a run without that would save.
"""

_TEXT = """
**What went.** The runs of this page knew three more mechanisms. A second start of the synchronization, and the
comparison of what both starts lead to, moved no pose of any run. Eigenvectors alone gave the same poses as reweighted
averaging before them on eight of these collections, and were as good on 21 planted graphs. Weights of near pairs in
refinement moved the mean median error by .02 deg, better without them.

**What stays without a figure here.** Turns common to wrong pairs keep shapes whose pairs are wrong alike from high
confidences. On 20 planted graphs (100 shapes, 10 pairs each, 30 % flips, one candidate a pair; seeds 2000 to 2019)
3 of 1844 shapes stated at .95 are wrong with them, and 28 of 1972 without. With four candidates a pair nothing
moves. Growing the graph, ties, shapes that resemble no other and scans are for collections that
are not among these. Doubts settled by maps move little among eight or ten shapes. In two draws of twenty, 36 of 40
planes and 34 of 40 humans are usable with them, 27 and 23 without. Averages over seven ways are worth 5 deg on ants,
which one collection of birds with three wrong shapes hides in the mean.

**What to look at next.** Rotations that neighbourhoods propose take a tenth of a run, and gain one armadillo. Five of
nine bent figures are the wrong way round in one draw, and four of ten mirrored crowns on the wrong side: half of all
wrong shapes, and most of the mean median error. The figures are right without neighbourhoods.
"""


def measure_collection(cell: Cell) -> Record:
    """Align a collection with everything, and with each mechanism switched off.

    Settings: those of :data:`SETS`, ``seed``, and ``switches``.

    Returns
    -------
    dict
        By switch, "" for the complete run: ``pairs`` and ``shapes`` (errors in degrees), ``confidence``, and
        ``saved_s``: CPU time less than that of the complete run from the same stored results on.
    """
    settings, remembered = cell.settings, Remembered()
    with remembered.used(), tempfile.TemporaryDirectory() as name:
        root = Path(name)
        (root / "shapes").mkdir()
        posed = posed_set(settings, cell.data, root / "shapes")
        options = AlignOptions(pairs=settings.get("pairs", "auto"))
        stores = Stores(root, options, remembered)
        record: Record = {"": facts(stores.complete, posed)}
        for name in settings["switches"]:
            switch = SWITCHES[name]
            if applies(switch.where, stores.complete):
                with switched_off(switch):
                    found, processor_s = stores.run(switch.since)
                record[name] = facts(found, posed) | {
                    "saved_s": stores.complete_s[switch.since] - processor_s
                }
        return record


class Stores:
    """Stores of the shapes of a folder, of their pairs as well, and of maps as well; runs start from copies of them.

    Parameters
    ----------
    root : Path
        Holds the folder ``shapes``, and gets the stores.
    options : AlignOptions
    remembered : Remembered
        In use.

    Attributes
    ----------
    complete : Collection
        The run without a switch.
    complete_s : dict
        Its CPU time by what was taken from a store.
    """

    def __init__(self, root: Path, options: AlignOptions, remembered: Remembered) -> None:
        self._root, self._options = root, options
        self._remembered = remembered
        with Session.open(options, RunOptions(jobs=1, store=self._path(SHAPES))) as session:
            matched_samples(session, list_shapes(root / "shapes"))
        _, pairs_s = self._fill(PAIRS, SHAPES, replace(options, maps="never"))
        self.complete, maps_s = self._fill(MAPS, PAIRS, options)
        _, rest_s = self.run(MAPS)
        self.complete_s = {SHAPES: pairs_s + maps_s - rest_s, PAIRS: maps_s, MAPS: rest_s}

    def run(self, since: str) -> tuple[Collection, float]:
        """Align from a copy of a store; also return the seconds of CPU time."""
        with tempfile.TemporaryDirectory() as name:
            return self._align(self._options, Path(shutil.copy(self._path(since), name)))

    def _fill(self, kind: str, before: str, options: AlignOptions) -> tuple[Collection, float]:
        return self._align(options, Path(shutil.copy(self._path(before), self._path(kind))))

    def _align(self, options: AlignOptions, store: Path) -> tuple[Collection, float]:
        run, start_s = (
            RunOptions(jobs=1, store=store),
            time.process_time() + self._remembered.saved_s,
        )
        found = align_collection(self._root / "shapes", options=options, run=run, progress=False)
        return found, time.process_time() + self._remembered.saved_s - start_s

    def _path(self, kind: str) -> Path:
        return self._root / f"{kind}.sqlite"


def applies(where: str, complete: Collection) -> bool:
    """Whether a mechanism may do anything for a collection, given its complete run."""
    is_open = bool(complete.incomplete) or "incomplete shapes" in complete.run.times_s
    return {ALWAYS: True, BENT: are_weighed(complete.pairs), OPEN: is_open}[where]


def facts(found: Collection, posed: PosedCollection) -> Record:
    """Return the errors of pairs and shapes in degrees, 180 where mirrored, and the confidences."""
    return {
        "pairs": np.nan_to_num(
            posed.pair_errors_deg(found.rotations, found.names), nan=MIRRORED_DEG
        ),
        "shapes": posed.shape_errors_deg(found.rotations, found.names),
        "confidence": np.array(found.confidence),
    }


def posed_set(settings: dict[str, Any], data: Path, folder: Path) -> PosedCollection:
    """Write a draw of a collection of :data:`SETS` in random poses."""
    rng = np.random.default_rng(settings["seed"])
    source, num = settings["source"], settings["shapes"]
    family = {"long bones": LONG_BONES, **FAMILIES}.get(source)
    if family is not None:
        posed = pose_family(family, num, folder, rng)
    else:
        dataset = (
            read_canonical_class(data / CAPOD_FOLDER / source)
            if source in CAPOD
            else read_dataset(source, data)
        )
        posed = pose_collection(dataset, rng.permutation(len(dataset))[:num], folder, rng)
    for name in posed.names[: settings.get("cut", 0)]:
        file = folder / f"{name}.ply"
        write_mesh(file, without_share(read_shape(file), rng.standard_normal(3), CUT_SHARE))
    return with_copies(posed, settings.get("copies", 0), rng)


def with_copies(posed: PosedCollection, num: int, rng: np.random.Generator) -> PosedCollection:
    """Add copies of the first shape in random poses."""
    rotations = [random_rotation(rng) for _ in range(num)]
    first = read_shape(posed.folder / f"{posed.names[0]}.ply")
    names = tuple(f"copy{i}" for i in range(num))
    for name, rotation in zip(names, rotations, strict=True):
        write_mesh(
            posed.folder / f"{name}.ply",
            Shape.from_arrays(first.vertices @ rotation.T, first.faces, name=name),
        )
    to_first = np.stack([*posed.relative[0], *(rotation.T for rotation in rotations)])  # R_first_i
    relative = np.swapaxes(to_first, 1, 2)[:, None] @ to_first
    given = len(posed.names)
    relative[:given, :given] = posed.relative
    return replace(posed, names=(*posed.names, *names), relative=relative)


def row_of(name: str, records: Sequence[Record]) -> Row:
    """Return the row of a switch, summed over the draws of all collections; "" is the complete run."""
    changed = [record for record in records if name in record]
    rows = [record[name if name in record else ""] for record in records]
    pairs = np.concatenate([row["pairs"] for row in rows])
    wrong = np.concatenate([row["shapes"] > RIGHT_DEG for row in rows])
    confidence = np.concatenate([row["confidence"] for row in rows])
    others = [(record[name], record[""]) for record in changed] if name else []
    return {
        "off": name or "nothing",
        "runs": len(changed),
        "differ": sum(not np.allclose(own["pairs"], one["pairs"], atol=0.1) for own, one in others),
        "gross": 100.0 * float((pairs > GROSS_DEG).mean()),
        "wrong": int(wrong.sum()),
        "median": float(np.mean([np.median(row["pairs"]) for row in rows])),
        "sure": int((confidence >= SURE).sum()),
        "wrong_sure": int((wrong & (confidence >= SURE)).sum()),
        "right": int((~wrong).sum()),
        "usable": int((~wrong & (confidence >= USABLE)).sum()),
        "saved": float(sum(own["saved_s"] for own, _ in others)),
    }


COLUMNS = (
    Column(key="off", title="switched off"),
    Column(key="runs", title="runs"),
    Column(key="differ", title="of these with other poses"),
    Column(key="gross", title="gross pairs, %", format=".2f"),
    Column(key="wrong", title="wrong shapes"),
    Column(key="median", title="median, deg", format=".2f"),
    Column(key="sure", title=f"shapes at {SURE}"),
    Column(key="wrong_sure", title="wrong and sure"),
    Column(key="right", title="right"),
    Column(key="usable", title="right and usable"),
    Column(key="saved", title="CPU time saved, s", format=".1f", clock=True),
)


def measure(bench: Bench) -> Outcome:
    """Measure all collections; with ``--quick`` one draw of four generated chairs."""
    sets = {"hard chairs": {**SETS["hard chairs"], "shapes": 4}} if bench.quick else SETS
    draws = range(1 if bench.quick else NUM_DRAWS)
    bench.seeds.update(draws)
    cells = {
        f"{name}, draw {seed}": {**given, "seed": seed, "switches": tuple(SWITCHES)}
        for seed in draws
        for name, given in sets.items()
    }
    records = bench.measure(measure_collection, cells, version=VERSION)
    rows = tuple(row_of(name, list(records.values())) for name in ("", *SWITCHES))
    sets_rows = tuple(
        {"set": name, **row_of("", [records[f"{name}, draw {seed}"] for seed in draws])}
        for name in sets
    )
    moved = tuple(
        {"set": label, **row_of(switch, [record]), "off": switch}
        for label, record in records.items()
        for switch in SWITCHES
        if switch in record and moves(record[switch], record[""])
    )
    of_set = (Column(key="set", title="collection"), *COLUMNS)
    return Outcome(
        tables=(
            Table(columns=COLUMNS, rows=rows),
            Table(name="sets", columns=of_set, rows=sets_rows, caption="The complete runs."),
            Table(
                name="moved",
                columns=of_set,
                rows=moved,
                caption="Runs in which a mechanism moves a shape.",
            ),
        ),
        text="" if bench.quick else _TEXT,
    )


def moves(own: Record, complete: Record) -> bool:
    """Whether a switch turns a shape right or wrong, or makes it sure or usable or not so."""
    limits = (("shapes", RIGHT_DEG), ("confidence", SURE), ("confidence", USABLE))
    return any(
        not np.array_equal(own[kind] >= limit, complete[kind] >= limit) for kind, limit in limits
    )


EXPERIMENT = Experiment(
    name="ablation",
    title="Ablation: what each mechanism of a run is worth",
    about=_ABOUT,
    measure=measure,
    collections=("teeth_pnas116", "shrec07_dev", "mouse_skulls62", "scape71", "capod7"),
    seen=("teeth", "shrec07", "capod", "scape"),
)
