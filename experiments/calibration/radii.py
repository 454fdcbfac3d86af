"""What foretells the errors of landmarks carried from many templates, by how well radii rank the errors."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

import collalign
from collalign.confidence import radius_model as radii
from collalign.engine.run_options import RunOptions
from collalign.engine.store_file import STORE_FILE
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.collections.carrying import carried_errors, write_posed
from experiments.experiment import Cell

#: Specimens of each collection, drawn at random, and how many of them are templates.
NUM_SHAPES, NUM_TEMPLATES = 16, 7
NUM_QUICK_SHAPES, NUM_QUICK_TEMPLATES = 5, 4
SEED = 5
#: Constants of which other values are tried.
SCANNED = ("_SPREAD_WEIGHT", "_DISTANCE_POWER", "_RESIDUAL_POWER")


def measure_radii(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Carry landmarks to specimens that are no templates, with other values; registrations are made once."""
    num, num_templates = (
        (NUM_QUICK_SHAPES, NUM_QUICK_TEMPLATES) if quick else (NUM_SHAPES, NUM_TEMPLATES)
    )
    with ExitStack() as stack:
        folders = {
            one: Path(stack.enter_context(tempfile.TemporaryDirectory())) for one in collections
        }
        posed = {}
        for collection, folder in folders.items():
            (folder / "shapes").mkdir()
            cell = Cell(data=data, settings={"dataset": collection, "num": num, "seed": SEED})
            posed[collection] = write_posed(cell, folder / "shapes")
            aligned = collalign.align_collection(
                folder / "shapes", run=_run(folder), progress=False
            )
            aligned.save(folder / "out", report=False)

        def score(collection: str, changed: Mapping[str, Constant]) -> float:
            folder = folders[collection]
            with patched(radii, changed):
                errors, said = carried_errors(
                    folder / "out", posed[collection], range(num_templates), _run(folder)
                )
            known = np.isfinite(errors) & np.isfinite(said)
            return float(spearmanr(said[known], errors[known]).statistic)

        return scan(constants_of(radii, *SCANNED), collections, score, quick=quick)


def _run(folder: Path) -> RunOptions:
    return RunOptions(jobs=1, store=folder / STORE_FILE)


CALIBRATION = Calibration(
    module=radii.__name__,
    constants=constants_of(radii, *SCANNED),
    measure=measure_radii,
    collections=("teeth", "mouse skulls"),
    score="Spearman correlation of radius and error",
)
