"""The matcher against very many random starts: energies and time."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from typing import Any

import numpy as np

from collalign.engine.store.records import Record
from data_tools.arrays import read_only
from data_tools.options import EmbeddingOptions, SamplingOptions
from experiments.collections.landmarked import CLASSES_FOLDER, TEETH_FOLDER
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.figures.exhaustive import minimise_each
from experiments.pairs.posed_samples import COLLECTIONS, posed_pairs
from experiments.tables import Column, Row, Table
from pairwise.local.local_search import minimise
from pairwise.local.rotation_search import mirror_points
from pairwise.local.rotation_sets import random_rotations
from pairwise.matching import match_problem
from pairwise.options import MatchOptions
from pairwise.problem.pattern import RotationPattern
from pairwise.problem.problem import Problem

SEED = 0
STARTS = 1000
#: Pairs of each collection, by the number of samples, and how many of them are timed against starts each by itself.
SIZES = {20: 50, 64: 34, 120: 12}
TIMED = {20: 10, 64: 3, 120: 1}
#: Of the starts run each by itself so many are timed; their time grows in proportion.
TIMED_STARTS = 100
SHAPES = 20
#: Energies closer than this, relatively, are the same.
REL_TOL = 1e-6
#: Fewer pairs say little about half a percent.
ENOUGH = 200

_ABOUT = f"""
The energy of `pairwise.match` with its default options against the least one that {STARTS} random rotations lead to,
each followed by local minimisation with exact assignment (shared between both chiralities in O(3)). Default embedding
and sampling. The comparison merges runs that meet, which changes no energy. *Time* is the matcher's share of the time
of as many starts run each by itself, measured with {TIMED_STARTS} of them on {TIMED[20]}, {TIMED[64]} and
{TIMED[120]} pairs of each collection with 20, 64 and 120 samples; *merged* is its share of the time where runs that
meet are merged. Processor time of one thread.
"""


def of_chirality(problem: Problem, *, reflected: bool) -> Problem:
    """Return the problem with the rotation block's determinant fixed to +1; itself where the group fixes it already.

    For poses of determinant -1 the source's first coordinate is negated: negate the first column of the solutions,
    too (:func:`pairwise.local.rotation_search.mirror_rotations`).
    """
    if problem.pattern.special_blocks:
        return problem
    pattern = RotationPattern(problem.pattern.mask, ((0, problem.pattern.rotation_block),))
    source = mirror_points(problem.source) if reflected else problem.source
    return replace(problem, source=read_only(source), pattern=pattern)


def random_search(problem: Problem, num: int, rng: np.random.Generator, *, merged: bool) -> float:
    """Return the least energy that random starts lead to, shared between the chiralities that the group has.

    Parameters
    ----------
    problem : Problem
    num : int
        Starts.
    rng : numpy.random.Generator
    merged : bool
        Stop runs that meet another one, as the matcher does.
    """
    chiralities = (False,) if problem.pattern.special_blocks else (False, True)
    energies = []
    for reflected in chiralities:
        part = of_chirality(problem, reflected=reflected)
        starts = np.tile(np.eye(problem.dim), (num // len(chiralities), 1, 1))
        starts[:, :3, :3] = random_rotations(3, len(starts), rng)
        starts = part.pattern.project(starts)
        found = minimise(part, starts).energies if merged else minimise_each(part, starts)
        energies.append(float(found.min()))
    return min(energies)


def measure_energies(cell: Cell) -> Record:
    """Match and search the pairs of one collection; energies per pair, and the times of all of them together."""
    settings = cell.settings
    pairs = posed_pairs(
        cell.data,
        settings["collection"],
        SamplingOptions(num_points=settings["points"], num_dense_points=0),
        EmbeddingOptions(),
        num_shapes=settings["shapes"],
        num_pairs=settings["pairs"],
        seed=settings["seed"],
    )
    matched, searched = [], []
    match_s = merged_s = timed_match_s = each_s = 0.0
    for number, pair in enumerate(pairs):
        begin = time.process_time()
        matched.append(match_problem(pair.problem, MatchOptions()).energy)
        between = time.process_time()
        searched.append(random_search(pair.problem, settings["starts"], np.random.default_rng(number), merged=True))
        after = time.process_time()
        match_s += between - begin
        merged_s += after - between
        if number < settings["timed"]:
            random_search(pair.problem, settings["timed_starts"], np.random.default_rng(number), merged=False)
            timed_match_s += between - begin
            each_s += (time.process_time() - after) * settings["starts"] / settings["timed_starts"]
    return {
        "matched": np.array(matched),
        "searched": np.array(searched),
        "match_s": match_s,
        "merged_s": merged_s,
        "timed_match_s": timed_match_s,
        "each_s": each_s,
    }


def energies_row(name: str, points: int, records: list[Record]) -> Row:
    """Return one row of the table, of one collection or several together."""
    matched, searched = (np.concatenate([record[key] for record in records]) for key in ("matched", "searched"))
    total = {
        key: sum(record[key] for record in records) for key in ("match_s", "merged_s", "timed_match_s", "each_s")
    }
    return {
        "collection": name,
        "points": points,
        "pairs": len(matched),
        "no_worse": 100.0 * float(np.mean(matched <= searched * (1 + REL_TOL))),
        "better": 100.0 * float(np.mean(matched < searched * (1 - REL_TOL))),
        "excess": float(np.max(matched / searched) - 1.0),
        "ms": 1e3 * total["match_s"] / len(matched),
        "share": total["timed_match_s"] / total["each_s"],
        "merged_share": total["match_s"] / total["merged_s"],
    }


_COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="points", title="k"),
    Column(key="pairs", title="pairs"),
    Column(key="no_worse", title="no worse, %", format=".1f"),
    Column(key="better", title="better, %", format=".1f"),
    Column(key="excess", title="largest excess", format=".4f"),
    Column(key="ms", title="ms per pair", format=".0f", clock=True),
    Column(key="share", title="time", format=".3f", clock=True),
    Column(key="merged_share", title="time, merged", format=".3f", clock=True),
)


def cells(*, quick: bool) -> list[dict[str, Any]]:
    """Return the settings of all cells."""
    return [
        {
            "collection": name,
            "points": points,
            "shapes": 4 if quick else SHAPES,
            "pairs": 2 if quick else SIZES[points],
            "timed": 1 if quick else TIMED[points],
            "starts": 100 if quick else STARTS,
            "timed_starts": 20 if quick else TIMED_STARTS,
            "seed": SEED,
        }
        for name, points in itertools.product(COLLECTIONS[-1:] if quick else COLLECTIONS, (20,) if quick else SIZES)
    ]


def measure(bench: Bench) -> Outcome:
    """Measure every collection, and put all of them together for each number of samples."""
    bench.seeds.add(SEED)
    chosen = cells(quick=bench.quick)
    records = bench.measure(measure_energies, {_label(settings): settings for settings in chosen})
    rows = [energies_row(s["collection"], s["points"], [records[_label(s)]]) for s in chosen]
    together = []
    for points in dict.fromkeys(settings["points"] for settings in chosen):
        same = [records[_label(s)] for s in chosen if s["points"] == points]
        together.append(energies_row("all", points, same))
    return Outcome(tables=(Table(columns=_COLUMNS, rows=(*rows, *together)),), text=findings(together))


def findings(rows: list[Row]) -> str:
    """Return whether the matcher is as good as it has to be, from the rows of all collections together."""
    lines = [
        f"Goal: no worse on at least 99.5 % of at least {ENOUGH} pairs, in at most a tenth of the time.",
        "",
    ]
    for row in rows:
        is_good = float(row["no_worse"] or 0) >= 99.5
        is_quick = float(row["share"] or np.inf) <= 0.1
        verdict = "reached" if is_good and is_quick else "**missed**"
        if is_good and is_quick and int(row["pairs"] or 0) < ENOUGH:
            verdict = "no miss, but too few pairs to tell"
        lines.append(f"- k = {row['points']}: {row['no_worse']:.1f} % of {row['pairs']} pairs: {verdict}.")
    return "\n".join(lines)


def _label(settings: dict[str, Any]) -> str:
    return f"{settings['collection']} k={settings['points']} {settings['pairs']} pairs"


EXPERIMENT = Experiment(
    name="matching_energies",
    title="The matcher against random starts",
    about=_ABOUT,
    seen=("teeth", "shrec07"),
    measure=measure,
    collections=(TEETH_FOLDER, CLASSES_FOLDER),
)
