"""Maps between deformable surfaces: bodies, cats and dogs, and classes of SHREC07, compared with other tools."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.engine.records import Record
from experiments.experiment import Bench, Experiment, Outcome, Plot
from experiments.importable import is_importable
from experiments.maps.evaluation import THRESHOLDS, cumulative_curve, summary
from experiments.maps.map_cells import (
    NUM_EVALUATED,
    NUM_LANDMARKS,
    QUICK_SURFACE,
    TOOLS,
    errors_of,
    measure_map,
)
from experiments.maps.map_sets import (
    ANIMALS,
    BODIES,
    FOLDERS,
    SAME_PLACES,
    SEED,
    SHREC07_CLASSES,
    MapSet,
    Pair,
    read_map_set,
    some_pairs,
)
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SETS = ("scape", ANIMALS, *SHREC07_CLASSES, BODIES)
#: Pairs drawn of each set, and on how many of them the paper's chain runs.
NUM_PAIRS, NUM_PAPER = 6, 1
OURS, PAPER, PYFM = "collalign", "paper", "pyFM"
#: Raised when the maps change.
VERSION = "4"
#: A map of a larger mean error counts as wrong in part.
BAD_MEAN = 0.1

_ABOUT = f"""
**Data.** {NUM_PAIRS} pairs of each set, drawn at random: SCAPE (Anguelov et al. 2005; pairs of the benchmark of Kim,
Lipman and Funkhouser 2011), cats with dogs of TOSCA (Bronstein et al. 2008; truth of BeCoS, Ehm et al. 2025),
ants, teddy bears and glasses of SHREC07 (those pairs on which blended intrinsic maps were published), and humans with
armadillos, at {len(SAME_PLACES["human"])} landmarks that both share, chosen by hand. All are for research, and not to
be handed on.

**Rule.** That of Kim, Lipman and Funkhouser: the error of a point is the geodesic distance on the target from its
image to its true place, over the square root of the target's area, at the landmarks of SHREC07, at {NUM_EVALUATED}
farthest points of registered meshes, and at 200 of cats. Flips count as errors; where they are accepted, each whole
map is compared with the mirrored truth as well, and the better of the two counts. CPU time is of a pair, from the
meshes on.

* collalign: default options.
* The paper's chain (Maron et al. 2016, section 6.1), on a pair of each set: PM-SDP in 17 eigenfunctions
  with a 5-diagonal R and 30 % candidates by average geodesic distance, local minimisation in 30, functional-map ICP.
  The paper states 30 to 35 minutes a pair. Its fast version has a diagonal R in 30 functions (2.5 minutes).
* pyFM (Magnet, pyfmaps): wave kernel signatures, a functional map of 50 functions with the default weights, and
  ZoomOut (Melzi et al. 2019) to 100 functions; without landmarks, or with {NUM_LANDMARKS} true landmarks, which are
  among the evaluated points. geomfum was left out: it needs PyTorch, and runs the same ZoomOut.
* published: means of the same pairs, from the benchmark's files.

Weights that judge candidates of maps were fitted on pairs of all these sets, cats and dogs included.
"""


def measure(bench: Bench) -> Outcome:
    """Map the pairs of all sets with all tools that are installed; with ``--quick`` one pair of each of two sets."""
    bench.seeds.add(SEED)
    sets = [
        read_map_set(bench.data, name)
        for name in (("scape", SHREC07_CLASSES[0]) if bench.quick else SETS)
    ]
    tools = [name for name in TOOLS if is_importable(PYFM) or not name.startswith(PYFM)]
    if bench.quick:
        tools = [name for name in tools if name != "the paper's chain"]
    found: dict[tuple[str, str], dict[Pair, Record]] = {}
    for maps in sets:
        pairs = some_pairs(maps.pairs, 1 if bench.quick else NUM_PAIRS, SEED)
        for tool in tools:
            chosen = pairs[:NUM_PAPER] if PAPER in tool else pairs
            found[maps.name, tool] = measure_pairs(bench, maps, tool, chosen)
    rows: list[Row] = []
    for maps in sets:
        ours = found[maps.name, OURS]
        rows += [row_of(maps.name, tool, found[maps.name, tool], ours) for tool in tools]
        rows += published_rows(maps, ours)
    text = "\n".join(
        f"- {sentence}" for maps in sets for sentence in findings(maps.name, found[maps.name, OURS])
    )
    curves = {
        tool: [record for maps in sets for record in found[maps.name, tool].values()]
        for tool in tools
    }
    plot = Plot(
        draw=lambda figure: _draw(figure, curves),
        title="Points within each error, of all sets together",
    )
    lacking = "" if is_importable(PYFM) else "\n\npyFM: left out, since pyfmaps cannot be imported."
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=tuple(rows)),), plots=(plot,), text=text + lacking
    )


def measure_pairs(
    bench: Bench, maps: MapSet, tool: str, pairs: Sequence[Pair]
) -> dict[Pair, Record]:
    """Map some pairs of a set with one tool."""
    common = {
        "set": maps.name,
        "tool": tool,
        "points": NUM_EVALUATED,
        "surface": QUICK_SURFACE if bench.quick else {},
    }
    cells: dict[str, dict[str, Any]] = {
        f"{maps.name}, {tool}: {target} {source}": common | {"target": target, "source": source}
        for target, source in pairs
    }
    return dict(
        zip(pairs, bench.measure(measure_map, cells, version=VERSION).values(), strict=True)
    )


def row_of(name: str, tool: str, records: dict[Pair, Record], ours: dict[Pair, Record]) -> Row:
    """Return the row of a tool, beside the toolkit's mean error on the same pairs."""
    errors = [errors_of(record) for record in records.values()]
    direct = summary([one.direct for one in errors])
    row: dict[str, Any] = {
        "set": name,
        "method": tool,
        "origin": "measured",
        "pairs": len(records),
        "direct": direct["mean"],
        "within": 100 * direct["within_0.1"],
        "worst": direct["worst_map"],
        "ours": mean_of([ours[pair] for pair in records]),
        "seconds": float(np.mean([record["seconds"] for record in records.values()])),
    }
    if all(one.mirrored is not None for one in errors):
        row["flips"] = summary([one.accepting_flips for one in errors])["mean"]
    return row


def mean_of(records: Sequence[Record]) -> float:
    """Return the mean of the maps' mean errors, flips counted."""
    return float(np.mean([errors_of(record).direct.mean() for record in records]))


def published_rows(maps: MapSet, ours: dict[Pair, Record]) -> list[Row]:
    """Return a row for each published method, on the toolkit's pairs."""
    return [
        {
            "set": maps.name,
            "method": method,
            "origin": "published",
            "pairs": len(errors),
            "direct": float(np.mean(errors)),
            "worst": max(errors),
            "ours": mean_of(list(ours.values())),
        }
        for method, errors in maps.on(tuple(ours)).items()
    ]


def findings(name: str, ours: dict[Pair, Record]) -> list[str]:
    """Return how many of the toolkit's maps are wrong in part, and how well the mirrored truth is known."""
    num_bad = sum(bool(errors_of(record).direct.mean() > BAD_MEAN) for record in ours.values())
    sentences = [
        f"{name}: {num_bad} of {len(ours)} maps of the toolkit have a mean error above {BAD_MEAN}."
    ]
    mirrors = [
        record["mirror_error"] for record in ours.values() if record["mirror_error"] is not None
    ]
    if mirrors:
        sentences.append(
            f"{name}: the mirrored truth has a mean error of {max(mirrors):.4f} at the landmarks."
        )
    return sentences


COLUMNS = (
    Column(key="set", title="set"),
    Column(key="method", title="method"),
    Column(key="origin", title="from"),
    Column(key="pairs", title="pairs"),
    Column(key="direct", title="mean error", format=".4f"),
    Column(key="within", title="points within 0.1, %", format=".1f"),
    Column(key="worst", title="worst map", format=".3f"),
    Column(key="flips", title="mean, flips accepted", format=".4f"),
    Column(key="ours", title="collalign on the same pairs", format=".4f"),
    Column(key="seconds", title="CPU, s a pair", format=".1f", clock=True),
)


def _draw(figure: Figure, curves: dict[str, list[Record]]) -> None:
    axes = figure.subplots()
    for tool, records in curves.items():
        shares = cumulative_curve([errors_of(record).direct for record in records])
        axes.plot(THRESHOLDS, 100 * shares, label=tool)
    axes.set(
        xlabel="geodesic error / sqrt(area)",
        ylabel="points within, %",
        xlim=(0, THRESHOLDS[-1]),
        ylim=(0, 100),
    )
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="lower right", fontsize="small")


EXPERIMENT = Experiment(
    name="maps",
    title="Maps of bodies, animals and classes, compared with other tools",
    about=_ABOUT,
    seen=("shrec07", "scape"),
    measure=measure,
    collections=(FOLDERS["scape"], FOLDERS[ANIMALS], "shrec07_dev"),
)
