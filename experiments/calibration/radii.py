"""What foretells the errors of carried landmarks, by how well error radii rank the errors."""

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
from collalign.engine.store.layout import STORE_FILE
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.collections.carrying import LandmarkedFolder, carried_errors, write_posed
from experiments.experiment import Cell

#: Specimens of each collection, drawn at random, and how many of them are templates.
NUM_SHAPES, NUM_TEMPLATES = 16, 7
NUM_QUICK_SHAPES, NUM_QUICK_TEMPLATES = 5, 4
SEED = 5
#: Random choices of one, two and three templates.
NUM_SETS, NUM_QUICK_SETS = 14, 2


#: Constants of which other values are tried.
SCANNED = ("_SPREAD_WEIGHT", "_DISTANCE_POWER", "_RESIDUAL_POWER")


def measure_radii(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Carry landmarks to specimens that are no templates, with other values; registrations are made once."""
    num, num_templates = (NUM_QUICK_SHAPES, NUM_QUICK_TEMPLATES) if quick else (NUM_SHAPES, NUM_TEMPLATES)
    with ExitStack() as stack:
        folders = {one: Path(stack.enter_context(tempfile.TemporaryDirectory())) for one in collections}
        posed = {}
        for collection, folder in folders.items():
            (folder / "shapes").mkdir()
            cell = Cell(data=data, settings={"dataset": collection, "num": num, "seed": SEED})
            posed[collection] = write_posed(cell, folder / "shapes")
            aligned = collalign.align_collection(folder / "shapes", run=_run(folder), progress=False)
            aligned.save(folder / "out", report=False)

        def score(collection: str, changed: Mapping[str, Constant]) -> float:
            folder = folders[collection]
            with patched(radii, changed):
                errors, said = carried_errors(folder / "out", posed[collection], range(num_templates), _run(folder))
            known = np.isfinite(errors) & np.isfinite(said)
            return float(spearmanr(said[known], errors[known]).statistic)

        tried = constants_of(radii, *SCANNED)
        sets = NUM_QUICK_SETS if quick else NUM_SETS
        few = np.array([few_factors(folders[one], posed[one], sets) for one in collections])
        return scan(tried, collections, score, quick=quick) | {"_FEW_FACTORS": Finding(value=tuple(few.max(axis=0)))}


def few_factors(folder: Path, posed: LandmarkedFolder, num_sets: int) -> list[float]:
    """Return with which factors so many landmarks lie within the radii of one, two and three templates."""
    rng = np.random.default_rng([SEED, 1])
    found = []
    for num, factor in enumerate(radii._FEW_FACTORS, start=1):
        sets = [rng.permutation(len(posed.names))[:num].tolist() for _ in range(num_sets)]
        carried = [carried_errors(folder / "out", posed, chosen, _run(folder)) for chosen in sets]
        ratios = np.concatenate([(errors / said).ravel() for errors, said in carried])
        found.append(factor * float(np.nanquantile(ratios, radii.COVERAGE)))
    return found


def _run(folder: Path) -> RunOptions:
    return RunOptions(jobs=1, store=folder / STORE_FILE)


CALIBRATION = Calibration(
    module=radii.__name__,
    constants=constants_of(radii, *SCANNED, "_FEW_FACTORS"),
    measure=measure_radii,
    collections=("teeth", "mouse skulls"),
    score="Spearman correlation of radius and error",
)
