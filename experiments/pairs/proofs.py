"""Proofs of pairs compared with PM-SDP, and complete lists of poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from collalign.engine.records import Record
from experiments.collections.landmarked import TEETH_FOLDER
from experiments.experiment import Bench, Experiment, Outcome
from experiments.pairs.proof_cells import LIMIT_S, TOL, WITHIN, measure_problem, measure_tooth
from experiments.tables import Column, Table

#: Kinds of problems: how many, on how many of them PM-SDP runs as well, and random starts of each.
PROBLEMS: tuple[dict[str, Any], ...] = tuple(
    dict(zip(("kind", "dim", "num", "noise", "problems", "relaxed", "starts"), row, strict=True))
    for row in (
        ("cube", 2, 20, 0.2, 50, 10, 1000),
        ("cube", 3, 20, 0.05, 50, 10, 1000),
        ("cube", 3, 20, 0.1, 50, 10, 1000),
        ("cube", 3, 20, 0.2, 50, 10, 1000),
        ("cube", 3, 50, 0.2, 10, 2, 1000),
        ("teeth", 3, 20, None, 50, 10, 1000),
        ("teeth", 3, 64, None, 50, 5, 1000),
        ("teeth", 3, 120, None, 10, 1, 200),
        ("teeth", 3, 400, None, 2, 0, 10),
    )
)
QUICK: tuple[dict[str, Any], ...] = (
    {"kind": "cube", "dim": 3, "num": 8, "noise": 0.1, "problems": 2, "relaxed": 1, "starts": 20},
)
#: Samples of each tooth.
TOOTH_POINTS = 64
#: Teeth whose pairs are all listed.
NUM_TEETH = 116

_ABOUT = f"""
*Pairs.* Uniform points in the unit square or cube and their noisy, rotated, shuffled copy; pairs of teeth by
Euclidean farthest points of unit size, right teeth mirrored. Each is proven over SO(d) to a gap of {TOL:g} by quasi
branch and bound; on some of them (*relaxed*) the certificate is verified, and PM-SDP (with cross products) runs, at
most {LIMIT_S:.0f} s.
*Share* is the lower bound as a share of the best energy. *Starts below* counts random starts, each followed by local
minimisation, that end below the proven bound. CPU seconds of one thread.

Relaxations in which every match carries moments of its own were removed: the tight one proved .149 to 1.000 in .07 to
5.7 s in the median on these problems, and was exact to 1e-4 only on cubes of noise .05 (100 %) and .1 (43 %); its
quaternion form proved .79 at noise .05. Branch and bound proves .999 on all in .002 to .28 s.

*Lists*: all pairs of the first {NUM_TEETH} teeth at {TOOTH_POINTS} points, proven, with complete lists of all poses
within {WITHIN - 1:.0%} of the best energy.
"""


def measure(bench: Bench) -> Outcome:
    """Prove pairs of all kinds, and list the poses of pairs of teeth."""
    kinds = QUICK if bench.quick else PROBLEMS
    pairs = []
    for kind in kinds:
        cells = {
            f"{kind['kind']}, {kind['num']} points, noise {kind['noise']}, {kind['dim']}D, {seed}": {
                key: kind[key] for key in ("kind", "dim", "num", "noise", "starts")
            }
            | {"seed": seed, "relax": seed < kind["relaxed"]}
            for seed in range(kind["problems"])
        }
        pairs.append(_pair_row(kind, list(bench.measure(measure_problem, cells).values())))
    teeth = {
        f"tooth {index}": {"index": index, "num": NUM_TEETH, "points": TOOTH_POINTS}
        for index in range(0 if bench.quick else NUM_TEETH - 1)
    }
    listed = list(bench.measure(measure_tooth, teeth).values())
    bench.seeds.update(range(max(kind["problems"] for kind in kinds)))
    tables = [_pairs_table(tuple(pairs))]
    if listed:
        tables.append(_teeth_table(listed))
    return Outcome(tables=tuple(tables), text=_text(pairs, listed))


def _pair_row(kind: dict[str, Any], records: list[Record]) -> dict[str, Any]:
    relaxed = [record for record in records if "pm-sdp_s" in record]
    row: dict[str, Any] = {key: kind[key] for key in ("kind", "dim", "num", "noise")} | {
        "problems": len(records),
        "proven": sum(record["proven"] for record in records),
        "share": min(record["share"] for record in records),
        "below": sum(record["below"] for record in records),
        "cells": int(np.median([record["cells"] for record in records])),
        "s": float(np.median([record["s"] for record in records])),
        "largest_s": max(record["s"] for record in records),
        "relaxed": len(relaxed),
        "verified": min((record["verified"] for record in relaxed), default=None),
    }
    for name in ("pm-sdp_share", "pm-sdp_s") if relaxed else ():
        row[name] = float(np.median([record[name] for record in relaxed]))
    return row


def _pairs_table(rows: tuple[dict[str, Any], ...]) -> Table:
    columns = (
        Column(key="kind", title="points of"),
        Column(key="dim", title="d"),
        Column(key="num", title="n"),
        Column(key="noise", title="noise"),
        Column(key="problems", title="problems"),
        Column(key="proven", title="proven"),
        Column(key="share", title="least share", format=".4f"),
        Column(key="below", title="starts below"),
        Column(key="cells", title="cells"),
        Column(key="s", title="s", format=".3f", clock=True),
        Column(key="largest_s", title="largest s", format=".3f", clock=True),
        Column(key="relaxed", title="relaxed"),
        Column(key="verified", title="least share of the certificate", format=".4f"),
        Column(key="pm-sdp_share", title="PM-SDP: share", format=".3f"),
        Column(key="pm-sdp_s", title="PM-SDP: s", format=".2f", clock=True),
    )
    return Table(columns=columns, rows=rows, caption="Pairs: medians but where it says otherwise.")


def _teeth_table(records: list[Record]) -> Table:
    joined = {
        key: np.concatenate([record[key] for record in records])
        for key in ("s", "proven", "regions", "poses")
    }
    row = {
        "pairs": len(joined["s"]),
        "proven": int(joined["proven"].sum()),
        "one_region": 100.0 * float((joined["regions"] == 1).mean()),
        "two": 100.0 * float((joined["regions"] == 2).mean()),
        "most": int(joined["regions"].max()),
        "s": float(np.median(joined["s"])),
        "all_s": float(joined["s"].sum()),
    }
    columns = (
        Column(key="pairs", title="pairs"),
        Column(key="proven", title="proven and listed"),
        Column(key="one_region", title="one region, %", format=".1f"),
        Column(key="two", title="two regions, %", format=".1f"),
        Column(key="most", title="most regions"),
        Column(key="s", title="median s", format=".3f", clock=True),
        Column(key="all_s", title="all, s", format=".0f", clock=True),
    )
    return Table(name="teeth", columns=columns, rows=(row,), caption="Complete lists.")


def _text(pairs: list[dict[str, Any]], listed: list[Record]) -> str:
    unproven = sum(row["problems"] - row["proven"] for row in pairs)
    below = sum(row["below"] for row in pairs)
    lines = [f"Pairs not proven: {unproven}. Random starts that ended below a bound: {below}."]
    if listed:
        proven = np.concatenate([record["proven"] for record in listed])
        lines.append(
            f"Pairs of teeth not proven or listed: {int((proven == 0).sum())} of {len(proven)}."
        )
    return "\n\n".join(lines)


EXPERIMENT = Experiment(
    name="proofs",
    title="Proofs of pairs, and complete lists of their poses",
    about=_ABOUT,
    measure=measure,
    collections=(TEETH_FOLDER,),
)
