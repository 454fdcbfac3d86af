"""Ways to match the pairs of a benchmark of maps, and what was measured of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from collalign.engine.store.records import Record
from data_tools.arrays import FloatArray
from experiments.experiment import Bench
from experiments.maps.map_cells import NUM_EVALUATED, errors_of, measure_map
from experiments.maps.map_sets import MapSet, Pair

DEFAULT = "default"
COPIES = ("permuted", "remeshed")
#: Of the choice of pairs.
SEED = 0
#: Surfaces of ``--quick``: fewer functions and samples.
QUICK_SURFACE = {"num_functions": 40, "num_samples": 60, "num_dense": 200}


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One way to match some pairs of a set.

    Attributes
    ----------
    label : str
    pairs : tuple of pair of str
        Target and source.
    variant : str
        Of both shapes, see :data:`experiments.maps.map_sets.VARIANTS`.
    options : dict
        Of the paper's chain: its ``strategy``, "paper" or "fast", and a ``mask_share``; none for the default.
    surface : dict
        Of :class:`~collalign.nonrigid.map_options.SurfaceOptions`, where not the defaults, and the ``operator``.
    """

    label: str
    pairs: tuple[Pair, ...]
    variant: str = "original"
    options: dict[str, Any] = field(default_factory=dict)
    surface: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """A trial and the record of each of its pairs."""

    trial: Trial
    records: tuple[Record, ...]

    @property
    def direct(self) -> list[FloatArray]:
        """Errors of each map against the truth."""
        return [errors_of(record).direct for record in self.records]

    @property
    def accepting_flips(self) -> list[FloatArray] | None:
        """Errors of each map against the better of truth and mirrored truth, None if there is no mirrored truth."""
        errors = [errors_of(record) for record in self.records]
        return None if any(e.mirrored is None for e in errors) else [e.accepting_flips for e in errors]

    def mean_direct(self, pairs: Sequence[Pair]) -> float | None:
        """Return the mean error on some of its pairs, None if one of them was not measured."""
        means = dict(zip(self.trial.pairs, (errors.mean() for errors in self.direct), strict=True))
        return float(np.mean([means[pair] for pair in pairs])) if set(pairs) <= set(means) else None


def measure_trials(bench: Bench, maps: MapSet, trials: Sequence[Trial]) -> list[Measured]:
    """Measure all pairs of all trials, one cell each; the smallest surfaces only if the bench is quick."""
    measured = []
    for trial in trials:
        surface = {**trial.surface, **QUICK_SURFACE} if bench.quick else trial.surface
        common = {"set": maps.name, "variant": trial.variant, "options": trial.options, "surface": surface}
        cells = {
            f"{maps.name} {target} {source} {trial.label}": {
                **common,
                "target": target,
                "source": source,
                "points": NUM_EVALUATED,
            }
            for target, source in trial.pairs
        }
        measured.append(Measured(trial=trial, records=tuple(bench.measure(measure_map, cells).values())))
    return measured


def some_pairs(pairs: tuple[Pair, ...], num: int, seed: int) -> tuple[Pair, ...]:
    """Return a part of the pairs, drawn by a seed, in their order."""
    chosen = np.sort(np.random.default_rng(seed).permutation(len(pairs))[:num])
    return tuple(pairs[i] for i in chosen)


def usual_trials(maps: MapSet, *, num_copies: int, num_paper: int, quick: bool) -> list[Trial]:
    """Return the default on all pairs, on permuted and remeshed copies of some, and the strategies of the paper.

    Parameters
    ----------
    maps : MapSet
    num_copies : int
        Pairs whose shapes are copied.
    num_paper : int
        Pairs that the strategies of the paper match.
    quick : bool
        One pair each, and only the fast one of the paper's strategies.
    """
    if quick:
        maps = replace(maps, pairs=some_pairs(maps.pairs, 1, SEED))
    copied, chosen = some_pairs(maps.pairs, num_copies, SEED), some_pairs(maps.pairs, num_paper, SEED)
    trials = [Trial(label=DEFAULT, pairs=maps.pairs)]
    if copied:
        trials += [Trial(label=f"{variant} copies", pairs=copied, variant=variant) for variant in COPIES]
    if chosen and not quick:
        trials.append(Trial(label="the paper's chain", pairs=chosen, options={"strategy": "paper"}))
    if chosen:
        trials.append(Trial(label="the paper's fast chain", pairs=chosen, options={"strategy": "fast"}))
    return trials
