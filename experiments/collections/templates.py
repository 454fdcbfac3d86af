"""Landmarks of mouse skulls with each specimen as the only template: whether the choice of the template matters."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import collalign
from collalign.analysis.procrustes import generalized_procrustes
from collalign.engine.records import Record
from collalign.engine.run_options import RunOptions
from collalign.engine.store_file import STORE_FILE
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.landmark_files import Landmarks
from experiments.clock import stopwatch
from experiments.collections.carrying import write_posed
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATASET, FOLDER = "mouse skulls", "mouse_skulls62"
#: Specimens drawn of the 62, each of which is the template once.
NUM_SPECIMENS, SEED = 31, 21
#: Raised when the registration or the poses change.
VERSION = "4"
#: Published agreement of answers from different starts (see the text).
CONSENSUS_RV, ALPACA_RV = 0.960, 0.944

_ABOUT = f"""
**Data.** {NUM_SPECIMENS} of 62 skulls of mice, one a strain, drawn at random, with 51 landmarks each by experts (C.
Zhang et al., *MALPACA*, PLOS ONE 2022; github.com/SlicerMorph/Mouse_Models, without a stated licence, so that no
picture of them is shown here). Meshes of 12 000 vertices, in random poses.

**Rule.** The skulls are aligned with default options, and `collalign transfer` carries the landmarks of one of them
to all others, for each of them in turn. *Agreement*: the RV coefficient (Robert and Escoufier 1976) of two templates'
answers, all specimens superimposed; 1 if the morphospaces are the same up to a similarity. A template's own landmarks
are the experts'. A preprint of 2026 has a mean RV of {ALPACA_RV:.3f} for ALPACA with different templates, and of
{CONSENSUS_RV:.3f} for its consensus of many, on all 62 skulls.
The radii of registration were chosen on 22 of the 62 skulls, other constants of it on eight.
"""


def measure_templates(cell: Cell) -> Record:
    """Align the specimens, and carry the landmarks of each to all others.

    Settings: ``dataset``, ``num``, ``seed``.

    Returns
    -------
    dict
        ``errors`` (N, N, l) from template (first) to specimen, 0 for the template itself, NaN where none was placed;
        ``products`` (N, N, N) of each template's superimposed configurations, ``landmarks`` (N, N) of the experts';
        ``dropped``: landmarks that some template gave to none or not to all; ``processor_s``.
    """
    with tempfile.TemporaryDirectory() as scratch:
        (folder := Path(scratch) / "shapes").mkdir()
        posed, out = write_posed(cell, folder), Path(scratch) / "out"
        run = RunOptions(jobs=1, store=Path(scratch) / STORE_FILE)
        labels = tuple(str(number) for number in range(posed.landmarks.shape[1]))
        answers = []
        with stopwatch() as elapsed:
            collalign.align_collection(folder, run=run, progress=False).save(out, report=False)
            for at, name in enumerate(posed.names):
                given = {name: Landmarks(labels=labels, points=posed.landmarks[at])}
                found = collalign.landmarks.transfer_landmarks(out, given, run=run, progress=False)
                if found.names != posed.names:
                    raise InputError("a shape was left out: errors would be those of a choice")
                answers.append(found.points)
    configurations = np.array(answers)
    kept = np.isfinite(configurations).all(axis=(0, 1, 3))
    return {
        "errors": np.linalg.norm(configurations - posed.landmarks, axis=3) / posed.units[:, None],
        "products": np.array([products(one[:, kept]) for one in configurations]),
        "landmarks": products(posed.landmarks[:, kept]),
        "dropped": int((~kept).sum()),
        "processor_s": elapsed.processor_s,
    }


def products(configurations: FloatArray) -> FloatArray:
    """Return the inner products of configurations, superimposed and centred on their mean, shape (N, N)."""
    aligned = generalized_procrustes(configurations)
    flat = (aligned - aligned.mean(axis=0)).reshape(len(aligned), -1)
    return np.asarray(flat @ flat.T)


def rv_coefficient(first: FloatArray, second: FloatArray) -> float:
    """Return how alike two configurations of the same specimens are, from their inner products: 1 up to a similarity.

    References
    ----------
    Robert and Escoufier, A unifying tool for linear multivariate statistical methods: the RV-coefficient, Applied
    Statistics 25 (1976).
    """
    return float((first * second).sum() / np.sqrt((first**2).sum() * (second**2).sum()))


def measure(bench: Bench) -> Outcome:
    """Carry the landmarks of each specimen to all others; with ``--quick`` of four."""
    bench.seeds.add(SEED)
    settings: dict[str, Any] = {
        "dataset": DATASET,
        "num": 4 if bench.quick else NUM_SPECIMENS,
        "seed": SEED,
    }
    record = bench.measure(measure_templates, {DATASET: settings}, version=VERSION, apart=True)[
        DATASET
    ]
    errors = of_others(np.array(record["errors"]))
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=(row_of(record),)),),
        plots=(
            Plot(
                draw=lambda figure: _draw(figure, errors),
                title="Mean error by template, mm",
                size=(6.0, 3.0),
            ),
        ),
    )


def of_others(errors: FloatArray) -> FloatArray:
    """Return each template's mean error on the specimens that are not the template, shape (N,)."""
    others = ~np.eye(len(errors), dtype=bool)
    return np.array([np.nanmean(row[chosen]) for row, chosen in zip(errors, others, strict=True)])


def row_of(record: Record) -> Row:
    """Return the figures of all templates."""
    grams, marks, errors = (np.array(record[key]) for key in ("products", "landmarks", "errors"))
    agreement = [rv_coefficient(*pair) for pair in itertools.combinations(grams, 2)]
    by_template = of_others(errors)
    return {
        "templates": len(grams),
        "rv": float(np.mean(agreement)),
        "worst_rv": min(agreement),
        "alpaca": ALPACA_RV,
        "consensus": CONSENSUS_RV,
        "rv_landmarks": float(np.mean([rv_coefficient(gram, marks) for gram in grams])),
        "error": float(by_template.mean()),
        "least_error": float(by_template.min()),
        "worst_error": float(by_template.max()),
        "dropped": record["dropped"],
        "processor_s": record["processor_s"],
    }


COLUMNS = (
    Column(key="templates", title="templates"),
    Column(key="rv", title="RV of two templates, mean", format=".4f"),
    Column(key="worst_rv", title="least", format=".4f"),
    Column(key="alpaca", title="ALPACA, published", format=".3f"),
    Column(key="consensus", title="its consensus, published", format=".3f"),
    Column(key="rv_landmarks", title="RV with the experts", format=".3f"),
    Column(key="error", title="mean error, mm", format=".3f"),
    Column(key="least_error", title="best template", format=".3f"),
    Column(key="worst_error", title="worst template", format=".3f"),
    Column(key="dropped", title="landmarks left out of RV"),
    Column(key="processor_s", title="CPU, s", format=".0f", clock=True),
)


def _draw(figure: Figure, errors: FloatArray) -> None:
    axes = figure.subplots()
    axes.bar(range(len(errors)), np.sort(errors))
    axes.set_xlabel("template, by error")
    axes.set_ylabel("mean error, mm")


EXPERIMENT = Experiment(
    name="templates",
    title="Each skull as the template",
    about=_ABOUT,
    measure=measure,
    collections=(FOLDER,),
)
