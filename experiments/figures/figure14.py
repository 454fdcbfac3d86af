"""Figure 14: time against d, against n, and against the full lifted relaxation."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.engine.records import Record
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.figures.full_lifted import solve_full_lifted
from experiments.figures.planted import planted_problem
from experiments.tables import Column, Row, Table
from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SEED = 0
#: Share of the target's points that each source point may match, and half-width of R's band (5-diagonal).
CANDIDATE_SHARE, BANDWIDTH = 0.3, 2
#: Relative accuracy asked of PM-SDP's value.
TOL = 1e-3
#: Seconds for one full relaxation; larger ones are not tried once this has been exceeded.
FULL_LIMIT_S = 240.0

#: The panels' sizes: what varies, all values, and the smallest ones.
PANELS: dict[str, tuple[str, tuple[int, ...], tuple[int, ...]]] = {
    "a": ("d", (3, 5, 8, 11, 14, 17, 20), (3,)),
    "b": ("n", (20, 40, 60, 80, 100), (10,)),
    "c": ("n", (5, 9, 13, 17, 21, 25), (4,)),
}
_AXIS = {"a": "d  (k = 50, n = 100)", "b": "n  (k = n / 2, d = 10)", "c": "n = k  (d = 10)"}

#: What the paper says of its own times: minutes at d = 17 in the setting of (a), and where its full relaxation stops.
PAPER_MINUTES = {("a", 17): "30 to 35"}
PAPER_SECONDS = [(17, 30 * 60.0), (17, 35 * 60.0)]
PAPER_FULL_LIMIT = 17

_ABOUT = f"""
R is 5-diagonal and each point has {100 * CANDIDATE_SHARE:.0f} % of the others as candidates, as in figure 14 of Maron
et al. 2016: (a) k = 50 and n = 100, (b) d = 10 and n = 2 k, (c) d = 10 and n = k, with the full lifted relaxation
(its equation 9, through CVXPY and Clarabel, stopped after {FULL_LIMIT_S:.0f} s of the wall clock, which a busy
machine reaches after less work) and with PM-SDP's row sums, which only k = n has. Elsewhere PM-SDP is as published.
Points are random; PM-SDP is solved to a relative gap of {TOL:g}. CPU time of one thread. Of the paper's times
those are given that its text states; they are for Mosek on its authors' machine.
"""


def figure14_problem(settings: dict[str, Any]) -> Problem:
    """Return the problem of one point of a panel."""
    size = settings["size"]
    num_target, num_source, dim = {
        "a": (100, 50, size),
        "b": (size, size // 2, 10),
        "c": (size, size, 10),
    }[settings["panel"]]
    return planted_problem(
        np.random.default_rng(settings["seed"]),
        num_target,
        num_source,
        dim,
        num_candidates=max(2, round(CANDIDATE_SHARE * num_target)),
        rotation_pattern=BANDWIDTH,
        group="O",
    )


def measure_dual(cell: Cell) -> Record:
    """Time PM-SDP by its dual."""
    problem = figure14_problem(cell.settings)
    solve_pm_sdp(
        planted_problem(np.random.default_rng(0), 5, 5, 3)
    )  # imports and the look-up of thread pools
    started = time.process_time()
    result = solve_pm_sdp(problem, row_sums=cell.settings.get("row_sums", False), tol=TOL)
    return {
        "seconds": time.process_time() - started,
        "value": result.value,
        "status": result.status.name,
    }


def measure_full(cell: Cell) -> Record:
    """Time the full lifted relaxation."""
    problem = figure14_problem(cell.settings)
    started = time.process_time()
    result = solve_full_lifted(problem, time_limit_s=cell.settings["limit_s"])
    return {
        "seconds": time.process_time() - started,
        "value": result.value,
        "status": result.status.name,
    }


def measure_full_sizes(bench: Bench, cells: dict[str, dict[str, Any]]) -> dict[str, Record]:
    """Return the full relaxation's records up to the first that was stopped by its limit, that one included."""
    records: dict[str, Record] = {}
    for label, settings in cells.items():
        records |= bench.measure(measure_full, {label: settings}, apart=True)
        if records[label]["status"] != Status.CONVERGED.name:
            break
    return records


def rows_of(
    panel: str,
    dual: dict[int, Record],
    full: dict[int, Record],
    tighter: dict[int, Record] | None = None,
) -> list[Row]:
    """Return the rows of one panel; beyond the full relaxation's limit its cells stay empty."""
    rows: list[Row] = []
    for size, record in dual.items():
        row: dict[str, Any] = {
            "panel": panel,
            "varies": PANELS[panel][0],
            "size": size,
            "pm_sdp": record["seconds"],
        }
        row["paper"] = PAPER_MINUTES.get((panel, size))
        if tighter:
            row["tighter"] = tighter[size]["seconds"]
            row["raised"] = tighter[size]["value"] / record["value"]
        if size in full:
            stopped = full[size]["status"] != Status.CONVERGED.name
            row["full"] = (
                f"stopped at {full[size]['seconds']:.0f}" if stopped else full[size]["seconds"]
            )
            row["difference"] = (
                None
                if stopped
                else abs(full[size]["value"] - record["value"]) / abs(record["value"])
            )
        rows.append(row)
    return rows


_COLUMNS = (
    Column(key="panel", title="panel"),
    Column(key="varies", title="varies"),
    Column(key="size", title="value"),
    Column(key="pm_sdp", title="PM-SDP, dual solver, s", format=".2f", clock=True),
    Column(key="tighter", title="with row sums, s", format=".2f", clock=True),
    Column(key="raised", title="its value / the published one", format=".2f"),
    Column(key="full", title="full lifted relaxation, s", format=".1f", clock=True),
    Column(key="difference", title="relative difference of their values", format=".0e"),
    Column(key="paper", title="PM-SDP in the paper, minutes"),
)


def draw_panel(axes: Axes, panel: str, dual: dict[int, Record], full: dict[int, Record]) -> None:
    """Draw one panel, and of the paper what is known."""
    axes.semilogy(
        list(dual),
        [record["seconds"] for record in dual.values()],
        "o-",
        label="PM-SDP, dual solver",
    )
    if panel == "a":
        axes.semilogy(*np.array(PAPER_SECONDS).T, "x", label="paper, Mosek")
    if panel == "c":
        done = {
            size: r["seconds"] for size, r in full.items() if r["status"] == Status.CONVERGED.name
        }
        axes.semilogy(list(done), list(done.values()), "s-", label="full lifted relaxation")
        axes.axvline(
            PAPER_FULL_LIMIT, linestyle=":", color="0.5", label="paper: full relaxation stops"
        )
    axes.set(title=f"({panel})", xlabel=_AXIS[panel], ylabel="seconds, one thread")
    axes.legend(fontsize="small")


def findings(dual: dict[str, dict[int, Record]], full: dict[int, Record]) -> str:
    """Return the comparison with the paper in sentences."""
    lines = []
    size, known = PAPER_SECONDS[0]
    if size in dual["a"]:
        factor = known / dual["a"][size]["seconds"]
        lines.append(
            f"At d = {size} in (a) the paper reports 30 to 35 minutes, at least {factor:.0f} times as long."
        )
    done = [size for size, record in full.items() if record["status"] == Status.CONVERGED.name]
    if done:
        lines.append(
            f"The full relaxation of (c) is solved up to {max(done)} points here and up to {PAPER_FULL_LIMIT} in the "
            f"paper; PM-SDP takes {dual['c'][max(done)]['seconds']:.2f} s there."
        )
    return "\n".join(lines)


def measure(bench: Bench) -> Outcome:
    """Run all panels, one point after the other."""
    bench.seeds.add(SEED)
    dual: dict[str, dict[int, Record]] = {}
    full: dict[int, Record] = {}
    tighter: dict[int, Record] = {}
    for panel, (varies, sizes, smallest) in PANELS.items():
        chosen = smallest if bench.quick else sizes
        settings = {size: {"panel": panel, "size": size, "seed": SEED} for size in chosen}
        records = bench.measure(
            measure_dual, {f"({panel}) {varies} = {s}": c for s, c in settings.items()}, apart=True
        )
        dual[panel] = dict(zip(chosen, records.values(), strict=True))
        if panel == "c":
            cells = {f"(c) full {s}": {**c, "limit_s": FULL_LIMIT_S} for s, c in settings.items()}
            full = dict(zip(chosen, measure_full_sizes(bench, cells).values(), strict=False))
            cells = {f"(c) row sums {s}": {**c, "row_sums": True} for s, c in settings.items()}
            tighter = dict(
                zip(chosen, bench.measure(measure_dual, cells, apart=True).values(), strict=True)
            )
    rows = [
        row
        for panel, records in dual.items()
        if panel != "c"
        for row in rows_of(panel, records, {})
    ]
    rows += rows_of("c", dual["c"], full, tighter)

    def draw(figure: Figure) -> None:
        for axes, (panel, records) in zip(figure.subplots(1, len(dual)), dual.items(), strict=True):
            draw_panel(axes, panel, records, full)

    return Outcome(
        tables=(Table(columns=_COLUMNS, rows=tuple(rows)),),
        plots=(
            Plot(
                draw=draw,
                title="Times of PM-SDP and of the full lifted relaxation",
                size=(12.0, 3.8),
            ),
        ),
        text=findings(dual, full),
    )


EXPERIMENT = Experiment(name="figure14", title="Figure 14: time", about=_ABOUT, measure=measure)
