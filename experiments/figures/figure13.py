"""Figure 13: collections of SHREC07 classes aligned with d = 3 and with d = 7."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.engine.records import Record
from data_tools.arrays import FloatArray
from experiments.collections.aligning import measure_alignment
from experiments.collections.landmarked import CLASSES, CLASSES_FOLDER, RIGHT_DEG
from experiments.experiment import Bench, Experiment, Outcome, Plot
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SEED = 1
#: Shapes of each class, and the paper's number of points.
NUM_SHAPES, POINTS = 20, 20
#: Embeddings: positions (d = 3), with four eigenfunctions (d = 7), the default (positions and invariants).
EMBEDDINGS = ("xyz", "xyz+lb", "xyz+invariants")
#: Subsets of each class that are aligned on their own, from the same pairs.
SUBSETS = {"subsets": 12, "subset_size": 6}
#: Ways with their embeddings.
WAYS = [
    ("appendix B", "xyz"),
    ("appendix B", "xyz+lb"),
    *(("toolkit", kind) for kind in EMBEDDINGS),
]
_NAMES = {"xyz": "d = 3", "xyz+lb": "d = 7", "xyz+invariants": "d = 3 + invariants (default)"}
_COLOURS = {"xyz": "C0", "xyz+lb": "C1", "xyz+invariants": "C2"}
#: Abscissae of the curves.
_ANGLES_DEG = np.linspace(0.0, 60.0, 121)

_ABOUT = f"""
Four classes of SHREC07, 20 shapes each in random poses, k = {POINTS} points, all pairs: positions alone (d = 3)
against positions and four Laplace-Beltrami eigenfunctions with a block-diagonal rotation (d = 7), as in section 6.3
of Maron et al. 2016, whose figure 13 shows by pictures that d = 7 aligns what d = 3 does not. Here the landmarks
decide: errors of relative rotations between all shapes of a class, and shapes within {RIGHT_DEG:.0f} degrees. The
landmarks' symmetry is a mirror image, which no rotation undoes, so no error is forgiven. *Subsets* are
{SUBSETS["subsets"]} random choices of {SUBSETS["subset_size"]} shapes per class, aligned without the others: small
collections are harder.
"""


def curve(errors_deg: FloatArray) -> FloatArray:
    """Return the share of errors up to each of the plotted angles, in %; a wrong chirality is never within any."""
    errors = np.nan_to_num(errors_deg, nan=180.0)
    return np.asarray(100.0 * (errors[:, None] <= _ANGLES_DEG).mean(axis=0))


def rows_of(records: dict[tuple[str, str, str], Record]) -> list[Row]:
    """Return one row per class, way and embedding, and one of all classes together per way and embedding."""
    rows: list[Row] = []
    for way, kind in dict.fromkeys(key[1:] for key in records):
        chosen = {key[0]: record for key, record in records.items() if key[1:] == (way, kind)}
        rows += [_row(name, way, kind, [record]) for name, record in chosen.items()]
        if len(chosen) > 1:
            rows.append(_row("all", way, kind, list(chosen.values())))
    return rows


def _row(name: str, way: str, kind: str, records: list[Record]) -> Row:
    pairs = np.concatenate([np.nan_to_num(record["pair_deg"], nan=180.0) for record in records])
    own = np.concatenate([np.nan_to_num(record["own_deg"], nan=180.0) for record in records])
    subsets = [share for record in records for share in record["subsets"]]
    row: dict[str, Any] = {
        "class": name,
        "way": way,
        "embedding": _NAMES[kind],
        "own": 100 * float(np.mean(own <= RIGHT_DEG)),
        "median": float(np.median(pairs)),
        "pairs": 100 * float(np.mean(pairs <= RIGHT_DEG)),
        "shapes": sum(record["shapes"] for record in records),
        "within_20": sum(record["within_20"] for record in records),
    }
    if subsets:
        row["subsets"] = 100 * float(np.mean(subsets))
    return row


_COLUMNS = (
    Column(key="class", title="class"),
    Column(key="way", title="way"),
    Column(key="embedding", title="embedding"),
    Column(key="own", title="pairs alone within 20, %", format=".1f"),
    Column(key="median", title="after: median, deg", format=".1f"),
    Column(key="pairs", title="pairs within 20, %", format=".1f"),
    Column(key="shapes", title="shapes"),
    Column(key="within_20", title="shapes within 20"),
    Column(key="subsets", title="of subsets' shapes within 20, %", format=".1f"),
)


def comparison(rows: list[Row]) -> str:
    """Return a sentence per way and class on whether d = 7 is at least as good as d = 3."""
    found = {(row["class"], row["way"], row["embedding"]): row for row in rows}
    lines = ["Is d = 7 at least as good as d = 3?", ""]
    for name, way in dict.fromkeys((row["class"], row["way"]) for row in rows):
        low, high = (found.get((name, way, _NAMES[kind])) for kind in ("xyz", "xyz+lb"))
        if low is None or high is None:
            continue
        parts = [f"{high['within_20']} against {low['within_20']} of {low['shapes']} shapes"]
        keys = ["within_20"]
        if low.get("subsets") is not None and high.get("subsets") is not None:
            parts.append(f"{high['subsets']:.1f} against {low['subsets']:.1f} % in subsets")
            keys.append("subsets")
        better = [float(high[key] or 0) >= float(low[key] or 0) for key in keys]
        verdict = "yes" if all(better) else "no" if not any(better) else "in part"
        lines.append(f"* {name}, {way}: {verdict} ({', '.join(parts)}).")
    wrong = [row for row in rows if row["class"] != "all" and row["within_20"] != row["shapes"]]
    if wrong:
        short = [
            f"{r['class']} ({r['way']}, {r['embedding']}): {r['within_20']} of {r['shapes']}"
            for r in wrong
        ]
        lines += ["", "Not every shape is within 20 degrees: " + "; ".join(short) + "."]
    return "\n".join(lines)


def draw(figure: Figure, records: dict[tuple[str, str, str], Record]) -> None:
    """Draw the curves of all pairs' errors, a panel per class."""
    names = list(dict.fromkeys(key[0] for key in records))
    panels = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    for axes, name in zip(panels, names, strict=True):
        _draw_class(axes, name, records)
    panels[0].set_ylabel("pairs within, %")
    panels[0].set_ylim(0, 101)
    figure.legend(
        *panels[-1].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8
    )


def _draw_class(axes: Axes, name: str, records: dict[tuple[str, str, str], Record]) -> None:
    for (_, way, kind), record in (
        (key, record) for key, record in records.items() if key[0] == name
    ):
        style = "-" if way == "toolkit" else "--"
        axes.plot(
            _ANGLES_DEG,
            curve(record["pair_deg"]),
            style,
            color=_COLOURS[kind],
            label=f"{way}, {_NAMES[kind]}",
        )
    axes.axvline(RIGHT_DEG, color="0.8", zorder=0)
    axes.set_title(name)
    axes.set_xlabel("error of the relative rotation, deg")


def settings_of(way: str, name: str, kind: str) -> dict[str, Any]:
    """Return the settings of one alignment: a class, and subsets of it."""
    pairs = "all" if way == "appendix B" else "auto"
    sizes = {"shapes": NUM_SHAPES, "points": POINTS, "seed": SEED}
    return {"way": way, "collection": name, "embedding": kind, "pairs": pairs} | sizes | SUBSETS


def measure(bench: Bench) -> Outcome:
    """Align every class in every way."""
    bench.seeds.add(SEED)
    cells = {
        (name, way, kind): settings_of(way, name, kind) for way, kind in WAYS for name in CLASSES
    }
    if bench.quick:
        few = {"shapes": 4, "subsets": 2, "subset_size": 3}
        cells = {
            ("glasses", "toolkit", kind): cells["glasses", "toolkit", kind] | few
            for kind in ("xyz", "xyz+lb")
        }
    records: dict[tuple[str, str, str], Record] = {}
    for key, settings in cells.items():
        label = " ".join(key)
        found = bench.measure(measure_alignment, {label: settings}, apart=True)
        records[key] = found[label]
    rows = rows_of(records)
    title = "Relative rotations within an angle of the landmarks' ones; toolkit in full lines, appendix B dashed"
    return Outcome(
        tables=(Table(columns=_COLUMNS, rows=tuple(rows)),),
        plots=(Plot(draw=lambda figure: draw(figure, records), title=title, size=(13.0, 4.2)),),
        text=comparison(rows),
    )


EXPERIMENT = Experiment(
    name="figure13",
    title="Figure 13: collections with d = 3 and d = 7",
    about=_ABOUT,
    seen=("shrec07",),
    measure=measure,
    collections=(CLASSES_FOLDER,),
)
