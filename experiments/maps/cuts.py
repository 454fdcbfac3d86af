"""Maps between bodies of which one is cut: where vertices without a counterpart are, and whether they are found."""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np

from collalign.confidence.map_model import NEAR
from collalign.engine.records import Record
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.tools.match.nonrigid import match_shapes
from data_tools.arrays import IntArray
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.generated.bipeds import KINDS, Biped, biped
from experiments.generated.cut_bipeds import CUTS, CutBiped, cut_biped
from experiments.maps.evaluation import MapEvaluator
from experiments.maps.map_cells import QUICK_SURFACE
from experiments.tables import Column, Row, Table

#: Pairs of each cut, each of two kinds: the source is cut in the first half of them, the target in the other.
NUM_PAIRS = 4
#: Vertices at which a map is evaluated.
NUM_POINTS = 100
#: Raised when the maps change.
VERSION = "1"

_ABOUT = f"""
Generated bodies of two kinds (people, children, apes, armadillos; `experiments/generated/bipeds.py`), of which one is
cut: a part of it is removed, and its surface is open there. {NUM_PAIRS} pairs of each cut, in half of them the target
is cut. Vertices of the whole body whose true place was cut away have no counterpart. *Found* is the share of these
that the map says have none. *True* is the share of those of which it says so that have none. Errors are geodesic,
over the square root of the target's area, at {NUM_POINTS} vertices of the source that have a counterpart and an
image. The reach of the rim was chosen on other bodies of these kinds, with the same cuts.
"""


def measure_cut(cell: Cell) -> Record:
    """Match a whole body and a cut one.

    Settings: ``cut``, ``target``, ``source`` (kinds), ``is_target_cut``, ``seed``, ``surface``.

    Returns
    -------
    dict
        ``error``, the mean error; ``lost``, ``said`` and ``both``, how many vertices of the whole body have no
        counterpart, how many the map says have none, and how many are both.
    """
    settings = cell.settings
    bodies = [
        biped(KINDS[settings[role]], np.random.default_rng([settings["seed"], number]), role)
        for number, role in enumerate(("target", "source"))
    ]
    at_target = bool(settings["is_target_cut"])
    pair: list[Biped | CutBiped] = [*bodies]
    pair[0 if at_target else 1] = cut_biped(bodies[0 if at_target else 1], settings["cut"])
    surface = SurfaceOptions(**settings["surface"])
    found = match_shapes(pair[0].shape, pair[1].shape, surface_options=surface)
    lacking = found.no_counterpart_source if at_target else found.no_counterpart_target
    cut, whole = (pair[0], pair[1]) if at_target else (pair[1], pair[0])
    lost = cut.places[whole.to_template] < 0
    return {
        "error": _mean_error(pair[0], pair[1], found.point_map_target_source),
        "lost": int(lost.sum()),
        "said": int(lacking.sum()),
        "both": int((lost & lacking).sum()),
    }


def _mean_error(target: Biped | CutBiped, source: Biped | CutBiped, images: IntArray) -> float:
    truth = target.places[source.to_template]
    known = np.flatnonzero((truth >= 0) & (images >= 0))
    at = known[np.linspace(0, len(known) - 1, min(NUM_POINTS, len(known))).astype(int)]
    return float(MapEvaluator(target.shape, truth[at]).errors(images[at]).direct.mean())


def row_of(cut: str, records: list[Record]) -> Row:
    """Return the row of one cut, or of all."""
    errors, lost, said, both = (
        np.array([record[key] for record in records]) for key in ("error", "lost", "said", "both")
    )
    return {
        "cut": cut,
        "pairs": len(records),
        "error": float(errors.mean()),
        "median": float(np.median(errors)),
        "right": int((errors < NEAR).sum()),
        "found": 100.0 * float(both.sum() / lost.sum()),
        "true": 100.0 * float(both.sum() / max(said.sum(), 1)),
    }


COLUMNS = (
    Column(key="cut", title="cut"),
    Column(key="pairs", title="pairs"),
    Column(key="error", title="mean error", format=".3f"),
    Column(key="median", title="median pair", format=".3f"),
    Column(key="right", title=f"maps below {NEAR}"),
    Column(key="found", title="without a counterpart: found, %", format=".0f"),
    Column(key="true", title="true, %", format=".0f"),
)


@cache
def _drawn_pairs() -> tuple[tuple[str, str, int], ...]:
    """Return kinds and a seed for each pair of each cut, in the order of the cuts."""
    pairs = list(permutations(KINDS, 2))
    order = np.random.default_rng(0).permutation(len(CUTS) * NUM_PAIRS)
    return tuple((*pairs[at % len(pairs)], int(at)) for at in order)


def measure(bench: Bench) -> Outcome:
    """Match the pairs of all cuts; with ``--quick`` one pair of the first."""
    bench.seeds.add(0)
    drawn = _drawn_pairs()
    cells = {
        f"{cut}, {target}, {source}, {seed}": {
            "cut": cut,
            "target": target,
            "source": source,
            "seed": seed,
            "is_target_cut": number >= NUM_PAIRS // 2,
            "surface": QUICK_SURFACE if bench.quick else {},
        }
        for place, cut in enumerate(CUTS)
        for number, (target, source, seed) in enumerate(
            drawn[place * NUM_PAIRS : (place + 1) * NUM_PAIRS]
        )
    }
    if bench.quick:
        cells = dict(list(cells.items())[:1])
    records = bench.measure(measure_cut, cells, version=VERSION)
    rows = [
        row_of(cut, own)
        for cut in CUTS
        if (own := [records[label] for label, one in cells.items() if one["cut"] == cut])
    ]
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=(*rows, row_of("all", list(records.values())))),)
    )


EXPERIMENT = Experiment(
    name="cuts",
    title="Maps of bodies in part: what has no counterpart",
    about=_ABOUT,
    measure=measure,
)
