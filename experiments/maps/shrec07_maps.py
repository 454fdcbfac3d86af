"""Maps between different shapes of a class, SHREC07's ants, teddies and glasses, and between bodies of two kinds."""

from __future__ import annotations

from experiments.experiment import Bench, Experiment, Outcome
from experiments.maps.map_results import PROTOCOL, outcome_of
from experiments.maps.map_sets import BODIES, SAME_PLACES, SHREC07_CLASSES, read_map_set
from experiments.maps.map_trials import SEED, measure_trials, usual_trials

#: Pairs of each class matched by the paper's own strategies.
NUM_PAPER = 2

_ABOUT = f"""
Non-rigid maps between different shapes of a class (section 6.1 of Maron et al. 2016, who show good maps of ants,
teddies and glasses), on all pairs on which blended intrinsic maps were published. {PROTOCOL}

Bodies of two kinds are evaluated at {len(SAME_PLACES["human"])} landmarks that humans and armadillos share, chosen
by hand.

The paper's own chain runs on {NUM_PAPER} pairs of each set.
"""


def measure(bench: Bench) -> Outcome:
    """Run all trials of all classes."""
    bench.seeds.add(SEED)
    results = []
    for name in (*SHREC07_CLASSES, BODIES):
        maps = read_map_set(bench.data, name)
        trials = usual_trials(maps, num_copies=0, num_paper=NUM_PAPER, quick=bench.quick)
        results.append((maps, measure_trials(bench, maps, trials)))
    return outcome_of(results)


EXPERIMENT = Experiment(
    name="shrec07_maps",
    title="SHREC07: maps within classes",
    about=_ABOUT,
    seen=("shrec07",),
    measure=measure,
    collections=("shrec07_dev",),
)
