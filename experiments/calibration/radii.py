"""What foretells the errors of carried landmarks, by how well error radii rank the errors."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.stats import spearmanr

import collalign
from collalign.confidence import radius_model as radii
from collalign.engine.run_options import RunOptions
from collalign.engine.store.file import STORE_FILE
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


#: What the rows of the table of few templates are called.
FEW = ("OF_FEW[0]", "OF_FEW[1]", "OF_FEW[2]")
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

        tried = constants_of(radii, *SCANNED)
        sets = NUM_QUICK_SETS if quick else NUM_SETS
        seen = [few_carried(folders[one], posed[one], sets) for one in collections]
        return scan(tried, collections, score, quick=quick) | fit_few(seen)


def few_carried(
    folder: Path, posed: LandmarkedFolder, num_sets: int
) -> list[tuple[FloatArray, FloatArray]]:
    """Return what one, two and three templates show at each carried landmark, and its error.

    Returns
    -------
    list of (ndarray, shape (m, 4), ndarray, shape (m,))
        By the number of templates: tilt, relief, residual and spread in radii, and errors in the variation of the
        shapes.
    """
    rng = np.random.default_rng([SEED, 1])
    found = []
    for num in range(1, radii.MIN_TEMPLATES):
        sets = [rng.permutation(len(posed.names))[:num].tolist() for _ in range(num_sets)]
        alone, errors = [], np.empty(0)
        for powers in np.vstack(
            [np.zeros(4), np.eye(4)]
        ).tolist():  # radii that show one number alone
            with patched(radii, {"OF_FEW": 3 * ((1.0, *powers),)}):
                carried = [
                    carried_errors(folder / "out", posed, chosen, _run(folder)) for chosen in sets
                ]
            errors = np.concatenate([errors.ravel() for errors, _ in carried])
            alone.append(np.concatenate([said.ravel() for _, said in carried]))
        units, shown = alone[0], np.array(alone[1:]).T / alone[0][:, None]
        known = np.isfinite(errors) & np.isfinite(shown).all(axis=1)
        found.append((shown[known], errors[known] / units[known]))
    return found


def fit_few(seen: Sequence[Sequence[tuple[FloatArray, FloatArray]]]) -> dict[str, Finding]:
    """Return the powers that rank errors best, and the factors with which radii hold in every collection.

    Parameters
    ----------
    seen : sequence of :func:`few_carried`
        Of each collection.
    """
    powers, code = _powers(seen), [row[1:] for row in radii.OF_FEW]
    others = [[*seen[:at], *seen[at + 1 :]] for at in range(len(seen))]
    held = [
        _ranks(one, _powers(rest)) if rest else [np.nan] * len(one)
        for one, rest in zip(seen, others, strict=True)
    ]
    scores = [
        np.mean(ranks, axis=0)
        for ranks in (
            [_ranks(one, code) for one in seen],
            [_ranks(one, powers) for one in seen],
            held,
        )
    ]
    found = {}
    for number, name in enumerate(FEW):
        ratios = [
            errors / _said(shown, powers[number]) for shown, errors in (one[number] for one in seen)
        ]
        factor = max(float(np.quantile(one, radii.COVERAGE)) for one in ratios)
        now, best, left_out = (float(score[number]) for score in scores)
        found[name] = Finding(
            value=(factor, *powers[number]), now=now, best=best, left_out=left_out
        )
    return found


def _powers(seen: Sequence[Sequence[tuple[FloatArray, FloatArray]]]) -> list[tuple[float, ...]]:
    """Return powers for each number of templates that rank errors best; those of what is local are the same for all.

    The rank correlation is that of the collection with the least, on average over the numbers of templates.
    """

    def split(numbers: FloatArray) -> list[tuple[float, ...]]:
        return [(*numbers[:3].tolist(), spread) for spread in (0.0, *numbers[3:].tolist())]

    def loss(numbers: FloatArray) -> float:
        return -float(np.min([_ranks(one, split(numbers)) for one in seen], axis=0).mean())

    start = np.array([*radii.OF_FEW[0][1:4], *(row[4] for row in radii.OF_FEW[1:])])
    return split(
        minimize(loss, start, method="Nelder-Mead", options={"xatol": 0.01, "fatol": 1e-4}).x
    )


def _said(shown: FloatArray, powers: Sequence[float]) -> FloatArray:
    return np.asarray(np.prod(np.maximum(shown, radii._LEAST_DISTANCE) ** np.array(powers), axis=1))


def _ranks(
    one: Sequence[tuple[FloatArray, FloatArray]], powers: Sequence[Sequence[float]]
) -> list[float]:
    """Return the rank correlation of radius and error for each number of templates."""
    pairs = zip(one, powers, strict=True)
    return [float(spearmanr(_said(shown, own), errors).statistic) for (shown, errors), own in pairs]


def _run(folder: Path) -> RunOptions:
    return RunOptions(jobs=1, store=folder / STORE_FILE)


CALIBRATION = Calibration(
    module=radii.__name__,
    constants=constants_of(radii, *SCANNED) | dict(zip(FEW, radii.OF_FEW, strict=True)),
    measure=measure_radii,
    collections=("teeth", "mouse skulls"),
    score="Spearman correlation of radius and error",
)
