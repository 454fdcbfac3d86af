"""Tables and plots of maps between deformable surfaces, beside what was published on the same pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.experiment import Outcome, Plot
from experiments.maps.evaluation import THRESHOLDS, cumulative_curve, summary
from experiments.maps.map_cells import NUM_EVALUATED
from experiments.maps.map_sets import MapSet
from experiments.maps.map_trials import Measured
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A map of a larger mean error counts as wrong in part.
BAD_MEAN = 0.1
#: Mean error of a map up to which the plots go at least.
_MIN_RANGE = 0.25

PROTOCOL = f"""The protocol is that of Kim, Lipman and Funkhouser (2011): the error of a point is the geodesic
distance on the target from its image to its true place, over the square root of the target's area, at the landmarks
of SHREC07 and at {NUM_EVALUATED} farthest points of registered meshes. Where flips are accepted, each whole map is
compared with the mirrored truth as well, and the better of the two counts; on registered meshes that is a self-map of
the first shape, if its landmarks confirm one."""

COLUMNS = (
    Column(key="set", title="set"),
    Column(key="method", title="method"),
    Column(key="origin", title="from"),
    Column(key="pairs", title="pairs"),
    Column(key="direct", title="mean error", format=".4f"),
    Column(key="within", title="points within 0.1, %", format=".1f"),
    Column(key="worst", title="worst map", format=".3f"),
    Column(key="flips", title="mean, flips accepted", format=".4f"),
    Column(key="flips_within", title="points within 0.1, flips accepted, %", format=".1f"),
    Column(key="flips_worst", title="worst map, flips accepted", format=".3f"),
    Column(key="default", title="mean of the first row on the same pairs", format=".4f"),
    Column(key="seconds", title="s a pair", format=".1f", clock=True),
    Column(key="prepare_s", title="s to prepare a shape", format=".1f", clock=True),
)


def measured_row(set_name: str, measured: Measured, default: Measured) -> Row:
    """Return the row of a trial, beside the first trial on the same pairs."""
    direct, flips = summary(measured.direct), measured.accepting_flips
    row: dict[str, Any] = {
        "set": set_name,
        "method": measured.trial.label,
        "origin": "measured",
        "pairs": len(measured.records),
        "direct": direct["mean"],
        "within": 100 * direct["within_0.1"],
        "worst": direct["worst_map"],
        "default": default.mean_direct(measured.trial.pairs),
        "seconds": float(np.mean([record["seconds"] for record in measured.records])),
        "prepare_s": float(np.mean([record["prepare_s"] for record in measured.records])),
    }
    if flips is not None:
        accepted = summary(flips)
        row["flips"], row["flips_worst"] = accepted["mean"], accepted["worst_map"]
        row["flips_within"] = 100 * accepted["within_0.1"]
    return row


def published_rows(maps: MapSet, default: Measured) -> list[Row]:
    """Return a row for each published method, on the pairs of the first trial."""
    return [
        {
            "set": maps.name,
            "method": method,
            "origin": "published",
            "pairs": len(errors),
            "direct": float(np.mean(errors)),
            "worst": max(errors),
            "default": default.mean_direct(default.trial.pairs),
        }
        for method, errors in maps.on(default.trial.pairs).items()
    ]


def draw_points(axes: Axes, measured: Sequence[Measured]) -> None:
    """Draw the share of points within each error, for every trial."""
    for number, one in enumerate(measured):
        axes.plot(THRESHOLDS, 100 * cumulative_curve(one.direct), color=f"C{number}", label=one.trial.label)
        flips = one.accepting_flips
        if flips is not None:
            label = "flips accepted" if number == 0 else None
            axes.plot(THRESHOLDS, 100 * cumulative_curve(flips), ":", color=f"C{number}", label=label)
    axes.set(xlabel="geodesic error / sqrt(area)", ylabel="points within, %", xlim=(0, THRESHOLDS[-1]), ylim=(0, 100))
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="lower right", fontsize="small")


def draw_maps(axes: Axes, maps: MapSet, default: Measured) -> None:
    """Draw the share of maps within each mean error, the first trial beside the published methods."""
    means = {default.trial.label: np.array([errors.mean() for errors in default.direct])}
    means |= {f"{m} (published)": np.array(errors) for m, errors in maps.on(default.trial.pairs).items()}
    limit = max(_MIN_RANGE, *(float(values.max()) for values in means.values()))
    grid = np.linspace(0, limit, 501)
    for number, (label, values) in enumerate(means.items()):
        shares = (values[:, None] <= grid).mean(axis=0)
        axes.plot(grid, 100 * shares, linewidth=2 if number == 0 else 1, label=f"{label}, mean {values.mean():.3f}")
    axes.set(xlabel="mean error of the map", ylabel="maps within, %", xlim=(0, limit), ylim=(0, 102))
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="lower right", fontsize="small")


def outcome_of(results: Sequence[tuple[MapSet, Sequence[Measured]]]) -> Outcome:
    """Return the table, the plot and the sentences of the sets; the first trial of each is its default."""
    rows: list[Row] = []
    for maps, measured in results:
        rows += [measured_row(maps.name, one, measured[0]) for one in measured]
        rows += published_rows(maps, measured[0])

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(results), 2, squeeze=False)
        for (points, means), (maps, measured) in zip(grid, results, strict=True):
            draw_points(points, measured)
            draw_maps(means, maps, measured[0])
            points.set_title(maps.name)

    plot = Plot(draw=draw, title="Errors of points and of maps", size=(11.0, 4.2 * len(results)))
    text = "\n".join(f"- {sentence}" for maps, measured in results for sentence in findings(maps, measured))
    return Outcome(tables=(Table(columns=COLUMNS, rows=tuple(rows)),), plots=(plot,), text=text)


def findings(maps: MapSet, measured: Sequence[Measured]) -> list[str]:
    """Return what the figures of one set say: the first trial beside the best published method, and flips."""
    default = measured[0]
    mean = summary(default.direct)["mean"]
    num_bad = sum(bool(errors.mean() > BAD_MEAN) for errors in default.direct)
    sentences = [
        f"{maps.name}, {default.trial.label}: mean error {mean:.4f}; {num_bad} of {len(default.records)} maps have "
        f"one above {BAD_MEAN}."
    ]
    for other in measured[1:]:
        beside, own = default.mean_direct(other.trial.pairs), summary(other.direct)["mean"]
        if beside is not None and other.trial.variant == default.trial.variant:
            relation = "better" if own < beside else "no better"
            sentences.append(
                f"{maps.name}, {other.trial.label}: {relation} than the {default.trial.label} on its "
                f"{len(other.records)} pairs, {own:.4f} against {beside:.4f}."
            )
    published = {method: float(np.mean(errors)) for method, errors in maps.on(default.trial.pairs).items()}
    if published:
        best = min(published, key=lambda method: published[method])
        relation = "below" if mean < published[best] else "not below"
        sentences.append(
            f"{maps.name}: {relation} the {published[best]:.4f} of {best}, the best of {len(published)} published "
            f"method{'s' if len(published) > 1 else ''} on these pairs; flips count as errors here."
        )
    mirrors = {record["mirror_error"] for record in default.records}
    if mirrors == {None} and default.accepting_flips is None:
        sentences.append(f"{maps.name}: no self-map was confirmed as the mirror image, so flips count as errors.")
    elif mirrors != {None}:
        sentences.append(f"{maps.name}: the mirrored truth has a mean error of {max(mirrors):.4f} at the landmarks.")
    return sentences
