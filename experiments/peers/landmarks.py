"""Expert landmarks carried over collections, by this toolkit and by others from its poses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import spearmanr

from collalign.engine.records import Record
from experiments.collections.carrying import IN_FILE_UNITS, measure_carrying
from experiments.experiment import Bench, Experiment, Outcome, Plot
from experiments.peers.warps import WARPS, measure_warp
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED = 21
#: Specimens drawn of each collection, of which some lend their landmarks.
NUM_SPECIMENS = 14
#: Numbers of templates, and how many sets of so many are drawn.
SETS = ((1, 6), (7, 4))
#: Ordered pairs on which all ways are compared.
NUM_PAIRS = 4
COLLECTIONS = ("teeth", "mouse skulls")
#: To reach: mean error with one and with seven templates; a quarter below closest points for molars and seven.
GOALS = {("teeth", 1): 0.12, ("mouse skulls", 1): 0.20, ("mouse skulls", 7): 0.15}
GAIN_GOAL = 25.0
#: Raised when the registration, the poses or the radii change.
VERSION = "6"
_OURS = "this toolkit: registration to the collection's mean"

_ABOUT = f"""
{NUM_SPECIMENS} specimens of each collection, drawn at random, are written in random poses, aligned with default
options, and landmarks of one or seven of them are carried to all others by `collalign transfer`, compared with the
closest point to the mean of the templates' landmarks at the same poses. Errors are in millimetres for the mouse
skulls (51 landmarks) and in the target's root mean square radii for the molars (16 landmarks, of all genera). The
constants of the registration were chosen on eight of the skulls and sixteen of the molars, those that settle the
pose on ten skulls, those of the radii of many templates on 44 molars and 22 skulls; the draw here may hold some of
them. Radii of few templates have [a page of their own](radii.md).

Peers carry the landmarks of {NUM_PAIRS} ordered pairs, the same for all: coherent point drift on farthest points
(Myronenko and Song 2010) by rustcpd with its default options, from the toolkit's poses and from its own start. Every
answer is put onto the target's surface.

The whole collections, 116 teeth and 62 skulls, which take about an hour of one core, are measured by

```python
from experiments.peers import landmarks

landmarks.NUM_SPECIMENS = 116  # of fewer, all are taken
```

before `landmarks.EXPERIMENT.measure(bench)`.
"""


def measure(bench: Bench) -> Outcome:
    """Carry landmarks in all ways."""
    bench.seeds.add(SEED)
    num = 7 if bench.quick else NUM_SPECIMENS
    sets = [[1, 1], [4, 1]] if bench.quick else [list(pair) for pair in SETS]
    rng = np.random.default_rng(SEED)
    pairs = [rng.permutation(num)[:2].tolist() for _ in range(1 if bench.quick else NUM_PAIRS)]
    common = {"num": num, "seed": SEED, "pairs": pairs}
    names = COLLECTIONS[:1] if bench.quick else COLLECTIONS
    found = bench.measure(
        measure_carrying,
        {name: {**common, "dataset": name, "sets": sets} for name in names},
        version=VERSION,
    )
    ways = [
        way for way, warp in WARPS.items() if not warp.lacks and not (bench.quick and warp.package)
    ]
    cells: dict[str, dict[str, Any]] = {
        f"{name}: {way}": {
            **common,
            "dataset": name,
            "way": way,
            "transforms": found[name]["transforms"].tolist(),
        }
        for name in names
        for way in ways
    }
    peers = bench.measure(measure_warp, cells, version=VERSION)
    rows = [
        row
        for name, record in found.items()
        for k, _ in sets
        for row in template_rows(name, k, record)
    ]
    compared = [row for name in names for row in _pair_rows(name, found[name], peers)]
    return Outcome(
        tables=(_template_table(rows), _pair_table(compared)),
        plots=(
            Plot(
                draw=lambda figure: _draw(figure, found, sets),
                title="Error of each landmark, its median",
            ),
        ),
        text=_text(rows),
    )


def template_rows(name: str, k: int, record: Record) -> list[Row]:
    """Return a row for each way of carrying landmarks of ``k`` templates."""
    carried, radii = np.array(record[f"carried {k}"]), np.array(record[f"radii {k}"])
    closest = np.array(record[f"closest {k}"])
    known = np.isfinite(radii) & np.isfinite(carried)
    row: dict[str, Any] = {
        "collection": name,
        "templates": k,
        "answered": 100.0 * float(np.isfinite(carried).mean()),
        "carried": float(np.nanmean(carried)),
        "closest": float(closest.mean()),
        "gain": 100.0 * (1.0 - float(np.nanmean(carried)) / float(closest.mean())),
        "goal": GOALS.get((name, k)),
    }
    if known.any():
        row["covered"] = 100.0 * float(np.mean(carried[known] <= radii[known]))
        row["ranked"] = float(spearmanr(radii[known], carried[known]).statistic)
    return [row]


def _pair_rows(name: str, ours: Record, peers: Mapping[str, Record]) -> list[Row]:
    rows: list[Row] = [_pair_row(name, _OURS, np.array(ours["pairs"]), float(ours["register_s"]))]
    for label, record in peers.items():
        collection, _, way = label.partition(": ")
        if collection == name:
            rows.append(_pair_row(name, way, np.array(record["errors"]), record["processor_s"]))
    return rows


def _pair_row(name: str, way: str, errors: np.ndarray, seconds: float) -> Row:
    return {
        "collection": name,
        "way": way,
        "mean": float(np.nanmean(errors)),
        "median": float(np.nanmedian(errors)),
        "worst": float(np.nanmax(np.nanmean(errors, axis=1))),
        "processor_s": seconds,
    }


def _template_table(rows: list[Row]) -> Table:
    columns = (
        Column(key="collection", title="collection"),
        Column(key="templates", title="templates"),
        Column(key="answered", title="answered, %", format=".1f"),
        Column(key="carried", title="mean error", format=".3f"),
        Column(key="closest", title="closest points", format=".3f"),
        Column(key="gain", title="below closest points, %", format=".0f"),
        Column(key="goal", title="to reach", format=".2f"),
        Column(key="covered", title="within their radius, %", format=".1f"),
        Column(key="ranked", title="Spearman of radius and error", format=".2f"),
    )
    caption = "Landmarks of all specimens that are no templates. Radii are meant to hold for 90 %."
    return Table(columns=columns, rows=tuple(rows), caption=caption)


def _pair_table(rows: list[Row]) -> Table:
    columns = (
        Column(key="collection", title="collection"),
        Column(key="way", title="way"),
        Column(key="mean", title="mean error", format=".3f"),
        Column(key="median", title="median", format=".3f"),
        Column(key="worst", title="worst pair", format=".3f"),
        Column(key="processor_s", title="CPU s a pair", format=".1f", clock=True),
    )
    caption = (
        "The same pairs carried in other ways. "
        "The toolkit registers every shape twice, and then carries all pairs."
    )
    return Table(columns=columns, rows=tuple(rows), name="pairs", caption=caption)


def _draw(figure: Figure, found: Mapping[str, Record], sets: list[list[int]]) -> None:
    panels = np.atleast_1d(figure.subplots(1, len(found)))
    for axes, (name, record) in zip(panels, found.items(), strict=True):
        most = max(k for k, _ in sets)
        order = np.argsort(np.nanmedian(record[f"carried {most}"], axis=0), kind="stable")
        for way in ("closest", "carried"):
            for k, _ in sets:
                words = f"{'closest points' if way == 'closest' else 'carried'}, {k} templates"
                axes.plot(
                    np.nanmedian(record[f"{way} {k}"], axis=0)[order],
                    ".-",
                    lw=0.8,
                    ms=4,
                    label=words,
                )
        axes.set_title(name)
        axes.set_xlabel("landmark, by error")
        axes.set_ylabel("mm" if name in IN_FILE_UNITS else "root mean square radii")
        axes.set_ylim(bottom=0)
    panels[0].legend(fontsize=7)


def _text(rows: list[Row]) -> str:
    short = [
        f"{row['collection']}, templates {row['templates']}: {row['carried']:.3f} where {row['goal']:.2f} is wanted"
        for row in rows
        if isinstance(row.get("goal"), float)
        and float(str(row["carried"])) > float(str(row["goal"]))
    ]
    lines = ["Falls short: " + ("; ".join(short) or "nothing here") + "."]
    missing = sorted({warp.package for warp in WARPS.values() if warp.lacks})
    lines += [f"Left out, since they cannot be imported: {', '.join(missing)}."] if missing else []
    lines.append(
        "MALPACA's spread of templates ranks its errors with a Spearman correlation of .33; .6 is wanted of radii."
    )
    return "\n\n".join(lines)


EXPERIMENT = Experiment(
    name="landmarks",
    title="Landmarks carried to all specimens",
    about=_ABOUT,
    measure=measure,
    collections=("teeth_pnas116", "mouse_skulls62"),
)
