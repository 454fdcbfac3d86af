"""Every mechanism of a run switched off, one at a time: what moves, and what it costs."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.align import matched_samples
from collalign.engine.records import Record
from collalign.engine.session import Session
from collalign.output.collection import Collection
from collalign.products.pair import are_weighed
from data_tools.io.objects import list_shapes
from experiments.collections import scoreboard
from experiments.collections.posed import GROSS_DEG
from experiments.collections.scoreboard import (
    FIGURES,
    compare,
    draw_set,
    figures_of,
    members_of,
)
from experiments.collections.switches import (
    ALWAYS,
    BENT,
    MAPS,
    OPEN,
    PAIRS,
    SHAPES,
    SWITCHES,
    Remembered,
    switched_off,
)
from experiments.confidence.reliability import SURE, USABLE
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.tables import Column, Row, Table

VERSION = "3"

_ABOUT = f"""
Every collection of the [scoreboard](scoreboard.md) in its random poses, at default options; then the same again with
one mechanism of a run switched off, shapes and pairs from the same store. A row joins all collections, and says what
the mechanism moves. Its figures mean what they mean there; *wrong* are shapes beyond {GROSS_DEG:.0f} degrees. A
mechanism is switched off only where it can do anything; elsewhere the figures of the complete run count. Weights are
not fitted again. Refinement, rival poses and mirror images are computed once for the same arguments; the time saved
is what a run without that would save.
"""

_TEXT = """
**What went.** Earlier runs knew three more mechanisms. A second start of the synchronization, and the
comparison of what both starts lead to, moved no pose of any run. Eigenvectors alone gave the same poses as reweighted
averaging before them on eight collections, and were as good on 21 planted graphs. Weights of near pairs in
refinement moved the mean median error by .02 deg, better without them.

**What stays without a figure here.** Turns common to wrong pairs keep shapes whose pairs are wrong alike from high
confidences. On 20 planted graphs (100 shapes, 10 pairs each, 30 % flips, one candidate a pair; seeds 2000 to 2019)
3 of 1844 shapes stated at .95 are wrong with them, and 28 of 1972 without. With four candidates a pair nothing
moves. Copies and growing the graph are for collections that are not among these.
"""


def measure_collection(cell: Cell) -> Record:
    """Align a collection with everything, and with each mechanism switched off.

    Settings: ``switches``, and those of :func:`experiments.collections.scoreboard.draw_set`.

    Returns
    -------
    dict
        By switch, "" for the complete run: what :func:`experiments.collections.scoreboard.compare` says, and
        ``saved_s``: CPU time less than that of the complete run from the same stored results on.
    """
    remembered = Remembered()
    with remembered.used(), tempfile.TemporaryDirectory() as name:
        root = Path(name)
        (root / "shapes").mkdir()
        drawn = draw_set(cell, root / "shapes")
        stores = Stores(root, remembered)
        record: Record = {"": compare(stores.complete, drawn)}
        for name in cell.settings["switches"]:
            switch = SWITCHES[name]
            if applies(switch.where, stores.complete):
                with switched_off(switch):
                    found, processor_s = stores.run(switch.since)
                record[name] = compare(found, drawn) | {
                    "saved_s": stores.complete_s[switch.since] - processor_s
                }
        return record


class Stores:
    """Stores of the shapes of a folder, of their pairs as well, and of maps as well; runs start from copies of them.

    Parameters
    ----------
    root : Path
        Holds the folder ``shapes``, and gets the stores.
    remembered : Remembered
        In use.

    Attributes
    ----------
    complete : Collection
        The run without a switch.
    complete_s : dict
        Its CPU time by what was taken from a store.
    """

    def __init__(self, root: Path, remembered: Remembered) -> None:
        self._root, self._remembered, options = root, remembered, AlignOptions()
        with Session.open(options, RunOptions(jobs=1, store=self._path(SHAPES))) as session:
            matched_samples(session, list_shapes(root / "shapes"))
        _, pairs_s = self._fill(PAIRS, SHAPES, replace(options, maps="never"))
        self.complete, maps_s = self._fill(MAPS, PAIRS, options)
        _, rest_s = self.run(MAPS)
        self.complete_s = {SHAPES: pairs_s + maps_s - rest_s, PAIRS: maps_s, MAPS: rest_s}

    def run(self, since: str) -> tuple[Collection, float]:
        """Align from a copy of a store; also return the seconds of CPU time."""
        with tempfile.TemporaryDirectory() as name:
            return self._align(AlignOptions(), Path(shutil.copy(self._path(since), name)))

    def _fill(self, kind: str, before: str, options: AlignOptions) -> tuple[Collection, float]:
        return self._align(options, Path(shutil.copy(self._path(before), self._path(kind))))

    def _align(self, options: AlignOptions, store: Path) -> tuple[Collection, float]:
        run, start_s = (
            RunOptions(jobs=1, store=store),
            time.process_time() + self._remembered.saved_s,
        )
        found = align_collection(self._root / "shapes", options=options, run=run, progress=False)
        return found, time.process_time() + self._remembered.saved_s - start_s

    def _path(self, kind: str) -> Path:
        return self._root / f"{kind}.sqlite"


def applies(where: str, complete: Collection) -> bool:
    """Whether a mechanism may do anything for a collection, given its complete run."""
    is_open = bool(complete.incomplete) or "incomplete shapes" in complete.run.times_s
    return {ALWAYS: True, BENT: are_weighed(complete.pairs), OPEN: is_open}[where]


def row_of(name: str, records: Sequence[Record]) -> Row:
    """Return the row of a switch, summed over the draws of all collections; "" is the complete run."""
    changed = [record for record in records if name in record]
    own = [record[name if name in record else ""] for record in records]
    others = [(record[name], record[""]) for record in changed] if name else []
    shapes = np.concatenate([one["shape_deg"] for one in own])
    return {
        "off": name or "nothing",
        "runs": len(changed),
        "differ": sum(
            not np.allclose(one["pair_deg"], before["pair_deg"], atol=0.1) for one, before in others
        ),
        "wrong": int((shapes > GROSS_DEG).sum()),
        **figures_of(own),
        "saved": float(sum(one["saved_s"] for one, _ in others)),
    }


COLUMNS = (
    Column(key="off", title="switched off"),
    Column(key="runs", title="runs"),
    Column(key="differ", title="of these with other poses"),
    Column(key="wrong", title="wrong shapes"),
    *(
        Column(key=key, title=title, format=form)
        for key, (title, form) in FIGURES.items()
        if key != "processor_s"
    ),
    Column(key="saved", title="CPU time saved, s", format=".1f", clock=True),
)


def measure(bench: Bench) -> Outcome:
    """Measure all collections of the scoreboard."""
    members, draws = members_of(bench)
    cells = {
        f"{label}, draw {draw}": {
            "set": key,
            "name": name,
            "draw": draw,
            "switches": tuple(SWITCHES),
        }
        for draw in draws
        for label, (key, name) in members.items()
    }
    records = bench.measure(measure_collection, cells, version=VERSION)
    rows = tuple(row_of(name, list(records.values())) for name in ("", *SWITCHES))
    sets_rows = tuple(
        {"set": label, **row_of("", [records[f"{label}, draw {draw}"] for draw in draws])}
        for label in members
    )
    moved = tuple(
        {"set": label, **row_of(switch, [record]), "off": switch}
        for label, record in records.items()
        for switch in SWITCHES
        if switch in record and moves(record[switch], record[""])
    )
    of_set = (Column(key="set", title="collection"), *COLUMNS)
    return Outcome(
        tables=(
            Table(columns=COLUMNS, rows=rows),
            Table(name="sets", columns=of_set, rows=sets_rows, caption="The complete runs."),
            Table(
                name="moved",
                columns=of_set,
                rows=moved,
                caption="Runs in which a mechanism moves a shape.",
            ),
        ),
        text="" if bench.quick else _TEXT,
    )


def moves(own: Record, complete: Record) -> bool:
    """Whether a switch turns a shape right or wrong, or makes it sure or usable or not so."""
    limits = (("shape_deg", GROSS_DEG), ("stated", SURE), ("stated", USABLE))
    return any(
        not np.array_equal(own[kind] >= limit, complete[kind] >= limit) for kind, limit in limits
    )


EXPERIMENT = Experiment(
    name="ablation",
    title="Ablation: what each mechanism of a run is worth",
    about=_ABOUT,
    measure=measure,
    collections=scoreboard.EXPERIMENT.collections,
    seen=scoreboard.EXPERIMENT.seen,
)
