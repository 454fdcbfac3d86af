"""Maps between the poses of TOSCA's centaur."""

from __future__ import annotations

from experiments.experiment import Bench, Experiment, Outcome
from experiments.maps.map_results import PROTOCOL, outcome_of
from experiments.maps.map_sets import FOLDERS, read_map_set
from experiments.maps.map_trials import SEED, measure_trials, usual_trials

#: Pairs matched as copies too, and by the paper's own strategies.
NUM_COPIES, NUM_PAPER = 2, 1

_ABOUT = f"""
All pairs of the six poses of TOSCA's centaur, a body on some pairs of which
the last steps of maps were tried. {PROTOCOL}
"""


def measure(bench: Bench) -> Outcome:
    """Run all trials."""
    bench.seeds.add(SEED)
    maps = read_map_set(bench.data, "tosca")
    trials = usual_trials(maps, num_copies=NUM_COPIES, num_paper=NUM_PAPER, quick=bench.quick)
    return outcome_of([(maps, measure_trials(bench, maps, trials))])


EXPERIMENT = Experiment(
    name="tosca", title="TOSCA: maps of a centaur", about=_ABOUT, measure=measure, collections=(FOLDERS["tosca"],)
)
