"""The scoreboard: every development set at default options, before and after a change of the product."""

from __future__ import annotations

import csv
import itertools
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression

from collalign import RunOptions, align_collection
from collalign.confidence import reliability_model
from collalign.confidence.reliability_model import STEPS
from collalign.engine.records import Record
from collalign.output.collection import Collection
from data_tools.arrays import FloatArray
from data_tools.io.files import write_atomic
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.landmarked import CLASSES, MORE_CLASSES, read_dataset
from experiments.collections.posed import GROSS_DEG, MIRRORED_DEG, PosedCollection, pose_collection
from experiments.confidence.families import FAMILIES, Family, numbered, pose_family
from experiments.confidence.reliability import SURE, USABLE
from experiments.datasets import Dataset, read_canonical_class, read_truth_folder
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.generated.animals import animal
from experiments.generated.assembled import CLASSES as ASSEMBLED
from experiments.generated.assembled import assembled_objects
from experiments.generated.rooms import depth_frames, room, way_round
from experiments.peers.capod import AXES
from experiments.peers.capod import CLASSES as CAPOD
from experiments.peers.capod import FOLDER as CAPOD_FOLDER
from experiments.peers.scans import BUNNY, read_scans
from experiments.provenance import ROOT, code_digest
from experiments.tables import Column, Row, Table

NUM_DRAWS = 2
#: Shapes of a class, of a set of landmarked or registered shapes, and of a generated family.
OF_CLASS, OF_SET, OF_FAMILY = 12, 24, 8
#: Depth images of a generated room.
NUM_FRAMES = 20
#: Folders of the data that ``truth.json`` describes.
FOLDERS = ("staple_foot10", "turtle_crania30", "kenney_guns13", "kenney_seats10", "depth_room20")
#: Words in names that tell the kinds of a mixed set apart.
KINDS = {"kenney_seats10": ("Sofa", "Chair"), "chairs and figures": ("chair", "figure")}
ANIMALS = "bending animals"
#: Fifteen generated families, among them some that mislead.
GENERATED: dict[str, Family] = {
    ANIMALS: Family(members=numbered(animal)),
    **{
        name: FAMILIES[name]
        for name in (
            "crowns, mirrored",
            "chairs",
            "bent figures",
            "near boxes",
            "chairs and figures",
            "crowns, bumpy",
            "crowns, points",
            "chairs, cut",
            "chairs, rough",
            "figures, bumpy",
            "figures, points",
            "blobs, cut",
            "blobs, stretched",
            "bones, bent",
        )
    },
}

_ABOUT = f"""
Each development set in random poses, at default options, {NUM_DRAWS} draws. Run it before a change of how shapes are
posed, and after it: the page then has both. Measurements are kept by the product's code, so that an interrupted run
goes on, and comments and docstrings change nothing.

* *Gross*: pairs off by more than {GROSS_DEG:.0f} degrees, of the wrong side, in different parts, or with a shape that
  was left out. A shape that is called alone is a part by itself. In mixed sets only pairs of one kind count, and
  vases count by their axis.
* *Median*: of the errors of pairs.
* *Right*: shapes within {GROSS_DEG:.0f} degrees of most of their part and kind. A shape that is alone in its part is
  neither right nor wrong.
* *Stated*: shapes at {SURE} or more; *wrong*: how many of these are wrong.
* *Right at {USABLE}*: the share of all right shapes that are stated at {USABLE} or more.
* *CPU*: of both draws, of one process, from the files to the result. Machines of the same name differ by a factor
  of two, so the columns compare only where one machine measured both.

Sets: {OF_CLASS} of each class of SHREC07 and CAPOD, {OF_SET} teeth, {OF_CLASS} skulls and bodies, the bunny's ten
scans, fifteen generated views each of a horse and a piano, {NUM_FRAMES} depth images each of a generated room and
a corridor, {OF_CLASS} generated objects of each of ten classes that
are assembled of boxes and cylinders, the folders {", ".join(f"`{name}`" for name in FOLDERS)} with all their shapes,
and {OF_FAMILY} shapes of each of {len(GENERATED)} generated families.
"""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A set in random poses.

    Attributes
    ----------
    posed : PosedCollection
    kinds : tuple of str
        Of each shape; poses of one kind can be compared.
    """

    posed: PosedCollection
    kinds: tuple[str, ...]


Draw = Callable[[str, Path, Path, np.random.Generator], PosedCollection]


def _some(dataset: Dataset, most: int, folder: Path, rng: np.random.Generator) -> PosedCollection:
    chosen = rng.permutation(len(dataset))[:most]
    return pose_collection(dataset, chosen, folder, rng)


def _class(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    return _some(read_dataset(name, data), OF_CLASS, folder, rng)


def _teeth(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    return _some(read_dataset(name, data), OF_SET, folder, rng)


def _capod(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    dataset = read_canonical_class(data / CAPOD_FOLDER / name)
    return pose_collection(dataset, np.arange(len(dataset)), folder, rng, axis=AXES.get(name))


def _folder(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    dataset = read_truth_folder(data / name)
    return pose_collection(dataset, np.arange(len(dataset)), folder, rng)


def _scans(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    num = 10 if name == BUNNY else 15
    scans = read_scans(name, data, num, seed=int(rng.integers(2**31)))
    for cloud in scans.clouds:
        write_mesh(folder / f"{cloud.name}.ply", cloud)
    return PosedCollection(
        folder=folder, names=tuple(cloud.name for cloud in scans.clouds), relative=scans.relative
    )


def _rooms(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    is_corridor = name == "corridor"
    parts = room(rng, corridor=is_corridor)
    way = way_round(NUM_FRAMES, rng, corridor=is_corridor)
    frames = depth_frames(parts, way, rng)
    turns = np.stack([random_rotation(rng) for _ in frames])
    for frame, turn in zip(frames, turns, strict=True):
        moved = frame.vertices @ turn.T + rng.standard_normal(3)
        write_mesh(folder / f"{frame.name}.ply", Shape.from_arrays(moved, frame.faces))
    poses = np.einsum("nab,ncb->nac", way[:, :3, :3], turns)
    return PosedCollection(
        folder=folder,
        names=tuple(frame.name for frame in frames),
        relative=np.einsum("ica,jcb->ijab", poses, poses),
    )


def _assembled(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    family = Family(members=lambda num, rng: assembled_objects(name, num, rng))
    return pose_family(family, OF_CLASS, folder, rng)


def _family(name: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    return pose_family(GENERATED[name], OF_FAMILY, folder, rng)


#: Rows of the scoreboard: what each consists of, and how it is drawn.
SETS: dict[str, tuple[tuple[str, ...], Draw]] = {
    "SHREC07": ((*CLASSES, *MORE_CLASSES), _class),
    "CAPOD": (CAPOD, _capod),
    "teeth": (("teeth",), _teeth),
    "mouse skulls": (("mouse skulls",), _class),
    "SCAPE": (("scape",), _class),
    "bunny scans": ((BUNNY,), _scans),
    "generated views": (("horse", "piano"), _scans),
    "generated rooms": (("room", "corridor"), _rooms),
    "assembled objects": (tuple(ASSEMBLED), _assembled),
    **{name: ((name,), _folder) for name in FOLDERS},
    "generated families": (tuple(GENERATED), _family),
}


def measure_set(cell: Cell) -> Record:
    """Align one draw of a collection by default.

    Settings: ``set``, ``name``, ``draw`` and ``code`` (:func:`experiments.provenance.code_digest`).

    Returns
    -------
    dict
        ``pair_deg`` (E,) of the pairs that count, ``shape_deg`` (n,), NaN where a shape is compared with none, and
        ``stated`` (n,); ``processor_s``.
    """
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        drawn = draw_set(cell, folder)
        with stopwatch() as elapsed:
            aligned = align_collection(folder, run=RunOptions(jobs=1), progress=False)
    return {**compare(aligned, drawn), "processor_s": elapsed.processor_s}


def draw_set(cell: Cell, folder: Path) -> Drawn:
    """Write one draw of a collection in random poses; settings as in :func:`measure_set`."""
    key, name, draw = (cell.settings[word] for word in ("set", "name", "draw"))
    rng = np.random.default_rng([draw, *key.encode(), *name.encode()])
    posed = SETS[key][1](name, cell.data, folder, rng)
    return Drawn(posed=posed, kinds=kinds_of(name, posed.names))


def kinds_of(name: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the kind of each shape, the same for all but in the mixed sets of :data:`KINDS`."""
    words = KINDS.get(name, ())
    return tuple(next((word for word in words if word in shape), "") for shape in names)


def compare(aligned: Collection, drawn: Drawn) -> Record:
    """Return the errors of pairs and shapes, and what was stated; see :func:`measure_set`."""
    posed, kinds = drawn.posed, drawn.kinds
    at = {name: i for i, name in enumerate(aligned.names)}
    known = [at.get(name, -1) for name in posed.names]
    errors = pair_matrix(aligned.rotations, known, posed)
    part = np.array([aligned.part_numbers[i] if i >= 0 else -1 - k for k, i in enumerate(known)])
    together = part[:, None] == part[None]
    same_kind = np.array([[a == b for b in kinds] for a in kinds])
    count = [p for p in itertools.combinations(range(len(kinds)), 2) if same_kind[p]]
    pairs = np.array([errors[p] if together[p] else MIRRORED_DEG for p in count])
    shapes = np.full(len(kinds), np.nan)
    groups = {(int(p), kind) for p, kind in zip(part, kinds, strict=True)}
    for number, kind in groups:
        members = np.flatnonzero((part == number) & (np.array(kinds) == kind))
        if len(members) > 1:
            rows = errors[np.ix_(members, members)]
            best = max(rows, key=lambda row: ((row <= GROSS_DEG).sum(), -np.median(row)))
            shapes[members] = best
    stated = np.array([aligned.confidence[i] if i >= 0 else 0.0 for i in known])
    return {"pair_deg": pairs, "shape_deg": shapes, "stated": stated}


def pair_matrix(rotations: FloatArray, known: list[int], posed: PosedCollection) -> FloatArray:
    """Return the error of every pair in degrees, shape (N, N); 180 on the wrong side or where a shape was left out.

    Parameters
    ----------
    rotations : ndarray, shape (M, 3, 3)
        ``R_common_shape`` of the shapes that were aligned.
    known : list of int
        For each of the N shapes its row there, or -1.
    posed : PosedCollection
    """
    errors = np.full((len(known), len(known)), MIRRORED_DEG)
    there = np.flatnonzero(np.array(known) >= 0)
    found = rotations[np.array(known)[there]]
    if posed.axes is None:
        relative = np.swapaxes(found, 1, 2)[:, None] @ found[None]
        angles = rotation_angle_deg(relative, posed.relative[np.ix_(there, there)])
        angles = np.where(np.isnan(angles), MIRRORED_DEG, angles)
    else:
        common = np.einsum("nij,nj->ni", found, posed.axes[there])
        angles = np.degrees(np.arccos(np.clip(common @ common.T, -1.0, 1.0)))
    errors[np.ix_(there, there)] = angles
    np.fill_diagonal(errors, 0.0)
    return errors


FIGURES: dict[str, tuple[str, str]] = {
    "gross": ("gross, %", ".1f"),
    "median": ("median, deg", ".1f"),
    "sure": (f"stated at {SURE}", ""),
    "wrong_sure": (f"wrong at {SURE}", ""),
    "usable": (f"right at {USABLE}, %", ".0f"),
    "processor_s": ("CPU, s", ".0f"),
}
#: What the key of a figure of the code before ends with.
BEFORE = "_before"


def _columns() -> tuple[Column, ...]:
    columns = [
        Column(key="set", title="set"),
        Column(key="runs", title="runs"),
        Column(key="shapes", title="shapes"),
    ]
    for key, (title, form) in FIGURES.items():
        clock = key == "processor_s"
        columns.append(Column(key=key, title=title, format=form, clock=clock))
        columns.append(Column(key=key + BEFORE, title="before", format=form, clock=clock))
    return (*columns, Column(key="code", title="code"), Column(key="code" + BEFORE, title="before"))


COLUMNS = _columns()
RELIABILITY = (
    Column(key="from", title="stated at", format=".3f"),
    Column(key="shapes", title="shapes"),
    Column(key="right", title="right"),
    Column(key="expected", title="expected", format=".3f"),
)


def figures_of(records: Sequence[Record]) -> Row:
    """Return the :data:`FIGURES` of some records together, but for the time."""
    pairs, shapes, stated = (
        np.concatenate([record[key] for record in records])
        for key in ("pair_deg", "shape_deg", "stated")
    )
    right, wrong = shapes <= GROSS_DEG, shapes > GROSS_DEG
    return {
        "gross": 100.0 * float((pairs > GROSS_DEG).mean()),
        "median": float(np.median(pairs)),
        "sure": int((stated >= SURE).sum()),
        "wrong_sure": int((wrong & (stated >= SURE)).sum()),
        "usable": 100.0 * float((stated[right] >= USABLE).mean()) if right.any() else None,
    }


def row_of(name: str, records: list[Record], code: str, before: Mapping[str, str] | None) -> Row:
    """Return the row of a set: its figures, and those of the code before where they are known."""
    row: Row = {
        "set": name,
        "runs": len(records),
        "shapes": sum(len(record["shape_deg"]) for record in records),
        **figures_of(records),
        "processor_s": float(sum(record["processor_s"] for record in records)),
        "code": code,
    }
    return {**row, **_before(code, before)}


def _before(code: str, measured: Mapping[str, str] | None) -> dict[str, Any]:
    """Return the figures of another code: those of the table as it lies there, or what it had as before."""
    if measured is None:
        return {}
    end = BEFORE if measured["code"] == code else ""
    if not measured["code" + end]:
        return {}
    found: dict[str, Any] = {"code" + BEFORE: measured["code" + end]}
    for key, (_, form) in FIGURES.items():
        value = measured[key + end]
        found[key + BEFORE] = None if value == "" else (float(value) if form else int(value))
    return found


def read_before(file: Path) -> dict[str, dict[str, str]]:
    """Return the rows of a table that was written before by their names; none where there is no file."""
    if not file.is_file():
        return {}
    with file.open(newline="", encoding="utf-8") as stream:
        return {row["set"]: row for row in csv.DictReader(stream)}


def reliability_rows(stated: FloatArray, errors_deg: FloatArray) -> tuple[Row, ...]:
    """Return how many shapes (n,) are right by what they are stated at, and what to expect of each step.

    Expected is the share with one right and one wrong shape added, never falling with the confidence (isotonic
    regression).
    """
    known = ~np.isnan(errors_deg) & ~np.isnan(stated)
    step = np.searchsorted(STEPS, stated[known] + np.finfo(np.float32).eps, side="right") - 1
    shapes = np.bincount(step, minlength=len(STEPS))
    right = np.bincount(step, weights=errors_deg[known] <= GROSS_DEG, minlength=len(STEPS))
    expected = isotonic_regression((right + 1.0) / (shapes + 2.0), weights=shapes + 2.0).x
    return tuple(
        {
            "from": float(STEPS[k]),
            "shapes": int(shapes[k]),
            "right": int(right[k]),
            "expected": value,
        }
        for k, value in enumerate(expected.tolist())
    )


def write_reliability(rows: Sequence[Row], file: Path) -> None:
    """Write what to expect of each step, rounded down, as :mod:`collalign.confidence.reliability_model` reads it."""
    shares = (math.floor(1000 * float(row["expected"] or 0.0)) / 1000 for row in rows)
    lines = [f"{row['from']},{share}\n" for row, share in zip(rows, shares, strict=True)]
    write_atomic(file, "".join(["stated,right\n", *lines]).encode())


def members_of(bench: Bench) -> tuple[dict[str, tuple[str, str]], range]:
    """Return set and collection by label, and the draws; with ``--quick`` one draw of one generated family."""
    sets = {"generated families": (("chairs",), _family)} if bench.quick else SETS
    draws = range(1 if bench.quick else NUM_DRAWS)
    bench.seeds.update(draws)
    return {
        f"{key}: {name}": (key, name) for key, (names, _) in sets.items() for name in names
    }, draws


def measure(bench: Bench) -> Outcome:
    """Measure all sets."""
    (members, draws), code = members_of(bench), code_digest(ROOT)
    cells: dict[str, dict[str, Any]] = {
        f"{label}, draw {draw}": {"set": key, "name": name, "draw": draw, "code": code}
        for draw in draws
        for label, (key, name) in members.items()
    }
    found = bench.measure(measure_set, cells)
    records = {label: [found[f"{label}, draw {draw}"] for draw in draws] for label in members}

    def table(groups: Mapping[str, Sequence[str]], name: str = "", caption: str = "") -> Table:
        file = "_".join(filter(None, ("scoreboard", name))) + ".csv"
        before = {} if bench.results is None else read_before(bench.results / file)
        rows = (
            row_of(
                group, [one for label in labels for one in records[label]], code, before.get(group)
            )
            for group, labels in groups.items()
        )
        return Table(columns=COLUMNS, rows=tuple(rows), name=name, caption=caption)

    by_set: dict[str, list[str]] = {}
    for label, (key, _) in members.items():
        by_set.setdefault(key, []).append(label)
    every = [one for of in records.values() for one in of]
    stated, errors_deg = (
        np.concatenate([one[key] for one in every]) for key in ("stated", "shape_deg")
    )
    counted = reliability_rows(stated, errors_deg)
    if not bench.quick:
        write_reliability(
            counted, Path(reliability_model.__file__).with_name(reliability_model.FILE)
        )
    return Outcome(
        tables=(
            table(by_set | {"all sets": [*records]}),
            table(
                {label: (label,) for label in records}, "collections", "Collection by collection."
            ),
            Table(
                columns=RELIABILITY,
                rows=counted,
                name="reliability",
                caption="Shapes by what they are stated at, each row up to the next one: the share that is right, as "
                "these shapes let expect it. `collection.select(right=...)` takes it from here.",
            ),
        )
    )


EXPERIMENT = Experiment(
    name="scoreboard",
    title="Scoreboard: every development set, before and after a change",
    about=_ABOUT,
    measure=measure,
    collections=(
        "teeth_pnas116",
        "shrec07_dev",
        "mouse_skulls62",
        "scape71",
        "capod7",
        "stanford_bunny_scans",
        *FOLDERS,
    ),
    seen=("teeth", "shrec07", "capod", "scape"),
)
