"""Strong deformations: families of one tooth or one chair, bent by random bumps, with an exact truth."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.records import Record
from collalign.output.write import alignment_record
from data_tools.datasets.synthetic import deformed_family, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import chair
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.posed import PosedCollection
from experiments.datasets import read_teeth
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.peers.peer_tools import TOOLS
from experiments.tables import Column, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUM_SHAPES = 8
NUM_SEEDS = 20
#: Other tools, by their names in the comparison.
PEERS = ("open3d", "axes")
#: Root mean square displacement of the bumps, as a share of the bounding box's diagonal: drawn in between.
RMS = (0.045, 0.08)
#: Families without a gross pair that are to be reached.
TO_REACH = 19

_ABOUT = f"""
One shape, {NUM_SHAPES} times bent by twelve random radial bumps of a root mean square height between {RMS[0]:.1%} and
{RMS[1]:.1%} of the bounding box's diagonal (drawn for each family), the vertices shuffled, in random poses: the true
rotations are known exactly. {NUM_SEEDS} families of a tooth drawn from the collection and {NUM_SEEDS} of a generated
chair. *Gross* is a pair beyond 30 degrees or of wrong chirality; to reach: no gross pair in at least {TO_REACH}
families of {NUM_SEEDS}. The first family of each kind runs twice, with all cores and with one, and everything that
`alignment.json` says is compared byte by byte. Open3D and principal axes as in the table of other tools.
"""


def make_family(kind: str, seed: int, num: int, data: Path, folder: Path) -> PosedCollection:
    """Write a family in random poses.

    Parameters
    ----------
    kind : {"tooth", "chair"}
    seed, num : int
        Seed, and how many shapes.
    data : Path
        Folder of the public collections, for the teeth.
    folder : Path
    """
    rng = np.random.default_rng(seed)
    rms = rng.uniform(*RMS)
    base = _drawn_tooth(data, rng) if kind == "tooth" else chair(rng)
    planted = planted_collection(deformed_family(base, num, rng, rms=rms), rng)
    write_collection(folder, planted)
    relative = np.array([[planted.relative_rotation(a, b) for b in range(num)] for a in range(num)])
    return PosedCollection(
        folder=folder, names=tuple(shape.name for shape in planted.shapes), relative=relative
    )


def _drawn_tooth(data: Path, rng: np.random.Generator) -> Shape:
    teeth = read_teeth(data / "teeth_pnas116")
    return teeth.shape(int(rng.integers(len(teeth))))


def _posed_family(cell: Cell, folder: Path) -> PosedCollection:
    return make_family(
        cell.settings["kind"], cell.settings["seed"], cell.settings["num"], cell.data, folder
    )


def measure_toolkit(cell: Cell) -> Record:
    """Align one family with default options; twice if asked, to compare the bytes."""
    with tempfile.TemporaryDirectory() as name:
        posed = _posed_family(cell, Path(name))
        with stopwatch() as elapsed:
            found = align_collection(
                name, options=AlignOptions(), run=RunOptions(jobs=cell.settings["jobs"])
            )
        record = posed.figures(found.rotations, found.names)
        if cell.settings["twice"]:
            again = align_collection(name, options=AlignOptions(), run=RunOptions(jobs=1))
            record["same_bytes"] = json.dumps(alignment_record(found)) == json.dumps(
                alignment_record(again)
            )
    return record | {
        "confidence": float(np.min(found.confidence)),
        "wall_s": elapsed.wall_s,
        "processor_s": elapsed.processor_s,
    }


def measure_peer(cell: Cell) -> Record:
    """Align one family with another tool; a record for each of its answers."""
    with tempfile.TemporaryDirectory() as name:
        posed = _posed_family(cell, Path(name))
        answers = TOOLS[cell.settings["tool"]].align(posed.folder, False, cell.settings["jobs"])
    return {
        name: posed.figures(answer.rotations, answer.names)
        | {"wall_s": answer.elapsed.wall_s, "processor_s": answer.elapsed.processor_s}
        for name, answer in answers.items()
    }


def measure(bench: Bench) -> Outcome:
    """Run all families, then the other tools on the same."""
    kinds = ("chair",) if bench.quick else ("tooth", "chair")
    seeds = range(1 if bench.quick else NUM_SEEDS)
    size: dict[str, Any] = (
        {"num": 3, "jobs": 1} if bench.quick else {"num": NUM_SHAPES, "jobs": os.cpu_count() or 1}
    )
    peers = [name for name in PEERS if not TOOLS[name].lacks()]
    bench.seeds.update(seeds)
    found: dict[tuple[str, str], list[Record]] = {}
    for kind in kinds:
        cells = {
            f"{kind} {seed}": size | {"kind": kind, "seed": seed, "twice": seed == 0}
            for seed in seeds
        }
        found[kind, "collalign"] = list(bench.measure(measure_toolkit, cells, apart=True).values())
    for kind in kinds:
        for peer in peers:
            others = {
                f"{peer}, {kind} {seed}": size | {"kind": kind, "seed": seed, "tool": peer}
                for seed in seeds
            }
            for answers in bench.measure(measure_peer, others, apart=True).values():
                for name, record in answers.items():
                    found.setdefault((kind, name), []).append(record)
    found = {key: found[key] for kind in kinds for key in found if key[0] == kind}
    rows = tuple(_row(kind, tool, records) for (kind, tool), records in found.items())
    return Outcome(
        tables=(_table(rows), _families_table(found)),
        plots=(_plot(found),),
        text=_text(rows, found, peers),
    )


def _row(kind: str, tool: str, records: list[Record]) -> dict[str, Any]:
    same = [record["same_bytes"] for record in records if "same_bytes" in record]
    return {
        "kind": kind,
        "tool": tool,
        "families": len(records),
        "clean": sum(_wrong(record) == 0 for record in records),
        "to_reach": _to_reach(len(records)),
        "gross": 100.0 * sum(map(_wrong, records)) / sum(record["pairs"] for record in records),
        "median_deg": float(np.median([record["median_deg"] for record in records])),
        "worst_deg": max(record["worst_deg"] for record in records),
        "same_bytes": ("yes" if all(same) else "no") if same else None,
        "wall_s": float(np.median([record["wall_s"] for record in records])),
        "processor_s": float(np.median([record["processor_s"] for record in records])),
    }


def _wrong(record: Record) -> int:
    """Return the pairs that are gross or mirrored."""
    return int(record["gross"] + record["mirrored"])


def _to_reach(num_families: int) -> int:
    return num_families - num_families * (NUM_SEEDS - TO_REACH) // NUM_SEEDS


def _table(rows: tuple[dict[str, Any], ...]) -> Table:
    columns = (
        Column(key="kind", title="family of a"),
        Column(key="tool", title="tool"),
        Column(key="families", title="families"),
        Column(key="clean", title="without a gross pair"),
        Column(key="to_reach", title="to reach"),
        Column(key="gross", title="gross pairs, %", format=".1f"),
        Column(key="median_deg", title="median, deg", format=".1f"),
        Column(key="worst_deg", title="worst pair, deg", format=".1f"),
        Column(key="same_bytes", title="same bytes twice"),
        Column(key="wall_s", title="s, all cores", format=".1f", clock=True),
        Column(key="processor_s", title="CPU s", format=".1f", clock=True),
    )
    return Table(columns=columns, rows=rows, caption="Medians are those of the families' medians.")


def _families_table(found: dict[tuple[str, str], list[Record]]) -> Table:
    """Return one row per family, with the gross pairs of every tool."""
    tools = list(dict.fromkeys(tool for _, tool in found))
    columns = [Column(key="kind", title="family of a"), Column(key="seed", title="seed")]
    columns += [Column(key=tool, title=f"{tool}: gross pairs") for tool in tools]
    columns += [
        Column(key="median_deg", title="collalign: median, deg", format=".1f"),
        Column(key="confidence", title="lowest confidence", format=".2f"),
    ]
    rows: tuple[dict[str, Any], ...] = tuple(
        {
            "kind": kind,
            "seed": seed,
            "median_deg": record["median_deg"],
            "confidence": record["confidence"],
        }
        | {tool: _wrong(found[kind, tool][seed]) for tool in tools}
        for (kind, own), records in found.items()
        if own == "collalign"
        for seed, record in enumerate(records)
    )
    return Table(name="families", columns=tuple(columns), rows=rows, caption="Each family.")


def _plot(found: dict[tuple[str, str], list[Record]]) -> Plot:
    kinds = list(dict.fromkeys(kind for kind, _ in found))

    def draw(figure: Figure) -> None:
        for axes, kind in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
            for tool, records in (
                (tool, some) for (some_kind, tool), some in found.items() if some_kind == kind
            ):
                axes.plot(
                    range(1, len(records) + 1), sorted(map(_wrong, records)), ".-", label=tool
                )
            axes.set_title(kind)
            axes.xaxis.get_major_locator().set_params(integer=True)
            axes.set_xlabel("families, fewest gross pairs first")
            axes.set_ylabel("gross pairs")
        axes.legend(fontsize=8)

    return Plot(draw=draw, title="Gross pairs of each family", size=(4.5 * len(kinds), 3.5))


def _text(
    rows: tuple[dict[str, Any], ...], found: dict[tuple[str, str], list[Record]], peers: list[str]
) -> str:
    ours = [row for row in rows if row["tool"] == "collalign"]
    short = [
        f"{row['kind']}: {row['clean']} of {row['families']}"
        for row in ours
        if row["clean"] < row["to_reach"]
    ]
    short += [f"{row['kind']}: two runs differ" for row in ours if row["same_bytes"] == "no"]
    wrong = [
        f"{kind}, seed {seed} ({_wrong(record)} gross pairs, lowest confidence {record['confidence']:.2f})"
        for (kind, tool), records in found.items()
        for seed, record in enumerate(records)
        if tool == "collalign" and _wrong(record)
    ]
    lines = ["Short of the figures: " + ("; ".join(short) or "nothing") + "."]
    if wrong:
        lines.append("Families that the toolkit gets wrong: " + "; ".join(wrong) + ".")
    lines += [
        f"{name} is left out: its packages cannot be imported."
        for name in PEERS
        if name not in peers
    ]
    return "\n\n".join(lines)


EXPERIMENT = Experiment(
    name="deformations",
    title="Strongly deformed families with an exact truth",
    about=_ABOUT,
    measure=measure,
    collections=("teeth_pnas116",),
)
