"""Maps between bodies of which one or both are cut: where vertices have no counterpart, and whether that is found."""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np

from collalign.confidence.map_model import NEAR
from collalign.engine.records import Record
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.ranked import ranked_maps
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.tools.match.every_vertex import vertex_maps
from collalign.tools.match.nonrigid import match_of
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.generated.bipeds import KINDS, Biped, biped, template_points
from experiments.generated.cut_bipeds import CUTS, CutBiped, cut_biped
from experiments.maps.bodies import SURE, images_of, weighed
from experiments.maps.evaluation import MapEvaluator
from experiments.maps.map_cells import QUICK_SURFACE
from experiments.tables import Column, Row, Table

#: Pairs of each cut, each of two kinds: the source is cut in the first half of them, the target in the other.
NUM_PAIRS = 4
#: Vertices at which a map is evaluated.
NUM_POINTS = 100
#: Raised when the maps change.
VERSION = "8"
#: The row of pairs of which both are cut, how many they are, and the least share of the template that both have.
BOTH, NUM_BOTH, LEAST_SHARED = "both cut", 14, 0.25

_ABOUT = f"""
Generated bodies of two kinds (people, children, apes, armadillos; `experiments/generated/bipeds.py`), of which one is
cut: a part of it is removed, and its surface is open there. {NUM_PAIRS} pairs of each cut, in half of them the target
is cut. Vertices of the whole body whose true place was cut away have no counterpart. *Found* is the share of these
that the map says have none. *True* is the share of those of which it says so that have none. Errors are geodesic,
over the square root of the target's area, at {NUM_POINTS} vertices of the source that have a counterpart and an
image. The reach of the rim, and how regions of the whole body are proposed and compared, were chosen on other bodies
of these kinds, with the same cuts. By how much a region must fit better than the whole was chosen on four of these.

The last row has {NUM_BOTH} pairs of which both bodies are cut, in two ways that leave at least
{100 * LEAST_SHARED:.0f} % of the template's points to both. There vertices of either body may have no counterpart.
*Sure* are maps that are stated {SURE} or more.
"""


def measure_cut(cell: Cell) -> Record:
    """Match two bodies, each whole or cut.

    Settings: ``target``, ``source`` (kinds), ``cut_target``, ``cut_source`` ("" where it is whole), ``seed``,
    ``surface``.

    Returns
    -------
    dict
        ``error``, the mean error; ``lost``, ``said`` and ``both``, how many vertices opposite to a cut body have no
        counterpart, how many the map says have none, and how many are both; ``stated``. ``candidates``, ``in_place``
        and what :func:`experiments.maps.bodies.weighed` returns are those of whole bodies.
    """
    settings = cell.settings
    pair: list[Biped | CutBiped] = []
    for number, role in enumerate(("target", "source")):
        body = biped(KINDS[settings[role]], np.random.default_rng([settings["seed"], number]), role)
        cut = settings[f"cut_{role}"]
        pair.append(cut_biped(body, cut) if cut else body)
    surface = SurfaceOptions(**settings["surface"])
    target, source = (prepare_surface(one.shape, surface) for one in pair)
    options = NonrigidOptions()
    found = ranked_maps(target, source, options)
    maps = vertex_maps(target, source, found[0])
    match = match_of(target, source, found, maps, num_candidates=options.num_candidates)
    told = match.no_counterpart_source, match.no_counterpart_target
    opposite = [
        (cut.places[other.to_template] < 0, said)
        for cut, other, said in zip(pair, pair[::-1], told, strict=True)
        if isinstance(cut, CutBiped)
    ]
    lost, lacking = (np.concatenate(own) for own in zip(*opposite, strict=True))
    truth = pair[0].places[pair[1].to_template]
    known = np.flatnonzero((truth >= 0) & (maps[0] >= 0))
    at = known[np.linspace(0, len(known) - 1, min(NUM_POINTS, len(known))).astype(int)]
    evaluator = MapEvaluator(pair[0].shape, truth[at])
    images = [maps[0], *(images_of(one, target, source) for one in found)]
    errors, *of_samples = (evaluator.errors(one[at]).direct for one in images)
    return {
        "error": float(errors.mean()),
        "lost": int(lost.sum()),
        "said": int(lacking.sum()),
        "both": int((lost & lacking).sum()),
        "stated": match.confidence,
        "candidates": np.array([one.mean() for one in of_samples]),
        "in_place": np.stack([errors, *of_samples[1:]]) <= NEAR,
        **weighed(target, source, found, source.nearest_dense[source.to_working[at]]),
    }


def row_of(cut: str, records: list[Record]) -> Row:
    """Return the row of one cut, or of all."""
    errors, lost, said, both, stated = (
        np.array([record[key] for record in records])
        for key in ("error", "lost", "said", "both", "stated")
    )
    sure = stated >= SURE
    return {
        "cut": cut,
        "pairs": len(records),
        "error": float(errors.mean()),
        "median": float(np.median(errors)),
        "right": int((errors < NEAR).sum()),
        "found": 100.0 * float(both.sum() / lost.sum()),
        "true": 100.0 * float(both.sum() / max(said.sum(), 1)),
        "sure": int(sure.sum()),
        "sure_right": int((sure & (errors < NEAR)).sum()),
    }


COLUMNS = (
    Column(key="cut", title="cut"),
    Column(key="pairs", title="pairs"),
    Column(key="error", title="mean error", format=".3f"),
    Column(key="median", title="median pair", format=".3f"),
    Column(key="right", title=f"maps below {NEAR}"),
    Column(key="found", title="without a counterpart: found, %", format=".0f"),
    Column(key="true", title="true, %", format=".0f"),
    Column(key="sure", title="sure maps"),
    Column(key="sure_right", title="of these right"),
)


@cache
def _drawn_pairs() -> tuple[tuple[str, str, int], ...]:
    """Return kinds and a seed for each pair of each cut, in the order of the cuts."""
    pairs = list(permutations(KINDS, 2))
    order = np.random.default_rng(0).permutation(len(CUTS) * NUM_PAIRS)
    return tuple((*pairs[at % len(pairs)], int(at)) for at in order)


def measured_cuts(bench: Bench, num: int | None = None) -> dict[str, Record]:
    """Return what :func:`measure_cut` finds of the first pairs, or of all, by the cut, kinds and seed."""
    drawn = _drawn_pairs()
    cells = {
        f"{cut}, {target}, {source}, {seed}": {
            "target": target,
            "source": source,
            "cut_target": cut if number >= NUM_PAIRS // 2 else "",
            "cut_source": "" if number >= NUM_PAIRS // 2 else cut,
            "seed": seed,
            "surface": QUICK_SURFACE if bench.quick else {},
        }
        for place, cut in enumerate(CUTS)
        for number, (target, source, seed) in enumerate(
            drawn[place * NUM_PAIRS : (place + 1) * NUM_PAIRS]
        )
    }
    return bench.measure(measure_cut, dict(list(cells.items())[:num]), version=VERSION)


def measured_both(bench: Bench, num: int) -> list[Record]:
    """Return what :func:`measure_cut` finds of the first pairs of which both bodies are cut."""
    places = template_points()
    left = {cut: stays(places) for cut, stays in CUTS.items()}
    ways = [(a, b) for a, b in permutations(CUTS, 2) if (left[a] & left[b]).mean() >= LEAST_SHARED]
    rng, pairs = np.random.default_rng(1), list(permutations(KINDS, 2))
    cells = {}
    for seed in range(1000, 1000 + NUM_BOTH)[:num]:
        of_target, of_source = ways[rng.integers(len(ways))]
        target, source = pairs[rng.integers(len(pairs))]
        cells[f"{of_target}, {target}; {of_source}, {source}; {seed}"] = {
            "target": target,
            "source": source,
            "cut_target": of_target,
            "cut_source": of_source,
            "seed": seed,
            "surface": QUICK_SURFACE if bench.quick else {},
        }
    return [*bench.measure(measure_cut, cells, version=VERSION).values()]


def measure(bench: Bench) -> Outcome:
    """Match the pairs of all cuts; with ``--quick`` one pair of the first, and one of which both are cut."""
    bench.seeds |= {0, 1}
    records = measured_cuts(bench, 1 if bench.quick else None)
    rows = [
        row_of(cut, own)
        for cut in CUTS
        if (own := [record for label, record in records.items() if label.startswith(f"{cut},")])
    ]
    both = row_of(BOTH, measured_both(bench, 1 if bench.quick else NUM_BOTH))
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=(*rows, row_of("all", list(records.values())), both)),)
    )


EXPERIMENT = Experiment(
    name="cuts",
    title="Maps of bodies in part: what has no counterpart",
    about=_ABOUT,
    measure=measure,
)
