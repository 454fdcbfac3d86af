"""Maps between the bodies of SCAPE, the paper's first experiment (section 6.1)."""

from __future__ import annotations

from experiments.experiment import Bench, Experiment, Outcome
from experiments.maps.map_results import PROTOCOL, outcome_of
from experiments.maps.map_sets import FOLDERS, read_map_set
from experiments.maps.map_trials import SEED, measure_trials, usual_trials

#: Pairs matched as copies too, and by the paper's own strategies.
NUM_COPIES, NUM_PAPER = 5, 3

_ABOUT = f"""
Non-rigid maps between the bodies of SCAPE (section 6.1 of Maron et al. 2016), on the benchmark's pairs whose meshes
are known. {PROTOCOL}

The default and the paper's own chain (PM-SDP in 17 eigenfunctions with a 5-diagonal R and 30 % candidates by average
geodesic distance, local minimisation in 30, functional-map ICP), for which the paper states 30 to 35 minutes a pair,
and 2.5 minutes for the fast one (a diagonal R in 30 functions). SCAPE's meshes share the order of their vertices, so
{NUM_COPIES} pairs are also matched as copies with vertices in random order, and as copies that were remeshed to 60 %
of the triangles. The published methods are those of Kim et al.: means of each pair, from the benchmark's files.
"""


def measure(bench: Bench) -> Outcome:
    """Run all trials."""
    bench.seeds.add(SEED)
    maps = read_map_set(bench.data, "scape")
    trials = usual_trials(maps, num_copies=NUM_COPIES, num_paper=NUM_PAPER, quick=bench.quick)
    return outcome_of([(maps, measure_trials(bench, maps, trials))])


EXPERIMENT = Experiment(
    name="scape",
    title="SCAPE: maps of bodies",
    about=_ABOUT,
    seen=("scape",),
    measure=measure,
    collections=(FOLDERS["scape"],),
)
