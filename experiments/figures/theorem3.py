"""Theorem 3: all symmetries of a shape as extreme points of the relaxation's solution set."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from collalign.engine.records import Record
from data_tools.arrays import FloatArray
from data_tools.rotations import random_rotation
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.figures.exact_solutions import exact_solutions
from experiments.tables import Column, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Symmetries in O(3) of the shapes, the first two as the paper names them.
EXPECTED = {"chair": 2, "table": 4, "tetrahedron": 24, "cube": 48}
SEED = 3

_ABOUT = """
A shape and a rotated, reflected and shuffled copy of it: random linear energies of R are minimised over the exact
solutions of PM-SDP, and what comes out is rounded and verified (theorem 3 of Maron et al. 2016, who find the 2
symmetries of a chair and the 4 of a table). The drawing stops after ten draws without anything new.
"""


def shape_points(name: str, rng: np.random.Generator) -> FloatArray:
    """Return points with the symmetries of a chair (one mirror), a table (two), a tetrahedron or a cube, (n, 3)."""
    if name == "tetrahedron":
        return np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    if name == "cube":
        return np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    quarter = rng.random((5, 3)) + 0.1
    mirrors = (
        [(1, 1, 1), (-1, 1, 1)]
        if name == "chair"
        else [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1)]
    )
    return np.concatenate([quarter * np.array(signs, dtype=float) for signs in mirrors])


def measure_shape(cell: Cell) -> Record:
    """Count the exact solutions of a shape and its copy."""
    rng = np.random.default_rng(cell.settings["seed"])
    target = shape_points(cell.settings["shape"], rng)
    rotation = random_rotation(rng) * np.array([-1.0, 1.0, 1.0])
    source = target[rng.permutation(len(target))] @ rotation
    found = exact_solutions(target, source, group="O")
    return {
        "points": len(target),
        "symmetries": len(found.solutions),
        "closed": bool(found.is_group),
        "draws": found.num_draws,
        "energy": max(pose.energy for pose in found.solutions),
    }


def measure(bench: Bench) -> Outcome:
    """Run all shapes."""
    bench.seeds.add(SEED)
    chosen = ["chair", "table"] if bench.quick else list(EXPECTED)
    records = bench.measure(measure_shape, {name: {"shape": name, "seed": SEED} for name in chosen})
    rows = tuple(
        {
            "shape": name,
            "points": record["points"],
            "expected": EXPECTED[name],
            "found": record["symmetries"],
            "closed": "yes" if record["closed"] else "no",
            "draws": record["draws"],
        }
        for name, record in records.items()
    )
    columns = (
        Column(key="shape", title="shape"),
        Column(key="points", title="points"),
        Column(key="expected", title="symmetries in O(3)"),
        Column(key="found", title="found"),
        Column(key="closed", title="closed under composition"),
        Column(key="draws", title="draws"),
    )

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        places = np.arange(len(rows))
        axes.bar(
            places - 0.2, [row["expected"] for row in rows], 0.4, label="symmetries", color="0.7"
        )
        axes.bar(places + 0.2, [row["found"] for row in rows], 0.4, label="found")
        axes.set_xticks(places, [str(row["shape"]) for row in rows])
        axes.set_yscale("log", base=2)
        axes.legend()

    return Outcome(
        tables=(Table(columns=columns, rows=rows),),
        plots=(Plot(draw=draw, title="Symmetries found by extreme-point draws"),),
    )


EXPERIMENT = Experiment(
    name="theorem3", title="Theorem 3: all symmetries of a shape", about=_ABOUT, measure=measure
)
