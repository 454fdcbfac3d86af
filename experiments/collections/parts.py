"""Broken shapes: all of a collection cut, or every second one, posed by default and as if they were whole."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collalign import RunOptions, align_collection
from collalign.engine.records import Record
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.scoreboard import FIGURES, Drawn, compare, figures_of
from experiments.confidence.families import BASES, EASY_RMS, Family, copies, pose_family
from experiments.experiment import QUICK_OPTIONS, Bench, Cell, Experiment, Outcome
from experiments.pairs.incomplete import without_share
from experiments.provenance import ROOT, code_digest
from experiments.tables import Column, Row, Table

#: Draws are others than those that constants were chosen on, which were below 30.
FIRST_DRAW, NUM_DRAWS, NUM_SHAPES = 40, 2, 8
#: Share of the vertices that is cut off, and of which shapes: each of so many.
CUTS: dict[str, tuple[float, int]] = {
    "all, a quarter": (0.25, 1),
    "all, a half": (0.5, 1),
    "every second, a half": (0.5, 2),
}
#: Option ``incomplete`` of each way to read the shapes.
READINGS = {"by default": "auto", "as whole": "never"}

_ABOUT = f"""
Generated shapes that differ by bumps, in random poses: {NUM_SHAPES} of each of five families, parts of which are cut
off by planes in random directions. {NUM_DRAWS} draws. They are aligned by default, and as if they were whole
(`--incomplete never`). The figures mean what they mean on the page of the scoreboard.
"""


def cut_family(base: str, cut: str) -> Family:
    """Return copies of a generated shape, some of which are cut."""
    share, every = CUTS[cut]

    def members(num: int, rng: np.random.Generator) -> tuple[Shape, ...]:
        return tuple(
            without_share(one, rng.standard_normal(3), share) if n % every == 0 else one
            for n, one in enumerate(copies(BASES[base], EASY_RMS)(num, rng))
        )

    return Family(members=members)


def measure_reading(cell: Cell) -> Record:
    """Align one draw and return the figures of the scoreboard.

    Settings: ``base``, ``num``, ``cut``, ``draw``, ``reading``, ``options`` and ``code``.
    """
    base, num, cut, draw = (cell.settings[key] for key in ("base", "num", "cut", "draw"))
    rng = np.random.default_rng([draw, *base.encode(), *cut.encode()])
    with tempfile.TemporaryDirectory() as text:
        posed = pose_family(cut_family(base, cut), num, Path(text), rng)
        with stopwatch() as elapsed:
            aligned = align_collection(
                text,
                options=cell.settings["options"],
                incomplete=READINGS[cell.settings["reading"]],
                run=RunOptions(jobs=1),
                progress=False,
            )
    drawn = Drawn(posed=posed, kinds=("",) * len(posed.names))
    return {**compare(aligned, drawn), "processor_s": elapsed.processor_s}


def row_of(records: Sequence[Record]) -> Row:
    """Return the figures of some runs together."""
    return {**figures_of(records), "processor_s": sum(one["processor_s"] for one in records)}


_FIGURES = tuple(
    Column(key=key, title=title, format=form, clock=key == "processor_s")
    for key, (title, form) in FIGURES.items()
)
COLUMNS = (
    Column(key="cut", title="cut off"),
    Column(key="reading", title="posed"),
    Column(key="runs", title="runs"),
    *_FIGURES,
)
SINGLE_COLUMNS = (Column(key="run", title="collection"), *_FIGURES)


def measure(bench: Bench) -> Outcome:
    """Measure all draws; with ``--quick`` a small one of one family, cut in one way."""
    bases = ["crowns"] if bench.quick else [*BASES]
    cuts = ["all, a quarter"] if bench.quick else [*CUTS]
    draws = range(FIRST_DRAW, FIRST_DRAW + (1 if bench.quick else NUM_DRAWS))
    settings = {"num": 4 if bench.quick else NUM_SHAPES, "code": code_digest(ROOT)}
    settings["options"] = QUICK_OPTIONS if bench.quick else {}
    bench.seeds.update(draws)
    cells = {
        f"{base}: {cut}, {reading}, draw {draw}": {
            "base": base,
            "cut": cut,
            "draw": draw,
            "reading": reading,
            **settings,
        }
        for draw in draws
        for base in bases
        for cut in cuts
        for reading in READINGS
    }
    found = bench.measure(measure_reading, cells)
    rows: list[Row] = []
    for cut, reading in itertools.product(cuts, READINGS):
        records = [
            found[f"{base}: {cut}, {reading}, draw {draw}"] for draw in draws for base in bases
        ]
        rows.append({"cut": cut, "reading": reading, "runs": len(records), **row_of(records)})
    single_rows = [{"run": name, **row_of([record])} for name, record in found.items()]
    return Outcome(
        tables=(
            Table(columns=COLUMNS, rows=tuple(rows)),
            Table(columns=SINGLE_COLUMNS, rows=tuple(single_rows), name="collections"),
        )
    )


EXPERIMENT = Experiment(
    name="parts",
    title="Broken shapes: all of a collection, or every second one",
    about=_ABOUT,
    measure=measure,
    collections=(),
    seen=(),
)
