"""Radii of landmarks carried from one, two and three templates, on collections that no power was fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import spearmanr

from collalign.confidence.radius_model import COVERAGE
from data_tools.arrays import FloatArray
from experiments.calibration.few_radii import (
    COLLECTIONS,
    ELLIPSOIDS,
    LEAST_ERROR,
    QUICK_SETTINGS,
    RADII,
    SETTINGS,
    Followed,
    Seen,
    was_carried,
)
from experiments.collections.carrying import measure_few
from experiments.experiment import Bench, Experiment, Outcome
from experiments.tables import Column, Row, Table

#: Raised when the registration or the poses change.
VERSION = "6"
#: To reach on every collection that is left out.
GOAL = 0.4
#: A hold below it leaves a landmark's place open: .0043 at most on the shafts of long bones, .01 at least elsewhere.
OPEN = 0.005

_ABOUT = f"""
`collalign transfer` gives every carried landmark a radius. With one to three templates, too few to calibrate on, it
follows four numbers: how well the surface of the template holds the landmark (whether a slide along the surface
would be seen, in neighbourhoods of three sizes), how far rigid fits of the surface around the landmark take it
elsewhere, how good these fits are, and how far the templates are apart. The last three are lengths, in parts of the
variation of the shapes. Their powers are those of a quantile regression of the errors of collections with known
landmarks. The factor is the least with which radii hold {COVERAGE:.0%} of the errors of each of these collections.

The ellipsoid of a landmark has its axes where the surface of the specimen holds the landmark least and most. Its size
follows the last three numbers in the same way, where a slide counts as far as the surface would show it.

The long bones are generated: no vertices correspond, and landmarks lie mostly between vertices. Half of them are on
the smooth shaft, where nothing in the surface tells the true place, and nearly all of their error is along the shaft.
No expert would put a landmark there. They are here because a radius must be large there. {SETTINGS["num"]}
shapes of each collection, drawn at random, are written in random poses and aligned with default
options. Landmarks of {SETTINGS["sets"]} random sets of one, two and three templates are carried to all others. Shapes
in doubt get none.

*Left out*: the table was fitted to the other collections alone. *In the code*: the table that a transfer uses, fitted
to all of them. *If known*: the correlation if the radius of each landmark were its own mean error over these
specimens, which nobody knows beforehand. It shows how much of the errors is chance. *Open*: landmarks of a hold below
{OPEN}, whose place the surface hardly determines. *Relative size*: the radius of a sphere as large as the ellipsoid,
in parts of the radius, in the median.
"""


def measure(bench: Bench) -> Outcome:
    """Carry landmarks of few templates over all collections, and fit their radii without each in turn."""
    settings = QUICK_SETTINGS if bench.quick else SETTINGS
    bench.seeds.add(int(settings["seed"]))
    names = COLLECTIONS[:3] if bench.quick else COLLECTIONS
    found = bench.measure(
        measure_few, {name: {**settings, "dataset": name} for name in names}, version=VERSION
    )
    nothing = [name for name in names if not was_carried(found[name])]
    kept = [name for name in names if name not in nothing]
    spheres, ellipsoids = (
        {name: followed.seen_in(found[name]) for name in kept} for followed in (RADII, ELLIPSOIDS)
    )
    rows: list[Row] = []
    for name in kept:
        of_spheres, of_ellipsoids = (
            _judged(RADII, spheres, name),
            _judged(ELLIPSOIDS, ellipsoids, name),
        )
        sizes = (
            followed.sizes(seen[name], [*followed.constants.values()])
            for followed, seen in ((RADII, spheres), (ELLIPSOIDS, ellipsoids))
        )
        for k, (radius, size, (shown, errors)) in enumerate(
            zip(*sizes, spheres[name], strict=True), 1
        ):
            root = np.array(found[name][f"root {k}"])
            rows.append(
                {
                    "collection": name,
                    "templates": k,
                    "errors": len(errors),
                    "median": float(np.median(errors)) if len(errors) else np.nan,
                    **of_spheres[k - 1],
                    "known": _if_known(found[name][f"landmark {k}"], found[name][f"errors {k}"]),
                    "open": 100 * float(np.mean(shown[:, 0] < OPEN)),
                    "ellipsoid": of_ellipsoids[k - 1]["covered"],
                    "ellipsoid_now": of_ellipsoids[k - 1]["covered_now"],
                    "size": float(np.median(size / root / radius)) if len(errors) else np.nan,
                }
            )
    return Outcome(tables=(Table(columns=COLUMNS, rows=tuple(rows)),), text=_text(rows, nothing))


COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="templates", title="templates"),
    Column(key="errors", title="landmarks carried"),
    Column(key="median", title="median error, in the variation of the shapes", format=".2f"),
    Column(key="ranked", title="left out: Spearman of radius and error", format=".2f"),
    Column(key="covered", title="left out: within their radius, %", format=".0f"),
    Column(key="ranked_now", title="in the code: Spearman", format=".2f"),
    Column(key="covered_now", title="in the code: within, %", format=".0f"),
    Column(key="known", title="if known: Spearman", format=".2f"),
    Column(key="open", title="open, %", format=".0f"),
    Column(key="ellipsoid", title="left out: within their ellipsoid, %", format=".0f"),
    Column(key="ellipsoid_now", title="in the code: within their ellipsoid, %", format=".0f"),
    Column(key="size", title="relative size of the ellipsoid", format=".2f"),
)


def _judged(followed: Followed, seen: Mapping[str, Seen], name: str) -> list[dict[str, float]]:
    """Return how sizes of the others' table and of the code's rank and hold, by number of templates."""
    others, now = [one for other, one in seen.items() if other != name], followed.constants.values()
    table = followed.table(others) if others else [*now]
    return [
        {
            "ranked": rank,
            "covered": 100 * share,
            "ranked_now": rank_now,
            "covered_now": 100 * share_now,
        }
        for rank, share, rank_now, share_now in zip(
            followed.ranked(seen[name], table),
            followed.covered(seen[name], table),
            followed.ranked(seen[name], [*now]),
            followed.covered(seen[name], [*now]),
            strict=True,
        )
    ]


def _if_known(landmark: FloatArray, errors: FloatArray) -> float:
    """Return the rank correlation of errors with the geometric mean of those of the same landmark."""
    landmark, errors = landmark[np.isfinite(errors)], errors[np.isfinite(errors)]
    logs = np.log(np.maximum(errors, LEAST_ERROR))
    which = np.unique(landmark, return_inverse=True)[1]
    means = np.bincount(which, weights=logs) / np.bincount(which)
    return float(spearmanr(means[which], errors).statistic)


def _text(rows: list[Row], nothing: Sequence[str]) -> str:
    short = [
        f"{row['collection']}, {row['templates']} ({row['ranked']:.3f})"
        for row in rows
        if isinstance(row["ranked"], float) and row["ranked"] < GOAL
    ]
    text = f"Below a correlation of {GOAL} where left out: {', '.join(short) or 'none'}."
    if nothing:
        text += f" Not in the table, because no pose is sure enough to carry landmarks: {', '.join(nothing)}."
    return text


EXPERIMENT = Experiment(
    name="radii",
    title="Radii of landmarks from few templates",
    about=_ABOUT,
    measure=measure,
    collections=("teeth_pnas116", "mouse_skulls62", "shrec07_dev"),
    seen=("teeth", "shrec07"),
)
