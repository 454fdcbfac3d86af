"""The reliability of confidences: many random sub-collections, overall and by collection."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.confidence.pose_model import limited, probability, terms
from data_tools.arrays import BoolArray, FloatArray, IntArray
from experiments.collections.landmarked import COLLECTIONS
from experiments.collections.posed import MIRRORED_DEG
from experiments.confidence.draws import (
    FEWEST,
    GROSS_DEG,
    INTRUDED,
    MOST,
    measure_run,
    measure_runs,
)
from experiments.confidence.families import FAMILIES
from experiments.confidence.fit import fit_weights, training_rows
from experiments.confidence.reliability import (
    SURE,
    USABLE,
    auc_within,
    reliability,
    right_above,
    unnoticed_runs,
)
from experiments.experiment import Bench, Experiment, Outcome, Plot
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED = 11
#: Runs of each real collection and of each generated family: all together take half an hour of CPU time.
RUNS = {"real": 4, "generated": 4}
#: Raised when stated confidences change.
VERSION = "11"
RIGID = ("teeth", "mouse skulls")
#: Fewest shapes of the runs that the table of sizes joins in one row.
SIZES = {2: "2", 3: "3", 4: "4 to 6", 7: "7 to 12"}
#: Differences of confidences that are none.
ROUNDING = 1e-9
#: Figures to reach: name, words, at least or at most, value.
GOALS = (
    ("sure", f"right among the shapes at {SURE} or more, %", ">=", 99.0),
    ("sure_worst", "the same, worst collection, %", ">=", 97.0),
    ("excess", "stated minus right, worst tenth", "<=", 0.05),
    ("ece", "expected calibration error", "<=", 0.03),
    ("usable_rigid", f"right shapes at {USABLE} or more, rigid anatomy, %", ">=", 90.0),
    ("usable", "the same, elsewhere, %", ">=", 80.0),
    ("auc", "right above wrong within a run (AUC)", ">=", 0.85),
    ("unnoticed", f"runs with a shape beyond {GROSS_DEG:.0f} deg and no word, %", "<=", 1.0),
    ("intruders", "intruders in doubt or named, %", ">=", 95.0),
)

_ABOUT = f"""
Random sub-collections of {FEWEST} to {MOST} shapes (uniform in the logarithm), default options, random poses, and
generated collections of many kinds; a shape is right if it is within 20 degrees of the truth in the frame that
most of its part agrees with. Parts are not aligned with each other, and a shape alone in its part is not right. In a
part of {INTRUDED} of the runs one shape is replaced by a generated one of another kind or by a cloud of noise.
*Unrelated blobs* and *noise* have no right answer: every pose that is not in doubt counts as wrong. Exactly symmetric
families are right in several poses; there a word about it is owed, and they count in no other figure.

Each real collection has {RUNS["real"]} runs and each generated family {RUNS["generated"]}, so the figures of one
collection rest on few shapes. Larger collections are not measured here.

The constants of the confidence were fitted on other draws of the same collections (`python -m experiments calibrate
confidence`). *Left out* judges each collection by weights that were fitted on the others here.
"""


def stated_by_held_out_weights(records: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the records with what would be stated by weights that were fitted without each collection.

    What limits a confidence beside the weights (misfits, ties, sides in doubt) still does.
    """
    held_out = {}
    for kind, record in records.items():
        others = {
            name: one for name, one in records.items() if name != kind and _scored(one, name).any()
        }
        weights, constant = fit_weights(*training_rows(others))
        chance = 1.0 / (1.0 + np.exp(-(terms(record["evidence"]) @ weights + constant)))
        is_limited = record["stated"] < probability(record["evidence"]) - ROUNDING
        stated, _ = limited(record["evidence"], chance)
        stated = np.where(is_limited, np.minimum(stated, record["stated"]), stated)
        held_out[kind] = record | {"stated": np.where(np.isnan(chance), record["stated"], stated)}
    return held_out


def facts(record: dict[str, Any], kind: str) -> Row:
    """Return the row of one collection."""
    scored = _scored(record, kind)
    stated, right = record["stated"][scored], record["right"][scored]
    intruder, named = record["intruder"], record["named"]
    row: dict[str, Any] = {
        "kind": kind,
        "runs": len(np.unique(record["run"])),
        "shapes": int(scored.sum()),
    }
    if scored.any():
        diagram = reliability(stated, right)
        sure, count = right_above(stated, right, SURE)
        row |= {
            "right": 100 * float(right.mean()),
            "ece": diagram.expected_error,
            "sure": 100 * sure,
            "num_sure": count,
            "usable": 100 * float((stated[right] >= USABLE).mean())
            if right.any()
            else float("nan"),
            "auc": auc_within(stated, right, record["run"][scored]),
        }
    wrong = _wrong(record, kind)
    row["unnoticed"] = 100 * unnoticed_runs(wrong, named, record["run"])
    if intruder.any():
        row["intruders"] = 100 * float(named[intruder].mean())
    return row


def by_size(records: dict[str, dict[str, Any]]) -> tuple[Row, ...]:
    """Return one row for the runs of so many shapes: what is right, and how the sure ones are wrong."""
    joined: dict[str, list[Any]] = {key: [] for key in ("size", "stated", "error_deg", "right")}
    for kind, record in records.items():
        part = _scored(record, kind)
        joined["size"].append(run_sizes(record)[part])
        for key in ("stated", "error_deg", "right"):
            joined[key].append(record[key][part])
    size, stated, error_deg, right = (np.concatenate(parts) for parts in joined.values())
    rows: list[Row] = []
    row_of_size = np.searchsorted(list(SIZES), size, side="right") - 1
    for row, words in enumerate(SIZES.values()):
        of_size = row_of_size == row
        if not of_size.any():
            continue
        sure, is_right = of_size & (stated >= SURE), right[of_size]
        rows.append(
            {
                "size": words,
                "shapes": int(of_size.sum()),
                "right": 100 * float(is_right.mean()),
                "ece": reliability(stated[of_size], is_right).expected_error,
                "num_sure": int(sure.sum()),
                "wrong_side": int((sure & (error_deg == MIRRORED_DEG)).sum()),
                "wrong_pose": int((sure & ~right & (error_deg != MIRRORED_DEG)).sum()),
                "usable": 100 * _mean([stated[of_size & right] >= USABLE]),
            }
        )
    return tuple(rows)


def run_sizes(record: dict[str, Any]) -> IntArray:
    """Return for each shape the number of shapes of its run."""
    _, which, counts = np.unique(record["run"], return_inverse=True, return_counts=True)
    return np.asarray(counts[which])


def _scored(record: dict[str, Any], kind: str) -> BoolArray:
    symmetric = kind in FAMILIES and FAMILIES[kind].symmetric
    return ~record["intruder"] & ~np.isnan(record["stated"]) & (not symmetric)


def _wrong(record: dict[str, Any], kind: str) -> BoolArray:
    """Return whether a word is owed: grossly wrong, or of a family where no pose, or no single pose, is right."""
    if kind in FAMILIES and (FAMILIES[kind].symmetric or not FAMILIES[kind].related):
        return ~record["intruder"]
    return ~record["intruder"] & (record["error_deg"] > GROSS_DEG)


def pooled(records: dict[str, dict[str, Any]]) -> dict[str, float]:
    """Return the figures to reach, over all collections."""
    parts = {kind: _scored(record, kind) for kind, record in records.items()}
    stated = np.concatenate([records[kind]["stated"][part] for kind, part in parts.items()])
    right = np.concatenate([records[kind]["right"][part] for kind, part in parts.items()])
    run = np.concatenate(
        [records[k]["run"][p] + 1000 * i for i, (k, p) in enumerate(parts.items())]
    )
    rows = {kind: facts(record, kind) for kind, record in records.items()}
    diagram = reliability(stated, right)
    rigid = [_usable(records[kind], parts[kind]) for kind in RIGID if kind in records]
    others = [_usable(records[kind], parts[kind]) for kind in records if kind not in RIGID]
    weights = [float(row["runs"]) for row in rows.values()]  # type: ignore[arg-type]
    unnoticed = [float(row["unnoticed"]) for row in rows.values()]  # type: ignore[arg-type]
    intruders = [float(row["intruders"]) for row in rows.values() if "intruders" in row]  # type: ignore[arg-type]
    return {
        "sure": 100 * right_above(stated, right, SURE)[0],
        "sure_worst": float(np.nanmin([float(row.get("sure", np.nan)) for row in rows.values()])),  # type: ignore[arg-type]
        "excess": diagram.worst_excess,
        "ece": diagram.expected_error,
        "usable_rigid": 100 * _mean(rigid),
        "usable": 100 * _mean(others),
        "auc": auc_within(stated, right, run),
        "unnoticed": float(np.average(unnoticed, weights=weights)),
        "intruders": float(np.mean(intruders)) if intruders else float("nan"),
    }


def _usable(record: dict[str, Any], part: BoolArray) -> BoolArray:
    return np.asarray(record["stated"][part & record["right"]] >= USABLE)


def _mean(parts: list[BoolArray]) -> float:
    values: FloatArray = np.concatenate(parts) if parts else np.empty(0)
    return float(values.mean()) if len(values) else float("nan")


COLUMNS = (
    Column(key="kind", title="collection"),
    Column(key="runs", title="runs"),
    Column(key="shapes", title="shapes"),
    Column(key="right", title="right, %", format=".1f"),
    Column(key="ece", title="calibration error", format=".3f"),
    Column(key="num_sure", title=f"shapes at {SURE} or more"),
    Column(key="sure", title="right of these, %", format=".1f"),
    Column(key="usable", title=f"right shapes at {USABLE} or more, %", format=".1f"),
    Column(key="auc", title="AUC within runs", format=".3f"),
    Column(key="unnoticed", title="runs wrong without a word, %", format=".1f"),
    Column(key="intruders", title="intruders named, %", format=".1f"),
)


SIZE_COLUMNS = (
    Column(key="size", title="shapes of the run"),
    *(column for column in COLUMNS if column.key in ("shapes", "right", "ece", "num_sure")),
    Column(key="wrong_side", title="of these on the wrong side"),
    Column(key="wrong_pose", title="of these in a wrong pose"),
    *(column for column in COLUMNS if column.key == "usable"),
)


def measure(bench: Bench) -> Outcome:
    """Measure all collections."""
    bench.seeds.add(SEED)
    real = ("glasses",) if bench.quick else COLLECTIONS
    generated = ("crowns", "bones, cut", "noise") if bench.quick else tuple(FAMILIES)
    runs = {"real": 2, "generated": 1} if bench.quick else RUNS
    records = measure_runs(
        partial(bench.measure, measure_run, version=VERSION),
        dict.fromkeys(real, runs["real"]) | dict.fromkeys(generated, runs["generated"]),
        SEED,
    )
    held_out = stated_by_held_out_weights(records)
    figures, left_out = pooled(records), pooled(held_out)
    goals: tuple[Row, ...] = tuple(
        {
            "figure": words,
            "goal": f"{sign} {value:g}",
            "value": figures[key],
            "left_out": left_out[key],
            "met": _met(left_out[key], sign, value),
        }
        for key, words, sign, value in GOALS
    )
    columns = (
        Column(key="figure", title="over all collections"),
        Column(key="goal", title="to reach"),
        Column(key="value", title="stated", format=".3g"),
        Column(key="left_out", title="left out", format=".3g"),
        Column(key="met", title="reached, left out"),
    )
    return Outcome(
        tables=(
            Table(
                columns=COLUMNS, rows=tuple(facts(record, kind) for kind, record in records.items())
            ),
            Table(
                name="sizes",
                columns=SIZE_COLUMNS,
                rows=by_size(held_out),
                caption="By size, left out.",
            ),
            Table(name="goals", columns=columns, rows=goals, caption="Figures to reach."),
        ),
        plots=(
            Plot(
                draw=lambda figure: draw(figure, records),
                title="Stated confidence and share that is right",
            ),
        ),
        text=less_right_than_wanted(held_out),
    )


def less_right_than_wanted(held_out: dict[str, dict[str, Any]]) -> str:
    """Return the sentence that names the collections of which too few of the sure shapes are right."""
    wanted = next(goal for key, _, _, goal in GOALS if key == "sure_worst")
    rows = {kind: facts(record, kind) for kind, record in held_out.items()}
    listed = [
        f"{kind} ({row['sure']:.0f} % of {row['num_sure']})"
        for kind, row in rows.items()
        if float(row.get("sure", np.nan)) < wanted  # type: ignore[arg-type]
    ]
    words = ", ".join(listed) if listed else "none"
    return f"Collections left out of whose shapes at {SURE} or more fewer than {wanted:.0f} % are right: {words}."


def _met(value: float, sign: str, goal: float) -> str:
    return "yes" if (value >= goal if sign == ">=" else value <= goal) else "no"


def draw(figure: Figure, records: dict[str, dict[str, Any]]) -> None:
    """Draw the reliability diagram of all collections together, and of each one faintly."""
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.6", lw=1)
    parts = {kind: _scored(record, kind) for kind, record in records.items()}
    for kind, part in parts.items():
        if part.any():
            one = reliability(records[kind]["stated"][part], records[kind]["right"][part])
            axes.plot(one.stated, one.right, ".", alpha=0.4, ms=4)
    stated = np.concatenate([records[kind]["stated"][part] for kind, part in parts.items()])
    right = np.concatenate([records[kind]["right"][part] for kind, part in parts.items()])
    diagram = reliability(stated, right)
    axes.plot(diagram.stated, diagram.right, "o-", color="C0")
    for x, y, count in zip(diagram.stated, diagram.right, diagram.count, strict=True):
        if count:
            axes.annotate(
                str(count), (x, y), textcoords="offset points", xytext=(5, -9), fontsize=7
            )
    axes.set_xlabel("stated confidence")
    axes.set_ylabel("share that is right")
    axes.set_aspect("equal")


EXPERIMENT = Experiment(
    name="confidence",
    title="Confidence: what is stated, and what is true",
    about=_ABOUT,
    measure=measure,
    collections=(
        "teeth_pnas116",
        "shrec07_dev",
        "mouse_skulls62",
        "scape71",
        "tosca_centaur6",
        "capod7",
    ),
)
