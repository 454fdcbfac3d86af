"""What foretells the errors of landmarks carried from one, two or three templates: radii and ellipsoids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
#: Errors below it, in the variation of the shapes, are the hand's.
LEAST_ERROR = 1e-3
#: Rounds of the quantile regression, and below which part of an error's logarithm a residual is none.
_NUM_ROUNDS, _LEAST_RESIDUAL = 100, 1e-3
#: Of one collection, by the number of templates: what radii or ellipsoids follow, (m, n), and errors, (m,).
Seen: TypeAlias = Sequence[tuple[FloatArray, FloatArray]]
#: A factor and powers for every number of templates.
FewTable: TypeAlias = Sequence[tuple[float, ...]]


@dataclass(frozen=True, kw_only=True)
class Followed:
    """What is fitted.

    Attributes
    ----------
    constants : mapping of str to tuple of float
        The table, by what its rows are called.
    least : tuple of float
        What is followed says no more below these.
    shown, errors : str
        Keys of :func:`measure_few`'s records.
    """

    constants: Mapping[str, tuple[float, ...]]
    least: tuple[float, ...]
    shown: str
    errors: str

    def seen_in(self, record: Mapping[str, Any]) -> Seen:
        """Return what :func:`measure_few` measured, by the number of templates."""
        least = max(record["variation"], radii.LEAST_RANGE)
        both = (
            (np.array(record[f"{self.shown} {k}"]), np.array(record[f"{self.errors} {k}"]) / least)
            for k in range(1, radii.MIN_TEMPLATES)
        )
        return [
            (shown[known], errors[known])
            for shown, errors in both
            for known in [np.isfinite(errors) & np.isfinite(shown).all(axis=1)]
        ]

    def sizes(self, seen: Seen, table: FewTable) -> list[FloatArray]:
        """Return radii, or sizes of ellipsoids, in the variation of the shapes, by the number of templates."""
        return [
            radii.sizes_of_few(shown, self.least, row)
            for (shown, _), row in zip(seen, table, strict=True)
        ]

    def ranked(self, seen: Seen, table: FewTable) -> list[float]:
        """Return the rank correlation of size and error for each number of templates."""
        sizes = zip(self.sizes(seen, table), seen, strict=True)
        return [float(spearmanr(size, errors).statistic) for size, (_, errors) in sizes]

    def covered(self, seen: Seen, table: FewTable) -> list[float]:
        """Return the share of errors within their sizes for each number of templates."""
        sizes = zip(self.sizes(seen, table), seen, strict=True)
        return [float(np.mean(errors <= size)) for size, (_, errors) in sizes]

    def table(self, seen: Sequence[Seen]) -> FewTable:
        """Return factors and powers with which sizes hold nine of ten errors of every collection.

        Powers are those of a quantile regression of the logarithms of errors, in which every collection counts the
        same. One template shows no spread.

        References
        ----------
        Koenker and Bassett, Regression quantiles, Econometrica 46 (1978); by reweighted least squares, as in
        Schlossmacher, An iterative technique for absolute deviations curve fitting (1973).
        """
        table = list[tuple[float, ...]]()
        for number in range(radii.MIN_TEMPLATES - 1):
            of = [one[number] for one in seen]
            kept = np.arange(len(self.least) if number else len(self.least) - 1)
            logs = [np.log(np.maximum(shown, self.least))[:, kept] for shown, _ in of]
            errors = [np.log(np.maximum(errors, LEAST_ERROR)) for _, errors in of]
            powers = np.zeros(len(self.least))
            powers[kept] = _quantile_powers(logs, errors)
            needed = [
                _quantile(errors / radii.sizes_of_few(shown, self.least, (1.0, *powers)))
                for shown, errors in of
            ]
            table.append((max(needed), *powers.tolist()))
        return table

    def fit(self, seen: Sequence[Seen]) -> dict[str, Finding]:
        """Return the table of few templates that fits several collections, and its rank correlations."""
        fitted = self.table(seen)
        others = [[*seen[:at], *seen[at + 1 :]] for at in range(len(seen))]
        nothing = [(np.nan,) * (1 + len(self.least))] * len(fitted)
        left_out = [self.table(rest) if rest else nothing for rest in others]
        present = [*self.constants.values()]
        scores = np.array(
            [
                [self.ranked(one, table) for one, table in zip(seen, tables, strict=True)]
                for tables in (len(seen) * [present], len(seen) * [fitted], left_out)
            ]
        ).mean(axis=1)
        return {
            name: Finding(value=row, now=now, best=best, left_out=without)
            for name, row, (now, best, without) in zip(
                self.constants, fitted, scores.T.tolist(), strict=True
            )
        }

    def measure(self, data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
        """Fit to the errors of all collections together, and of all but one."""
        settings = QUICK_SETTINGS if quick else SETTINGS
        records = (
            measure_few(Cell(data=data, settings={**settings, "dataset": one}))
            for one in collections
        )
        return self.fit([self.seen_in(record) for record in records if was_carried(record)])


def was_carried(record: Mapping[str, Any]) -> bool:
    """Return whether any landmark was carried: poses in doubt carry none."""
    return "variation" in record


def _quantile_powers(logs: Sequence[FloatArray], errors: Sequence[FloatArray]) -> FloatArray:
    """Return the slopes of the quantile of errors on logs, of several collections together, shape (n,)."""
    every = np.concatenate(logs)
    rows, right = np.column_stack([every, np.ones(len(every))]), np.concatenate(errors)
    counts = np.concatenate([np.full(len(one), 1.0 / max(1, len(one))) for one in errors])
    weights = counts
    for _ in range(_NUM_ROUNDS):
        weighted = rows.T * weights
        slopes = np.linalg.lstsq(weighted @ rows, weighted @ right, rcond=None)[0]
        away = right - rows @ slopes
        sides = np.where(away > 0, radii.COVERAGE, 1.0 - radii.COVERAGE)
        weights = counts * sides / np.maximum(np.abs(away), _LEAST_RESIDUAL)
    return np.asarray(slopes[:-1])


def _quantile(ratios: FloatArray) -> float:
    return float(np.quantile(ratios, radii.COVERAGE)) if len(ratios) else 0.0


#: Radii of few templates, and their ellipsoids.
RADII = Followed(
    constants={f"OF_FEW[{at}]": row for at, row in enumerate(radii.OF_FEW)},
    least=radii.LEAST_SHOWN,
    shown="shown",
    errors="errors",
)
ELLIPSOIDS = Followed(
    constants={f"ELLIPSOIDS_OF_FEW[{at}]": row for at, row in enumerate(radii.ELLIPSOIDS_OF_FEW)},
    least=radii.LEAST_SHOWN_HELD,
    shown="shown held",
    errors="held",
)


def calibration(followed: Followed) -> Calibration:
    """Return the calibration of what is followed."""
    return Calibration(
        module=radii.__name__,
        constants=followed.constants,
        measure=followed.measure,
        collections=COLLECTIONS,
        score="Spearman correlation of size and error, mean of the collections",
    )


CALIBRATION, OF_ELLIPSOIDS = calibration(RADII), calibration(ELLIPSOIDS)
