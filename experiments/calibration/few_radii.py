"""What foretells the errors of landmarks carried from one, two or three templates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.stats import spearmanr

from collalign.confidence import radius_model as radii
from data_tools.arrays import FloatArray
from experiments.calibration.scan import Calibration, Finding
from experiments.collections.carrying import measure_few
from experiments.experiment import Cell

#: Shapes of each collection, drawn at random, and random sets of one, two and three templates.
SETTINGS = {"num": 12, "seed": 77, "sets": 12}
QUICK_SETTINGS = {"num": 5, "seed": 77, "sets": 2}
#: Collections with landmarks: specimens, generated bones, and classes of objects and animals.
COLLECTIONS = ("teeth", "mouse skulls", "long bones", "teddy", "fish", "plane", "bird")
#: What the rows of the table are called.
FEW = ("OF_FEW[0]", "OF_FEW[1]", "OF_FEW[2]")
#: Errors below it, in the variation of the shapes, are the hand's.
LEAST_ERROR = 1e-3
#: Of one collection, by the number of templates: what radii follow, shape (m, 4), and errors, shape (m,).
Seen: TypeAlias = Sequence[tuple[FloatArray, FloatArray]]


def measure_few_radii(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit radii of few templates to the errors of all collections together, and of all but one."""
    settings = QUICK_SETTINGS if quick else SETTINGS
    records = (
        measure_few(Cell(data=data, settings={**settings, "dataset": one})) for one in collections
    )
    return fit_few([seen_in(record) for record in records if was_carried(record)])


def was_carried(record: Mapping[str, Any]) -> bool:
    """Return whether any landmark was carried: poses in doubt carry none."""
    return "variation" in record


def seen_in(record: Mapping[str, Any]) -> Seen:
    """Return what :func:`measure_few` measured, by the number of templates."""
    least = max(record["variation"], radii.LEAST_RANGE)
    both = (
        (np.array(record[f"shown {k}"]), np.array(record[f"errors {k}"]) / least)
        for k in range(1, radii.MIN_TEMPLATES)
    )
    return [
        (shown[known], errors[known])
        for shown, errors in both
        for known in [np.isfinite(errors) & np.isfinite(shown).all(axis=1)]
    ]


def fit_few(seen: Sequence[Seen]) -> dict[str, Finding]:
    """Return the table of few templates that fits several collections, and its rank correlations."""
    fitted = few_table(seen)
    others = [[*seen[:at], *seen[at + 1 :]] for at in range(len(seen))]
    left_out = [few_table(rest) if rest else len(FEW) * [(np.nan,) * 5] for rest in others]
    scores = np.array(
        [
            [ranked(one, table) for one, table in zip(seen, tables, strict=True)]
            for tables in (len(seen) * [radii.OF_FEW], len(seen) * [fitted], left_out)
        ]
    ).mean(axis=1)
    return {
        name: Finding(value=row, now=now, best=best, left_out=without)
        for name, row, (now, best, without) in zip(FEW, fitted, scores.T.tolist(), strict=True)
    }


def few_table(seen: Sequence[Seen]) -> tuple[tuple[float, ...], ...]:
    """Return factors and powers with which radii hold as often as they say.

    Powers are the least-squares fit of the logarithms of errors, each less its mean over a collection. Those of what
    is local are the same for all numbers of templates, with one of the spread for two and for three. Every collection
    counts the same, in the fit and in the share of errors within the radii.
    """
    blocks, logs = [], []
    for one in seen:
        for number, (shown, errors) in enumerate(one):
            block = np.zeros((len(errors), 2 + len(one)))
            local, spread = np.split(np.log(np.maximum(shown, radii.LEAST_SHOWN)), [3], axis=1)
            block[:, :3] = local
            if number:
                block[:, [2 + number]] = spread
            log = np.log(np.maximum(errors, LEAST_ERROR))
            weight = 1.0 / np.sqrt(max(1, len(errors)))
            blocks.append(weight * (block - block.mean(axis=0)))
            logs.append(weight * (log - log.mean()))
    powers = np.linalg.lstsq(np.concatenate(blocks), np.concatenate(logs), rcond=None)[0].tolist()
    table = []
    for number in range(len(FEW)):
        row = (*powers[:3], powers[2 + number] if number else 0.0)
        ratios = [
            errors / _radii(shown, (1.0, *row)) for shown, errors in (one[number] for one in seen)
        ]
        weights = np.concatenate([np.full(len(one), 1.0 / max(1, len(one))) for one in ratios])
        every = np.concatenate(ratios)
        order = np.argsort(every, kind="stable")
        reached = np.cumsum(weights[order]) / weights.sum()
        table.append((float(every[order][np.searchsorted(reached, radii.COVERAGE)]), *row))
    return tuple(table)


def ranked(one: Seen, table: Sequence[Sequence[float]]) -> list[float]:
    """Return the rank correlation of radius and error for each number of templates."""
    return [
        float(spearmanr(_radii(shown, row), errors).statistic)
        for (shown, errors), row in zip(one, table, strict=True)
    ]


def covered(one: Seen, table: Sequence[Sequence[float]]) -> list[float]:
    """Return the share of errors within their radii for each number of templates."""
    return [
        float(np.mean(errors <= _radii(shown, row)))
        for (shown, errors), row in zip(one, table, strict=True)
    ]


def _radii(shown: FloatArray, row: Sequence[float]) -> FloatArray:
    """Return radii in the variation of the shapes."""
    factor, *powers = row
    known = np.maximum(shown, radii.LEAST_SHOWN)
    return np.asarray(factor * np.prod(known ** np.array(powers), axis=1))


CALIBRATION = Calibration(
    module=radii.__name__,
    constants=dict(zip(FEW, radii.OF_FEW, strict=True)),
    measure=measure_few_radii,
    collections=COLLECTIONS,
    score="Spearman correlation of radius and error, mean of the collections",
)
