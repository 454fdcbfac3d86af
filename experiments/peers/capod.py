"""CAPOD: classes of objects in random poses, by this toolkit and by others, with the same clock."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.engine.records import Record
from collalign.products.trust import DOUBT
from experiments.collections.landmarked import RIGHT_DEG
from experiments.collections.posed import GROSS_DEG, PosedCollection, pose_collection
from experiments.datasets import read_canonical_class
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.peers.peer_tools import TOOLS, Answer
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = "capod7"
CLASSES = ("dolphin", "guitar", "gun", "horse", "piano", "spider", "vase")
#: Axes of classes that look the same from all sides of it, in the canonical frame.
AXES = {"vase": (0.0, 0.0, 1.0)}
NUM_DRAWS = 3
#: Raised when the toolkit's poses change.
VERSIONS = dict.fromkeys(TOOLS, "1")
ALL = "all classes"

_ABOUT = f"""
Seven of the fifteen classes of CAPOD, twelve objects each (P. Papadakis, *The canonically posed 3D objects dataset*,
Eurographics workshop on 3D object retrieval, 2014; CC BY 3.0). About ten of the twelve are bent, thinned or broken
versions of one model.

**Rule.** Every object is rotated by a uniformly random rotation, {NUM_DRAWS} times. The truth is the authored pose.
All relative rotations of a class count; *gross* are those off by more than {GROSS_DEG:.0f} degrees. Vases look the
same from all sides of their axis: of their pairs the angle between the axes counts. Dolphins bend, and their authored
pose differs by up to 39 degrees from the best fit. *Wrong at {DOUBT}*: objects that the toolkit is sure of, off by
more than {RIGHT_DEG:.0f} degrees (of vases as well: a tool that is sure of a rotation about the axis is wrong). CPU
time is from the files to the rotations, one process, one draw of a class.

* collalign: default options.
* Open3D: 10 000 points with the mesh's normals, thinned to a voxel of a tenth of the root mean square radius, FPFH,
  RANSAC and point-to-plane ICP with the thresholds of its tutorials. Then either its multiway pose graph, as in the
  tutorial, or plain spectral synchronization of the same pairs.
* Principal axes + ICP + tree: what auto3dgm does (100, then 200 points, one-to-one matches, minimum spanning tree),
  written for this comparison.
* KISS-Matcher with the generalised ICP of small_gicp, and coherent point drift of 200 points from the pairings of the
  principal axes (rustcpd), both with spectral synchronization. Long edges of coarse meshes are split for these and
  for the principal axes, so that vertices cover the surface.

What the other tools are given beyond their defaults was chosen on eight teeth, for the fewest gross pairs.
"""


def measure_tool(cell: Cell) -> Record:
    """Run one tool on one draw of a class; a record for each of its answers.

    Settings: ``name``, ``draw``, ``num`` (objects) and ``tool``.
    """
    settings = cell.settings
    dataset = read_canonical_class(cell.data / FOLDER / settings["name"])
    rng = np.random.default_rng([CLASSES.index(settings["name"]), settings["draw"]])
    with tempfile.TemporaryDirectory() as folder:
        chosen = np.arange(settings["num"])
        posed = pose_collection(dataset, chosen, Path(folder), rng, axis=AXES.get(settings["name"]))
        answers = TOOLS[settings["tool"]].align(posed.folder, False, 1)
    return {name: answer_record(answer, posed) for name, answer in answers.items()}


def answer_record(answer: Answer, posed: PosedCollection) -> Record:
    """Return the errors of all pairs (180 where mirrored), of the shapes, and what was stated of these."""
    record: Record = {
        "errors": np.nan_to_num(posed.pair_errors_deg(answer.rotations, answer.names), nan=180.0),
        "processor_s": answer.elapsed.processor_s,
    }
    if answer.confidence is not None:
        sure = answer.confidence >= DOUBT
        wrong = posed.shape_errors_deg(answer.rotations, answer.names) > RIGHT_DEG
        record |= {"stated": float(sure.mean()), "sure_wrong": int((sure & wrong).sum())}
    return record


def measure(bench: Bench) -> Outcome:
    """Run all tools that are installed on all draws of all classes; with ``--quick`` a few objects of one class."""
    classes, draws, num = (CLASSES[2:3], 1, 4) if bench.quick else (CLASSES, NUM_DRAWS, 12)
    bench.seeds.update(range(draws))
    records: dict[tuple[str, str], list[Record]] = {}
    for key, tool in TOOLS.items():
        if tool.lacks():
            continue
        cells: dict[str, dict[str, Any]] = {
            f"{name}, draw {draw}: {key}": {"name": name, "draw": draw, "num": num, "tool": key}
            for name in classes
            for draw in range(draws)
        }
        found = bench.measure(measure_tool, cells, version=VERSIONS[key], apart=True)
        for label, answers in found.items():
            for answer, record in answers.items():
                records.setdefault((label.partition(",")[0], answer), []).append(record)
    tools = list(dict.fromkeys(answer for _, answer in records))
    rows = [
        row_of(ALL, tool, [one for name in classes for one in records[name, tool]])
        for tool in tools
    ]
    rows += [row_of(name, tool, records[name, tool]) for name in classes for tool in tools]
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=tuple(rows)),), plots=(_plot(rows),), text=_text(rows)
    )


def row_of(name: str, tool: str, records: list[Record]) -> Row:
    """Return the row of a tool's draws of one class, or of all."""
    errors = np.concatenate([record["errors"] for record in records])
    row: dict[str, Any] = {
        "class": name,
        "tool": tool,
        "draws": len(records),
        "pairs": len(errors),
        "gross": 100.0 * float((errors > GROSS_DEG).mean()),
        "median": float(np.median(errors)),
        "processor_s": float(np.median([record["processor_s"] for record in records])),
    }
    if "stated" in records[0]:
        row["stated"] = 100.0 * float(np.mean([record["stated"] for record in records]))
        row["sure_wrong"] = sum(record["sure_wrong"] for record in records)
    return row


COLUMNS = (
    Column(key="class", title="class"),
    Column(key="tool", title="tool"),
    Column(key="draws", title="draws"),
    Column(key="pairs", title="pairs"),
    Column(key="gross", title="gross pairs, %", format=".1f"),
    Column(key="median", title="median error, deg", format=".1f"),
    Column(key="stated", title=f"stated at {DOUBT}, %", format=".0f"),
    Column(key="sure_wrong", title=f"wrong at {DOUBT}"),
    Column(key="processor_s", title="CPU, s", format=".1f", clock=True),
)


def _plot(rows: list[Row]) -> Plot:
    kinds = list(dict.fromkeys(row["class"] for row in rows))
    tools = list(dict.fromkeys(row["tool"] for row in rows))
    gross = {(row["class"], row["tool"]): float(row["gross"] or 0.0) for row in rows}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        height = 0.8 / len(tools)
        for i, tool in enumerate(tools):
            places = np.arange(len(kinds)) + (i - (len(tools) - 1) / 2) * height
            axes.barh(places, [gross[kind, tool] for kind in kinds], height, label=tool)
        axes.set_yticks(range(len(kinds)), [str(kind) for kind in kinds])
        axes.invert_yaxis()
        axes.set_xlabel(f"pairs off by more than {GROSS_DEG:.0f} degrees, %")
        figure.legend(loc="outside lower center", ncols=2, fontsize=8)

    return Plot(
        draw=draw, title="Gross pairs by class and tool", size=(7.0, 1.5 + 0.7 * len(kinds))
    )


def _text(rows: list[Row]) -> str:
    ours = {row["class"]: row for row in rows if row["tool"] == "collalign"}
    ahead = [
        f"{row['tool']} on {row['class']} ({row['gross']:.1f} against {ours[row['class']]['gross']:.1f} %)"
        for row in rows
        if float(str(row["gross"])) < float(str(ours[row["class"]]["gross"]))
    ]
    lines = [
        "Where another tool has fewer gross pairs: "
        + ("; ".join(ahead) or "nowhere in this table")
        + "."
    ]
    lines += [
        f"{' and '.join(tool.answers)}: left out, since {tool.lacks()} cannot be imported."
        for tool in TOOLS.values()
        if tool.lacks()
    ]
    return "\n\n".join(lines)


EXPERIMENT = Experiment(
    name="capod",
    title="CAPOD: objects in random poses, compared with other tools",
    about=_ABOUT,
    seen=("capod",),
    measure=measure,
    collections=(FOLDER,),
)
