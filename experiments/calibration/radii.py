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
from data_tools.arrays import FloatArray
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
        seen = [few_carried(folders[one], posed[one], sets) for one in collections]
        return scan(tried, collections, score, quick=quick) | fit_few(seen)


def few_carried(folder: Path, posed: LandmarkedFolder, num_sets: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return what one, two and three templates show at each carried landmark, and its error.

    Returns
    -------
    list of (ndarray, shape (m, 4), ndarray, shape (m,))
        By the number of templates: tilt, relief, residual and spread in radii, and errors in the collection's unit.
    """
    rng = np.random.default_rng([SEED, 1])
    found = []
    for num in range(1, radii.MIN_TEMPLATES):
        sets = [rng.permutation(len(posed.names))[:num].tolist() for _ in range(num_sets)]
        shown, errors = [], np.empty(0)
        for powers in np.eye(4).tolist():  # radii that are one of the four alone
            alone = {"_LOCAL_POWERS": powers[:3], "_SPREAD_POWERS": powers[3:] * 3, "_FEW_FACTORS": [1.0] * 3}
            with patched(radii, alone):
                carried = [carried_errors(folder / "out", posed, chosen, _run(folder)) for chosen in sets]
            errors = np.concatenate([errors.ravel() for errors, _ in carried])
            shown.append(np.concatenate([said.ravel() for _, said in carried]))
        known = np.isfinite(errors) & np.isfinite(shown).all(axis=0)
        found.append((np.array(shown).T[known], errors[known]))
    return found


def fit_few(seen: Sequence[Sequence[tuple[FloatArray, FloatArray]]]) -> dict[str, Finding]:
    """Return powers fitted to logarithms of errors, and the factors with which radii hold in every collection.

    Parameters
    ----------
    seen : sequence of :func:`few_carried`
        Of each collection.
    """
    local, spreads = _powers(seen)
    ranks = [_ranks(one, local, spreads) for one in seen]
    others = [[*seen[:at], *seen[at + 1 :]] for at in range(len(seen))]
    held = [_ranks(one, *_powers(rest)) for one, rest in zip(seen, others, strict=True) if rest]
    factors = [
        max(float(np.quantile(errors / _said(shown, local, power), radii.COVERAGE)) for shown, errors in of_number)
        for of_number, power in zip(zip(*seen, strict=True), spreads, strict=True)
    ]
    now = [_ranks(one, radii._LOCAL_POWERS, radii._SPREAD_POWERS) for one in seen]
    scores = {
        "now": float(np.mean(now)),
        "best": float(np.mean(ranks)),
        "left_out": float(np.mean(held)) if held else np.nan,
    }
    return {
        "_LOCAL_POWERS": Finding(value=tuple(local), **scores),
        "_SPREAD_POWERS": Finding(value=tuple(spreads), **scores),
        "_FEW_FACTORS": Finding(value=tuple(factors)),
    }


def _powers(seen: Sequence[Sequence[tuple[FloatArray, FloatArray]]]) -> tuple[list[float], list[float]]:
    """Fit powers of what is local, the same for all numbers of templates, and of the spread, to several collections.

    Each collection counts as much as another, and has a factor of its own.
    """
    parts = [(c, n) for c, one in enumerate(seen) for n in range(len(one))]
    rows, goals = list[FloatArray](), list[FloatArray]()
    for at, (c, n) in enumerate(parts):
        shown, errors = seen[c][n]
        logs = np.log(np.maximum(shown, radii._LEAST_DISTANCE))
        spread, factor = np.zeros((len(logs), len(seen[c]))), np.zeros((len(logs), len(parts)))
        spread[:, n], factor[:, at] = logs[:, 3] * (n > 0), 1.0
        weight = 1.0 / np.sqrt(len(logs))
        rows.append(weight * np.hstack([logs[:, :3], spread, factor]))
        goals.append(weight * np.log(np.maximum(errors, radii._LEAST_DISTANCE)))
    found = np.linalg.lstsq(np.concatenate(rows), np.concatenate(goals), rcond=None)[0]
    return found[:3].tolist(), found[3 : 3 + len(seen[0])].tolist()


def _said(shown: FloatArray, local: Sequence[float], spread: float) -> FloatArray:
    return np.asarray(np.prod(np.maximum(shown, radii._LEAST_DISTANCE) ** np.array([*local, spread]), axis=1))


def _ranks(
    one: Sequence[tuple[FloatArray, FloatArray]], local: Sequence[float], spreads: Sequence[float]
) -> list[float]:
    """Return the rank correlation of radius and error for each number of templates."""
    pairs = zip(one, spreads, strict=True)
    return [float(spearmanr(_said(shown, local, power), errors).statistic) for (shown, errors), power in pairs]


def _run(folder: Path) -> RunOptions:
    return RunOptions(jobs=1, store=folder / STORE_FILE)


CALIBRATION = Calibration(
    module=radii.__name__,
    constants=constants_of(radii, *SCANNED, "_LOCAL_POWERS", "_SPREAD_POWERS", "_FEW_FACTORS"),
    measure=measure_radii,
    collections=("teeth", "mouse skulls"),
    score="Spearman correlation of radius and error",
)
