"""Collections from random poses: errors before and after synchronization, older ways beside the toolkit's."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from collalign.engine.store.records import Record
from experiments.collections.aligning import measure_alignment, measure_principal_axes, measure_published_rotations
from experiments.collections.landmarked import CLASSES, CLASSES_FOLDER, RIGHT_DEG, TEETH_FOLDER
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

Plan: TypeAlias = "list[tuple[Callable[[Cell], Record], dict[str, Any]]]"

SEED = 1
#: Embeddings: positions (d = 3), with four eigenfunctions (d = 7), the default (positions and invariants).
EMBEDDINGS = ("xyz", "xyz+lb", "xyz+invariants")
DEFAULT_EMBEDDING, DEFAULT_POINTS = "xyz+invariants", 64
_DIMENSIONS = {"xyz": "3", "xyz+lb": "7", "xyz+invariants": "3 + invariants"}
#: Subsets of each class that are aligned on their own, from the same pairs.
SUBSETS = {"subsets": 12, "subset_size": 6}
#: Version of the toolkit's own rows: raised when its poses change.
TOOLKIT_VERSION = "1"

#: Rows of appendix B: collection, shapes, points, embedding, pairs. PM-SDP's time bounds their number.
PUBLISHED = [
    ("teeth", 40, 20, "xyz", "all"),
    *((name, 20, 20, kind, "all") for name in CLASSES for kind in ("xyz", "xyz+lb")),
]
#: Rows of the toolkit: collection, shapes, points, embedding.
TOOLKIT = [
    *(("teeth", 116, points, DEFAULT_EMBEDDING) for points in (20, 64, 120)),
    *((name, 20, 20, kind) for name in CLASSES for kind in EMBEDDINGS),
    *((name, 20, points, DEFAULT_EMBEDDING) for name in CLASSES for points in (64, 120)),
]

#: What is to be reached: collection, points, and the least share of shapes within 20 degrees, for the default.
GOALS = [("teeth", 20, 0.95), *((name, points, 1.0) for name in CLASSES for points in (20, DEFAULT_POINTS))]
#: For all teeth with the default: median error, largest number of pairs beyond 30 degrees or of wrong chirality.
TEETH_MEDIAN_DEG = 5.5

_ABOUT = """
The 116 teeth (left and right mixed, truth in O(3)) and four classes of SHREC07 (20 shapes each), every shape in a
random pose; the truth is the rotation that the landmarks ask for. *Pairs alone* are the poses of least energy before
any synchronization; the columns after them are relative rotations of all shapes after it. *Gross* are pairs of right
chirality beyond 30 degrees, *mirrored* those of wrong chirality, which count as wrong everywhere. *Within* 10 and 20
degrees: shapes, against the frame that puts most of them within 20. *Unnoticed*: shapes beyond 20 degrees that the
toolkit gives a confidence of .95 or more.

* principal axes + tree: farthest points, the four pairings of the principal axes (eight where mirror images are
  allowed), one-to-one closest points, and the minimum spanning tree of the distances: what auto3dgm does.
* auto3dgm, published: the rotations of its authors' alignment, for the teeth that have one.
* appendix B: PM-SDP of the chosen pairs with the four starts of appendix A and local minimisation, eigenprojection,
  alternating assignments; no robust weights, no runners-up, no refinement. It is told whether a collection is mixed.
  With the paper's k = 20 only, and on some of the teeth: PM-SDP takes longer the more points there are.
* toolkit: its default options but for k and the embedding; whether the collection is mixed it finds out itself.

The landmarks' orbits in the four classes are mirror images alone (left and right). No rotation takes a shape to its
mirror image, so no error is forgiven for symmetry.
"""


def plan(quick: bool) -> Plan:
    """Return the measuring function and the settings of every row."""
    if quick:
        small = {"collection": "glasses", "shapes": 4, "seed": SEED, "points": 20}
        run = {**small, "embedding": "xyz", "pairs": "all"}
        return [
            (measure_principal_axes, small),
            (measure_alignment, {**run, "way": "appendix B"}),
            (measure_alignment, {**run, "way": "toolkit"}),
        ]
    rows: Plan = [(measure_published_rotations, {})]
    sizes = {"teeth": 116, **dict.fromkeys(CLASSES, 20)}
    for points in (20, 64, 120):
        rows += [
            (measure_principal_axes, {"collection": name, "shapes": num, "seed": SEED, "points": points})
            for name, num in sizes.items()
        ]
    rows += [
        (measure_alignment, settings_of("appendix B", name, num, points, kind, pairs))
        for name, num, points, kind, pairs in PUBLISHED
    ]
    rows += [
        (measure_alignment, settings_of("toolkit", name, num, points, kind)) for name, num, points, kind in TOOLKIT
    ]
    return rows


def settings_of(
    way: str, collection: str, shapes: int, points: int, embedding: str, pairs: str = "auto"
) -> dict[str, Any]:
    """Return the settings of one alignment; whole classes with 20 points are split into subsets as well."""
    settings: dict[str, Any] = {
        "way": way,
        "collection": collection,
        "shapes": shapes,
        "seed": SEED,
        "points": points,
    }
    settings |= {"embedding": embedding, "pairs": pairs}
    return settings | (SUBSETS if collection in CLASSES and points == 20 and shapes == 20 else {})


def version_of(settings: dict[str, Any]) -> str:
    """Return the version of a row's measurement."""
    return TOOLKIT_VERSION if settings.get("way") == "toolkit" else "1"


def measure_rows(bench: Bench, rows: Plan) -> list[tuple[dict[str, Any], Record]]:
    """Measure every row on its own and return (settings, record); the way is among the settings."""
    names = {
        measure_principal_axes.__name__: "principal axes + tree",
        measure_published_rotations.__name__: "auto3dgm, published",
    }
    found = []
    for function, settings in rows:
        label = " ".join(str(value) for value in settings.values()) or "published"
        record = bench.measure(function, {label: settings}, version=version_of(settings), apart=True)[label]
        way = settings.get("way", names.get(function.__name__, ""))
        found.append(({"collection": "teeth", **settings, "way": way}, record))
    return found


def row_of(settings: dict[str, Any], record: Record) -> dict[str, Any]:
    """Return the table's row of a record."""
    own, shapes = record.get("own_deg"), record["shapes"]
    row: dict[str, Any] = {
        "collection": settings["collection"],
        "way": settings["way"],
        "points": settings.get("points"),
        "embedding": _DIMENSIONS.get(settings.get("embedding", ""), "3" if "points" in settings else None),
        "shapes": shapes,
        "matched": record.get("matched"),
        "own_20": None if own is None else 100 * float(np.mean(own <= RIGHT_DEG)),
        "own_median": None if own is None else float(np.median(np.nan_to_num(own, nan=180.0))),
        "processor_s": record.get("processor_s"),
        "unnoticed": record.get("unnoticed") if settings["way"] == "toolkit" else None,
    }
    row |= {key: record[key] for key in ("median_deg", "worst_deg", "gross", "mirrored")}
    return row | {f"within_{angle}": 100 * record[f"within_{angle}"] / shapes for angle in (10, 20)}


COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="way", title="way"),
    Column(key="points", title="k"),
    Column(key="embedding", title="d"),
    Column(key="shapes", title="shapes"),
    Column(key="matched", title="pairs matched"),
    Column(key="own_median", title="pairs alone: median, deg", format=".1f"),
    Column(key="own_20", title="pairs alone within 20, %", format=".1f"),
    Column(key="median_deg", title="after: median, deg", format=".1f"),
    Column(key="worst_deg", title="worst, deg", format=".0f"),
    Column(key="gross", title="gross pairs"),
    Column(key="mirrored", title="mirrored pairs"),
    Column(key="within_10", title="shapes within 10, %", format=".1f"),
    Column(key="within_20", title="shapes within 20, %", format=".1f"),
    Column(key="unnoticed", title="unnoticed"),
    Column(key="processor_s", title="processor, s", format=".0f", clock=True),
)


def goals_table(rows: list[dict[str, Any]]) -> Table:
    """Return what is to be reached beside what the default reached."""
    lines: list[Row] = []
    default = [r for r in rows if r["way"] == "toolkit" and r["embedding"] == _DIMENSIONS[DEFAULT_EMBEDDING]]
    by_size = {(row["collection"], row["points"]): row for row in default}
    for name, points, least in GOALS:
        row = by_size.get((name, points))
        if row is not None:
            what = f"{name}, k = {points}: shapes within 20 deg, %"
            lines.append(
                _goal(what, f"at least {100 * least:.0f}", row["within_20"], row["within_20"] >= 100 * least)
            )
    teeth = by_size.get(("teeth", DEFAULT_POINTS))
    if teeth is not None:
        what = f"teeth, k = {DEFAULT_POINTS}: "
        median = teeth["median_deg"]
        lines += [
            _goal(what + "median, deg", f"at most {TEETH_MEDIAN_DEG}", median, median <= TEETH_MEDIAN_DEG),
            _goal(what + "gross pairs", "0", teeth["gross"], not teeth["gross"]),
            _goal(what + "mirrored pairs", "0", teeth["mirrored"], not teeth["mirrored"]),
        ]
    columns = (
        Column(key="figure", title="toolkit's default"),
        Column(key="goal", title="to reach"),
        Column(key="value", title="measured", format=".1f"),
        Column(key="met", title="reached"),
    )
    return Table(name="goals", columns=columns, rows=tuple(lines), caption="Figures to reach.")


def _goal(figure: str, goal: str, value: Any, met: Any) -> Row:
    return {"figure": figure, "goal": goal, "value": float(value), "met": "yes" if met else "no"}


def draw(figure: Figure, rows: list[dict[str, Any]]) -> None:
    """Draw the share of right shapes before (pairs) and after, by way and number of points."""
    names = list(dict.fromkeys(str(row["collection"]) for row in rows))
    panels = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    styles = {"principal axes + tree": "C1", "appendix B": "C0", "toolkit": "C2", "auto3dgm, published": "C3"}
    marks = {"3": "o", "7": "s", _DIMENSIONS[DEFAULT_EMBEDDING]: "^"}
    for axes, name in zip(panels, names, strict=True):
        axes.set_title(name)
        axes.set_xlabel("points k")
        axes.set_xlim(5, 135)
        axes.set_ylim(0, 103)
        for way, colour in styles.items():
            for kind, mark in marks.items():
                chosen = [r for r in rows if (r["collection"], r["way"], r["embedding"]) == (name, way, kind)]
                points = [r["points"] for r in chosen]
                label = f"{way}, d = {kind}"
                axes.plot(points, [r["within_20"] for r in chosen], color=colour, marker=mark, label=label)
                axes.plot(
                    points, [r["own_20"] for r in chosen], color=colour, marker=mark, ls=":", mfc="w", alpha=0.6
                )
        for row in rows:
            if row["collection"] == name and row["points"] is None:
                axes.axhline(row["within_20"], color=styles[str(row["way"])], label=row["way"])
    panels[0].set_ylabel("right within 20 deg, %")
    drawn: dict[str, Artist] = {}
    for axes in panels:
        drawn |= {text: line for line, text in zip(*axes.get_legend_handles_labels(), strict=True) if _has_data(line)}
    figure.legend(handles=list(drawn.values()), labels=list(drawn), loc="outside lower center", ncols=3, fontsize=8)


def _has_data(line: Any) -> bool:
    return len(line.get_xdata()) > 0


def measure(bench: Bench) -> Outcome:
    """Measure all rows."""
    bench.seeds.add(SEED)
    rows = [row_of(settings, record) for settings, record in measure_rows(bench, plan(bench.quick))]
    rows.sort(key=lambda row: ("teeth", *CLASSES).index(str(row["collection"])))
    title = "Shapes within 20 degrees after synchronization (full lines) and pairs alone (dotted)"
    goals = goals_table(rows)
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=tuple(rows)), *([goals] if goals.rows else [])),
        plots=(Plot(draw=lambda figure: draw(figure, rows), title=title, size=(14.0, 4.6)),),
    )


EXPERIMENT = Experiment(
    name="collections",
    title="Collections: pairs alone, synchronized, and older ways",
    about=_ABOUT,
    seen=("teeth", "shrec07"),
    measure=measure,
    collections=(TEETH_FOLDER, CLASSES_FOLDER),
)
