"""A library of generated objects of many kinds: aligned at once, and grown in several steps."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collalign import RunOptions, add_to_collection, align_collection
from collalign.engine.records import Record
from collalign.output.collection import Collection
from data_tools.arrays import FloatArray, IntArray
from data_tools.datasets.synthetic import planted_collection
from data_tools.io.shapes import write_mesh
from data_tools.poses import AGREE_DEG
from data_tools.rotations import rotation_angle_deg
from experiments.clock import Elapsed, Memory, memory_watch, stopwatch
from experiments.collections.kinds import FAMILIES_MIXED, generated_kind, purity
from experiments.collections.posed import GROSS_DEG
from experiments.experiment import QUICK_OPTIONS, Bench, Cell, Experiment, Outcome
from experiments.generated.assembled import CLASSES as ASSEMBLED
from experiments.provenance import ROOT, code_digest
from experiments.tables import Column, Row, Table

KINDS = (*ASSEMBLED, *FAMILIES_MIXED)
NUM_SHAPES, NUM_STEPS, NUM_JOBS = 500, 5, 2
#: A quick run has two kinds of closed surfaces, and three objects of each in both steps: fewer make no kind.
NUM_QUICK, QUICK_STEPS, QUICK_KINDS = 12, 2, ("chairs", "blobs, rough")
AT_ONCE, GROWN = "at once", "grown"

_ABOUT = f"""
{NUM_SHAPES} generated objects of {len(KINDS)} kinds in random poses, on {NUM_JOBS} processes: in one run, and as a
library that grows: a first run and {NUM_STEPS - 1} times `add`, a fifth of each kind every time.

* *Purity*: shapes that are of the kind which most of their found kind are of.
* *Gross*: pairs within a kind that are off by more than {GROSS_DEG:.0f} degrees, or of different found kinds.
* *As at once*: of pairs within a kind that both ways pose together, those whose relative rotations agree to
  {AGREE_DEG:.0f} degrees.
* *Memory*: the most that the process and its workers had at one time, with the Python of this experiment.

A measurement of one way is one cell: a clock that was stopped between says nothing.
"""


def write_library(
    folder: Path, num: int, num_steps: int, called: Sequence[str], seed: int
) -> tuple[dict[str, int], dict[str, FloatArray]]:
    """Write a library of so many objects in random poses, a folder for each step.

    Returns
    -------
    kinds : dict of str to int
        Of each shape by name.
    rotations : dict of str to ndarray, shape (3, 3)
        ``R_common_shape`` of each.
    """
    rng = np.random.default_rng(seed)
    kinds, rotations = dict[str, int](), dict[str, FloatArray]()
    for kind, of in enumerate(called):
        size = num // len(called) + (kind < num % len(called))
        planted = planted_collection(generated_kind(of).members(size, rng), rng)
        for i, (shape, rotation) in enumerate(zip(planted.shapes, planted.rotations, strict=True)):
            own = folder / f"step{i % num_steps}"
            own.mkdir(exist_ok=True)
            name = f"object{len(kinds):03d}"
            write_mesh(own / f"{name}.ply", shape)
            kinds[name], rotations[name] = kind, rotation
    return kinds, rotations


def measure_way(cell: Cell) -> Record:
    """Align a library one way.

    Settings: ``way``, ``num`` (shapes), ``steps``, ``kinds`` (their names), ``jobs``, ``options``, ``seed`` and
    ``code`` (:func:`experiments.provenance.code_digest`).

    Returns
    -------
    dict
        ``names``, ``rotations`` (n, 3, 3) and ``parts`` (n,) of the result; ``steps``: of each run ``shapes``,
        ``found``, ``purity``, ``gross``, ``wall_s``, ``processor_s`` and ``memory_mib``.
    """
    settings, steps = cell.settings, list[Record]()
    with tempfile.TemporaryDirectory() as text:
        library = Path(text) / "library"
        library.mkdir()
        kinds, truth = write_library(
            library, *(settings[key] for key in ("num", "steps", "kinds", "seed"))
        )
        folders = sorted(library.iterdir())
        run = RunOptions(jobs=settings["jobs"], store=Path(text) / "store.sqlite")
        runs = [folders] if settings["way"] == AT_ONCE else [[folder] for folder in folders]
        aligned: Collection | None = None
        for some in runs:
            with stopwatch() as elapsed, memory_watch() as memory:
                if aligned is None:
                    aligned = align_collection(
                        some, options=settings["options"], run=run, progress=False
                    )
                else:
                    aligned = add_to_collection(aligned, some, run=run, progress=False)
            steps.append(step_record(aligned, kinds, truth, elapsed, memory))
        assert aligned is not None
        return {
            "names": object_names(aligned),
            "rotations": aligned.rotations,
            "parts": aligned.part_numbers,
            "steps": steps,
        }


def step_record(
    aligned: Collection,
    kinds: dict[str, int],
    truth: dict[str, FloatArray],
    elapsed: Elapsed,
    memory: Memory,
) -> Record:
    """Return the figures of one run."""
    names = object_names(aligned)
    true = np.array([kinds[name] for name in names])
    found = np.zeros(len(true), dtype=np.int64)
    for number, kind in enumerate(aligned.kinds):
        found[kind.shapes] = number
    known = np.stack([truth[name] for name in names])
    angles = angles_between(aligned.rotations, known)
    within = np.triu(true[:, None] == true, 1)
    together = aligned.part_numbers[:, None] == aligned.part_numbers
    wrong = (angles > GROSS_DEG) | ~together
    return {
        "shapes": len(true),
        "found": len(np.unique(found)),
        "purity": purity(true, found),
        "gross": float(wrong[within].mean()) if within.any() else float("nan"),
        "wall_s": elapsed.wall_s,
        "processor_s": elapsed.processor_s,
        "memory_mib": memory.peak_mib,
    }


def object_names(aligned: Collection) -> list[str]:
    """Return the names of shapes without the folders that tell several places apart."""
    return [name.rpartition("/")[2] for name in aligned.names]


def angles_between(rotations: FloatArray, others: FloatArray) -> FloatArray:
    """Return how far the relative rotations of all pairs differ, in degrees, shape (N, N), of two (N, 3, 3)."""
    own, other = (np.swapaxes(of, 1, 2)[:, None] @ of[None] for of in (rotations, others))
    angles = rotation_angle_deg(own, other)
    return np.where(np.isnan(angles), 180.0, angles)


def share_as_at_once(once: Record, grown: Record, kinds: IntArray) -> float:
    """Return the share of pairs of one kind that both ways pose alike, of those that both pose together.

    Parameters
    ----------
    once, grown : dict
        Of :func:`measure_way`, with the same names.
    kinds : ndarray of int, shape (N,)
        In the order of the first.
    """
    at = {name: i for i, name in enumerate(grown["names"])}
    order = np.array([at[name] for name in once["names"]])
    angles = angles_between(once["rotations"], grown["rotations"][order])
    count = np.triu(kinds[:, None] == kinds, 1)
    for parts in (once["parts"], grown["parts"][order]):
        count &= parts[:, None] == parts
    return float((angles[count] <= AGREE_DEG).mean()) if count.any() else float("nan")


COLUMNS = (
    Column(key="run", title="run"),
    Column(key="shapes", title="shapes"),
    Column(key="found", title="kinds found"),
    Column(key="purity", title="purity, %", format=".1f"),
    Column(key="gross", title="gross, %", format=".1f"),
    Column(key="same", title="as at once, %", format=".1f"),
    Column(key="wall_s", title="wall, s", format=".0f", clock=True),
    Column(key="processor_s", title="CPU, s", format=".0f", clock=True),
    Column(key="memory_mib", title="memory, MiB", format=".0f", clock=True),
)


def measure(bench: Bench) -> Outcome:
    """Align the library both ways; with ``--quick`` a small one, on one process."""
    kinds: Sequence[str]
    if bench.quick:
        num, steps, kinds, jobs, options = NUM_QUICK, QUICK_STEPS, QUICK_KINDS, 1, QUICK_OPTIONS
    else:
        num, steps, kinds, jobs, options = NUM_SHAPES, NUM_STEPS, KINDS, NUM_JOBS, {}
    settings = {"num": num, "steps": steps, "kinds": [*kinds], "seed": 0}
    settings |= {"jobs": jobs, "options": options, "code": code_digest(ROOT)}
    bench.seeds.add(0)
    cells: dict[str, dict[str, Any]] = {
        f"{num} shapes, {way}": {"way": way, **settings} for way in (AT_ONCE, GROWN)
    }
    once, grown = bench.measure(measure_way, cells, apart=True).values()
    with tempfile.TemporaryDirectory() as text:
        true, _ = write_library(Path(text), num, steps, kinds, 0)
    of_each = np.array([true[name] for name in once["names"]])
    same = 100.0 * share_as_at_once(once, grown, of_each)
    rows = [_row(AT_ONCE, once["steps"][0])]
    for number, step in enumerate(grown["steps"], 1):
        rows.append(_row(f"{GROWN}, step {number}", step))
    total = {key: sum(step[key] for step in grown["steps"]) for key in ("wall_s", "processor_s")}
    memory = max(step["memory_mib"] for step in grown["steps"])
    last = {key: rows[-1][key] for key in ("shapes", "found", "purity", "gross")}
    rows.append({"run": f"{GROWN}, all steps", **last, "same": same, **total, "memory_mib": memory})
    return Outcome(tables=(Table(columns=COLUMNS, rows=tuple(rows)),))


def _row(name: str, step: Record) -> Row:
    shares = {key: 100.0 * step[key] for key in ("purity", "gross")}
    return {"run": name, **step, **shares}


EXPERIMENT = Experiment(
    name="library",
    title="A library of many kinds that grows",
    about=_ABOUT,
    measure=measure,
)
