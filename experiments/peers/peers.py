"""The same collections through this toolkit and through others, in the same run with the same clock."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.engine.store.records import Record
from data_tools.arrays import IntArray
from experiments.collections.landmarked import CLASSES_FOLDER, TEETH_FOLDER, read_dataset
from experiments.collections.posed import PosedCollection, pose_collection
from experiments.datasets import Dataset
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.peers.peer_tools import TOOLS, Answer, Tool, largest_difference_deg
from experiments.tables import Column, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED = 1
#: Answers nearer than this differ by the order of sums alone.
ROUNDING_DEG = 1e-3
#: Collections: the dataset, the number of shapes, and whether the teeth are of one side.
COLLECTIONS: dict[str, dict[str, Any]] = {
    "8 teeth, one side": {"dataset": "teeth", "num": 8, "one_side": True},
    "20 teeth, one side": {"dataset": "teeth", "num": 20, "one_side": True},
    "20 teeth, mixed sides": {"dataset": "teeth", "num": 20, "one_side": False},
    "10 glasses": {"dataset": "glasses", "num": 10},
    "10 ants": {"dataset": "ant", "num": 10},
    "10 teddies": {"dataset": "teddy", "num": 10},
    "10 chairs": {"dataset": "chair", "num": 10},
}
QUICK: dict[str, dict[str, Any]] = {"3 teeth, one side": {"dataset": "teeth", "num": 3, "one_side": True}}
QUICK_TOOLS = ("collalign", "open3d", "axes", "kiss")

_ABOUT = """
The same files in the same random poses through this toolkit's default and through other tools, one after the other on
the same machine with all its cores. Every tool runs twice: the faster time counts, and *twice* says whether the
second answer was the same. Errors are relative rotations against the landmarks, as for all experiments here; *gross*
are pairs of right chirality beyond 30 degrees.

* Open3D: 10 000 points with the mesh's normals, thinned to a voxel of a tenth of the root mean square radius, FPFH,
  RANSAC (seeded) and point-to-plane ICP with the thresholds of its tutorials; then either its own multiway pose graph
  with global optimisation as in the tutorial, or plain spectral synchronization (appendix B of the paper) of the same
  pairs.
* Principal axes + ICP + tree: what auto3dgm does (100, then 200 points, one-to-one matches, minimum spanning tree),
  written for this comparison, since auto3dgm is in no package registry. Unlike the published program it tries every
  pairing of the axes to the end, and keeps to rotations where the collection is known not to be mixed.
* KISS-Matcher with small_gicp's generalised ICP, and coherent point drift (pycpd, 200 points) from the pairings of
  the principal axes; both with spectral synchronization, since they match pairs only.

Open3D, KISS-Matcher and pycpd know no reflections, and are not given mixed collections, where they cannot be right.
The toolkit is told nothing about the collection; principal axes are told whether it is mixed. All 116 teeth: see the
jobs of teeth.
"""


def choose(dataset: Dataset, settings: dict[str, Any], rng: np.random.Generator) -> IntArray:
    """Draw shapes of a dataset; of one side where the settings say so."""
    index = np.arange(len(dataset))
    if settings.get("one_side") and dataset.chirality is not None:
        index = np.flatnonzero(dataset.chirality == 1)
    return rng.permutation(index)[: settings["num"]]


def measure_tool(cell: Cell) -> Record:
    """Run one tool twice on one collection; a record for each of its answers."""
    dataset = read_dataset(cell.settings["dataset"], cell.data)
    rng = np.random.default_rng(cell.settings["seed"])
    mixed = dataset.chirality is not None and not cell.settings["one_side"]
    with tempfile.TemporaryDirectory() as folder:
        posed = pose_collection(dataset, choose(dataset, cell.settings, rng), Path(folder), rng)
        return compare_runs(TOOLS[cell.settings["tool"]], posed, mixed=mixed, num_jobs=cell.settings["jobs"])


def compare_runs(tool: Tool, posed: PosedCollection, *, mixed: bool, num_jobs: int) -> Record:
    """Run a tool twice on posed shapes, with that many processes or threads.

    Returns
    -------
    dict of str to dict
        For each answer: the figures of :meth:`PosedCollection.figures`, ``wall_s`` and ``processor_s`` of the faster
        run, and ``difference_deg`` between the runs.
    """
    first, second = (tool.align(posed.folder, mixed, num_jobs) for _ in range(2))
    return {name: _record(posed, first[name], second[name]) for name in first}


def _record(posed: PosedCollection, first: Answer, second: Answer) -> Record:
    faster = min((first.elapsed, second.elapsed), key=lambda elapsed: elapsed.wall_s)
    return posed.figures(first.rotations, first.names) | {
        "wall_s": faster.wall_s,
        "processor_s": faster.processor_s,
        "difference_deg": largest_difference_deg(first, second),
    }


def measure(bench: Bench) -> Outcome:
    """Run all tools that are installed on all collections that they can be given."""
    bench.seeds.add(SEED)
    chosen = QUICK_TOOLS if bench.quick else tuple(TOOLS)
    installed = {name: TOOLS[name] for name in chosen if not TOOLS[name].lacks()}
    collections = QUICK if bench.quick else COLLECTIONS
    cells: dict[str, dict[str, Any]] = {
        f"{collection}: {name}": {**settings, "one_side": settings.get("one_side", True), "tool": name}
        | {"seed": SEED, "jobs": 1 if bench.quick else os.cpu_count() or 1}
        for collection, settings in collections.items()
        for name, tool in installed.items()
        if settings["num"] <= tool.max_shapes and (tool.mirrors or settings.get("one_side", True))
    }
    records = bench.measure(measure_tool, cells, apart=True)
    rows = tuple(
        _row(label.partition(":")[0], name, record)
        for label, answers in records.items()
        for name, record in answers.items()
    )
    return Outcome(tables=(_table(rows),), plots=_plots(rows), text=_text(rows))


def _row(collection: str, tool: str, record: Record) -> dict[str, Any]:
    difference = record["difference_deg"]
    return {
        "collection": collection,
        "tool": tool,
        "shapes": record["shapes"],
        "median_deg": record["median_deg"],
        "gross": 100.0 * record["gross"] / record["pairs"],
        "mirrored": 100.0 * record["mirrored"] / record["pairs"],
        "within_20": 100.0 * record["within_20"] / record["shapes"],
        "wall_s": record["wall_s"],
        "processor_s": record["processor_s"],
        "twice": "same bytes" if difference == 0 else "rounding" if difference < ROUNDING_DEG else "differs",
        "difference_deg": difference,
    }


def _table(rows: tuple[dict[str, Any], ...]) -> Table:
    columns = (
        Column(key="collection", title="collection"),
        Column(key="tool", title="tool"),
        Column(key="shapes", title="shapes"),
        Column(key="median_deg", title="median error, deg", format=".1f"),
        Column(key="gross", title="gross pairs, %", format=".1f"),
        Column(key="mirrored", title="pairs of wrong chirality, %", format=".1f"),
        Column(key="within_20", title="shapes within 20 deg, %", format=".0f"),
        Column(key="wall_s", title="s, all cores", format=".1f", clock=True),
        Column(key="processor_s", title="processor s", format=".1f", clock=True),
        Column(key="twice", title="twice"),
        Column(key="difference_deg", title="two runs apart, deg", format=".2f"),
    )
    return Table(columns=columns, rows=rows)


def _plots(rows: tuple[dict[str, Any], ...]) -> tuple[Plot, ...]:
    collections = list(dict.fromkeys(row["collection"] for row in rows))
    tools = list(dict.fromkeys(row["tool"] for row in rows))
    right = {(row["collection"], row["tool"]): row["within_20"] for row in rows}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        height = 0.8 / len(tools)
        for i, tool in enumerate(tools):
            places = [j for j, collection in enumerate(collections) if (collection, tool) in right]
            values = [right[collections[j], tool] for j in places]
            axes.barh(np.array(places) + (i - (len(tools) - 1) / 2) * height, values, height, label=tool)
        axes.set_yticks(range(len(collections)), collections)
        axes.invert_yaxis()
        axes.set_xlabel("shapes within 20 degrees, %")
        axes.set_xlim(0, 100)
        figure.legend(loc="outside lower center", ncols=2, fontsize=8)

    title = "Share of the shapes within 20 degrees, by collection and tool"
    return (Plot(draw=draw, title=title, size=(7.0, 1.5 + 0.75 * len(collections))),)


def _text(rows: tuple[dict[str, Any], ...]) -> str:
    ours = {row["collection"]: row for row in rows if row["tool"] == "collalign"}
    better = [
        f"{row['tool']} on {row['collection']} ({row[key]:.1f} against {ours[row['collection']][key]:.1f} {what})"
        for row in rows
        for key, what, sign in (("within_20", "% of the shapes within 20 deg", -1), ("gross", "% gross pairs", 1))
        if row["collection"] in ours and sign * (ours[row["collection"]][key] - row[key]) > 0
    ]
    lines = ["Where another tool is ahead of the toolkit: " + ("; ".join(better) or "nowhere in this table") + "."]
    lines += [
        f"{' and '.join(tool.answers)}: left out, since {tool.lacks()} is not installed."
        for tool in TOOLS.values()
        if tool.lacks()
    ]
    sizes = {tool.max_shapes for tool in TOOLS.values()}
    lines += [
        f"Collections of more than {size} shapes were not given to "
        + ", ".join(answer for tool in TOOLS.values() if tool.max_shapes == size for answer in tool.answers)
        + ", which would take too long."
        for size in sorted(sizes)
        if size < max(sizes)
    ]
    return "\n\n".join(lines)


EXPERIMENT = Experiment(
    name="peers",
    title="Other tools: the same collections with the same clock",
    about=_ABOUT,
    seen=("teeth", "shrec07"),
    measure=measure,
    collections=(TEETH_FOLDER, CLASSES_FOLDER),
)
