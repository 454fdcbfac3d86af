"""Several kinds of shapes in one folder: which are found, and how each is posed."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.records import Record
from collalign.engine.session import Session
from collalign.output.collection import Collection
from collalign.stages.kinds.find import find_kinds
from collalign.stages.kinds.grouping import FEWEST_OF_KIND
from collalign.stages.kinds.plan import read_all_kinds
from data_tools.arrays import IntArray
from data_tools.checks import as_options
from data_tools.io.objects import list_shapes
from experiments.clock import stopwatch
from experiments.collections.landmarked import CLASSES, MORE_CLASSES, read_dataset
from experiments.collections.posed import GROSS_DEG, PosedCollection, pose_collection
from experiments.collections.scoreboard import Drawn, compare
from experiments.confidence.families import FAMILIES, Family, pose_family
from experiments.confidence.reliability import SURE
from experiments.datasets import Dataset, read_canonical_class, read_truth_folder
from experiments.experiment import QUICK_OPTIONS, Bench, Cell, Experiment, Outcome
from experiments.generated.assembled import CLASSES as ASSEMBLED
from experiments.generated.assembled import assembled_objects
from experiments.peers.capod import AXES
from experiments.peers.capod import CLASSES as CAPOD
from experiments.peers.capod import FOLDER as CAPOD_FOLDER
from experiments.provenance import ROOT, code_digest
from experiments.tables import Column, Row, Table

NUM_DRAWS = 3
#: Shapes of each kind in a mixture, of two kinds that are many, and of a set of one kind.
OF_KIND, OF_MANY, OF_ONE = 5, 10, 12
SEATS, GUNS = "kenney_seats10", "kenney_guns13"
#: Kinds that are generated as one family each.
FAMILIES_MIXED = ("crowns", "blobs, rough")
#: Writes some shapes of a kind into a folder, in random poses.
Draw = Callable[[Path, Path, np.random.Generator], PosedCollection]

_ABOUT = f"""
Folders of several kinds in random poses, at default options: {OF_KIND} shapes a kind, the seats and guns all,
{OF_MANY} skulls and as many molars. Number of draws: {NUM_DRAWS}.

* *Purity*: shapes that are of the kind which most of their found kind are of.
* *Split*: kinds of which two found kinds have {FEWEST_OF_KIND} shapes or more. *Alone*: shapes that are the only one
  of a found kind.
* *Gross*: pairs within a kind that are off by more than {GROSS_DEG:.0f} degrees, or of different found kinds. Vases
  count by their axis.
* *Stated*: shapes at {SURE} or more; *wrong*: how many of these are more than {GROSS_DEG:.0f} degrees off most of
  their kind.
* *CPU*: of all draws, of one process, from the files to the result.

The second table has folders of one kind, {OF_ONE} shapes or all: *found* are its kinds, of which there should be one.
"""


def _some(read: Callable[[Path], Dataset], num: int, word: str = "", name: str = "") -> Draw:
    def draw(data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
        dataset = read(data)
        able = [i for i, one in enumerate(dataset.names) if word in one]
        return pose_collection(
            dataset, rng.permutation(able)[:num], folder, rng, axis=AXES.get(name)
        )

    return draw


def _of_capod(name: str, num: int) -> Draw:
    return _some(lambda data: read_canonical_class(data / CAPOD_FOLDER / name), num, name=name)


def _of_folder(name: str, num: int, word: str = "") -> Draw:
    return _some(lambda data: read_truth_folder(data / name), num, word)


def _landmarked(name: str, num: int) -> Draw:
    return _some(partial(read_dataset, name), num)


def generated_kind(name: str) -> Family:
    """Return a kind of generated objects: a class that is assembled of components, or a family."""
    if name in ASSEMBLED:
        return Family(members=lambda num, rng: assembled_objects(name, num, rng))
    return FAMILIES[name]


def _generated(name: str, num: int) -> Draw:
    return lambda data, folder, rng: pose_family(generated_kind(name), num, folder, rng)


#: The kinds of each mixture.
MIXTURES: dict[str, dict[str, Draw]] = {
    "CAPOD": {name: _of_capod(name, OF_KIND) for name in CAPOD},
    "SHREC07, stiff": {
        name: _landmarked(name, OF_KIND)
        for name in ("bird", "chair", "fish", "glasses", "plane", "teddy")
    },
    "SHREC07": {name: _landmarked(name, OF_KIND) for name in (*CLASSES, *MORE_CLASSES)},
    "seats": {word: _of_folder(SEATS, 99, word) for word in ("Chair", "Sofa")},
    "seats and guns": {
        **{word: _of_folder(SEATS, 99, word) for word in ("Chair", "Sofa")},
        "gun": _of_folder(GUNS, 99),
    },
    "skulls and molars": {name: _landmarked(name, OF_MANY) for name in ("mouse skulls", "teeth")},
    "generated": {name: _generated(name, OF_KIND) for name in (*ASSEMBLED, *FAMILIES_MIXED)},
}
#: Sets of one kind.
SINGLES: dict[str, Draw] = {
    **{name: _landmarked(name, OF_ONE) for name in ("teeth", "mouse skulls")},
    **{name: _landmarked(name, OF_ONE) for name in ("glasses", "ant", "human", "bird")},
    **{name: _of_capod(name, OF_ONE) for name in ("guitar", "horse")},
    **{name: _of_folder(name, OF_ONE) for name in ("staple_foot10", "turtle_crania30")},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnKinds:
    """Shapes of several kinds in random poses, each kind in a folder of its name; shapes are called by both."""

    kinds: dict[str, PosedCollection]

    @property
    def names(self) -> tuple[str, ...]:
        """All shapes, kind by kind."""
        return tuple(name for posed in self.kinds.values() for name in posed.names)

    @property
    def labels(self) -> IntArray:
        """The kind of each, from 0."""
        sizes = [len(posed.names) for posed in self.kinds.values()]
        return np.repeat(np.arange(len(sizes)), sizes)


def draw_kinds(
    kinds: Mapping[str, Draw], data: Path, folder: Path, rng: np.random.Generator
) -> DrawnKinds:
    """Write the shapes of every kind into its folder."""
    found = {}
    for name, draw in kinds.items():
        own = folder / name.replace(", ", "-")
        own.mkdir()
        posed = draw(data, own, rng)
        found[name] = replace(posed, names=tuple(f"{own.name}/{one}" for one in posed.names))
    return DrawnKinds(kinds=found)


def judge(aligned: Collection, drawn: DrawnKinds) -> Record:
    """Return what became of kinds that were mixed.

    Returns
    -------
    dict
        ``pair_deg``, ``shape_deg`` and ``stated`` as :func:`experiments.collections.scoreboard.compare` has them, of
        all kinds; ``true`` and ``found`` (n,), the kinds of the shapes, -1 where one was left out.
    """
    each = [
        compare(aligned, Drawn(posed=posed, kinds=("",) * len(posed.names)))
        for posed in drawn.kinds.values()
    ]
    of_shape = np.zeros(len(aligned.names), dtype=np.int64)
    for number, kind in enumerate(aligned.kinds):
        of_shape[kind.shapes] = number
    at = {name: i for i, name in enumerate(aligned.names)}
    found = [of_shape[at[name]] if name in at else -1 for name in drawn.names]
    whole = {key: np.concatenate([one[key] for one in each]) for key in each[0]}
    return {**whole, "true": drawn.labels, "found": np.array(found)}


def measure_mixture(cell: Cell) -> Record:
    """Align one draw of a mixture by default.

    Settings: ``set``, ``draw``, ``options`` and ``code`` (:func:`experiments.provenance.code_digest`). Returns what
    :func:`judge` does, and ``processor_s``.
    """
    name, draw = cell.settings["set"], cell.settings["draw"]
    rng = np.random.default_rng([draw, *name.encode()])
    with tempfile.TemporaryDirectory() as text:
        drawn = draw_kinds(MIXTURES[name], cell.data, Path(text), rng)
        with stopwatch() as elapsed:
            aligned = align_collection(
                text,
                recursive=True,
                options=cell.settings["options"],
                run=RunOptions(jobs=1),
                progress=False,
            )
    return {**judge(aligned, drawn), "processor_s": elapsed.processor_s}


def measure_single(cell: Cell) -> Record:
    """Look for kinds in one draw of a set of one kind; settings as :func:`measure_mixture`."""
    name, draw = cell.settings["set"], cell.settings["draw"]
    rng = np.random.default_rng([draw, *name.encode()])
    with tempfile.TemporaryDirectory() as text:
        posed = SINGLES[name](cell.data, Path(text), rng)
        options = as_options("options", cell.settings["options"], AlignOptions, {})
        with Session.open(options, RunOptions(jobs=1), None) as session:
            session, shapes = read_all_kinds(session, list_shapes(text), {})
            found = find_kinds(session, shapes)
    return {"shapes": len(posed.names), "found": 1 if found is None else found.num}


def purity(true: IntArray, found: IntArray) -> float:
    """Return the share of shapes that are of the kind which most of their found kind are of."""
    most = [np.bincount(true[found == one]).max() for one in np.unique(found[found >= 0])]
    return float(sum(most)) / len(true)


def num_split(true: IntArray, found: IntArray) -> int:
    """Return how many kinds are split: two found kinds or more have several of its shapes."""
    several = 0
    for kind in np.unique(true):
        own = found[(true == kind) & (found >= 0)]
        several += int((np.unique(own, return_counts=True)[1] >= FEWEST_OF_KIND).sum() > 1)
    return several


def num_alone(found: IntArray) -> int:
    """Return how many shapes are the only one of a found kind."""
    return int((np.unique(found[found >= 0], return_counts=True)[1] == 1).sum())


def row_of(name: str, records: list[Record]) -> Row:
    """Return the row of all draws of a mixture."""
    pairs, shapes, stated = (
        np.concatenate([one[key] for one in records]) for key in ("pair_deg", "shape_deg", "stated")
    )
    sure = stated >= SURE
    labels = [(one["true"], one["found"]) for one in records]
    return {
        "set": name,
        "runs": len(records),
        "shapes": len(shapes),
        "kinds": sum(len(np.unique(true)) for true, _ in labels),
        "found": sum(len(np.unique(found[found >= 0])) for _, found in labels),
        "purity": 100.0 * float(np.mean([purity(*both) for both in labels])),
        "split": sum(num_split(*both) for both in labels),
        "alone": sum(num_alone(found) for _, found in labels),
        "gross": 100.0 * float((pairs > GROSS_DEG).mean()),
        "sure": int(sure.sum()),
        "wrong_sure": int((sure & (shapes > GROSS_DEG)).sum()),
        "processor_s": float(sum(one["processor_s"] for one in records)),
    }


COLUMNS = (
    Column(key="set", title="set"),
    Column(key="runs", title="runs"),
    Column(key="shapes", title="shapes"),
    Column(key="kinds", title="kinds"),
    Column(key="found", title="found"),
    Column(key="purity", title="purity, %", format=".1f"),
    Column(key="split", title="split"),
    Column(key="alone", title="alone"),
    Column(key="gross", title="gross, %", format=".1f"),
    Column(key="sure", title=f"stated at {SURE}"),
    Column(key="wrong_sure", title=f"wrong at {SURE}"),
    Column(key="processor_s", title="CPU, s", format=".0f", clock=True),
)
SINGLE_COLUMNS = (
    Column(key="set", title="set of one kind"),
    Column(key="runs", title="runs"),
    Column(key="shapes", title="shapes"),
    Column(key="found", title="found"),
)


def measure(bench: Bench) -> Outcome:
    """Measure all draws of all sets; with ``--quick`` one draw of the seats and of one class."""
    mixtures = ["seats"] if bench.quick else [*MIXTURES]
    singles = ["guitar"] if bench.quick else [*SINGLES]
    draws = range(1 if bench.quick else NUM_DRAWS)
    settings = {"options": QUICK_OPTIONS if bench.quick else {}, "code": code_digest(ROOT)}
    bench.seeds.update(draws)

    def cells(names: list[str]) -> dict[str, dict[str, Any]]:
        return {
            f"{name}, draw {draw}": {"set": name, "draw": draw, **settings}
            for draw in draws
            for name in names
        }

    found = bench.measure(measure_mixture, cells(mixtures))
    alone = bench.measure(measure_single, cells(singles))
    rows = [row_of(name, [found[f"{name}, draw {draw}"] for draw in draws]) for name in mixtures]
    single_rows: list[Row] = []
    for name in singles:
        records = [alone[f"{name}, draw {draw}"] for draw in draws]
        single_rows.append(
            {
                "set": name,
                "runs": len(records),
                "shapes": sum(one["shapes"] for one in records),
                "found": sum(one["found"] for one in records),
            }
        )
    return Outcome(
        tables=(
            Table(columns=COLUMNS, rows=tuple(rows)),
            Table(columns=SINGLE_COLUMNS, rows=tuple(single_rows), name="singles"),
        )
    )


EXPERIMENT = Experiment(
    name="kinds",
    title="Kinds: several sorts of things in one folder",
    about=_ABOUT,
    measure=measure,
    collections=(
        "teeth_pnas116",
        "shrec07_dev",
        "mouse_skulls62",
        CAPOD_FOLDER,
        SEATS,
        GUNS,
        "staple_foot10",
        "turtle_crania30",
    ),
    seen=("teeth", "shrec07", "capod"),
)
