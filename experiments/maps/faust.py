"""Maps between the bodies of FAUST and between their raw scans, for those who have the data."""

from __future__ import annotations

from itertools import combinations

from experiments.experiment import Bench, Experiment, Outcome
from experiments.maps.map_results import PROTOCOL, outcome_of
from experiments.maps.map_sets import FOLDERS, MapSet, Pair, read_map_set
from experiments.maps.map_trials import SEED, Trial, measure_trials, some_pairs

#: Pairs of one body in two poses, and of two bodies; of these so many again by the paper's own strategy.
NUM_SAME, NUM_OTHER, NUM_PAPER = 20, 20, 2

_ABOUT = f"""
Non-rigid maps on the training set of FAUST (section 6.1 of Maron et al. 2016; Bogo et al. 2014), whose licence does
not allow to hand it on: put its folder `training` into the folder `{FOLDERS["faust"]}` beside the other collections.
{NUM_SAME} pairs of one body in two poses and {NUM_OTHER} of two bodies are drawn, of the registrations and of the raw
scans themselves; the truth of a scan is its registration, where that is within 1 % of sqrt(area). {PROTOCOL}

The paper's own chain takes the Laplace-Beltrami operator from geodesics between samples, and 40 % candidates.
"""


def drawn_pairs(maps: MapSet, *, same: bool, num: int) -> tuple[Pair, ...]:
    """Return pairs of one body, or of two bodies, drawn by the seed."""
    subjects = dict(zip(maps.data.names, maps.data.labels["subject"], strict=True))
    pairs = tuple(p for p in combinations(maps.data.names, 2) if (subjects[p[0]] == subjects[p[1]]) == same)
    return some_pairs(pairs, num, SEED)


def trials_of(maps: MapSet, *, quick: bool) -> list[Trial]:
    """Return the trials that the files allow, the registrations of two bodies first."""
    same = drawn_pairs(maps, same=True, num=1 if quick else NUM_SAME)
    other = drawn_pairs(maps, same=False, num=1 if quick else NUM_OTHER)
    kinds = {"original": "registrations"}
    if (maps.folder / "training" / "scans").is_dir():
        kinds["scan"] = "scans"
    trials = [
        Trial(label=f"{kind}, {bodies}", pairs=pairs, variant=variant)
        for variant, kind in kinds.items()
        for bodies, pairs in (("two bodies", other), ("one body", same))
        if pairs
    ]
    chain = {"strategy": "fast" if quick else "paper", "mask_share": 0.4}
    trials += [
        Trial(
            label=f"{kind}, the paper's chain",
            pairs=other[:NUM_PAPER],
            variant=variant,
            options=chain,
            surface={"operator": "graph"},
        )
        for variant, kind in kinds.items()
        if other
    ]
    return trials


def measure(bench: Bench) -> Outcome:
    """Run all trials."""
    bench.seeds.add(SEED)
    maps = read_map_set(bench.data, "faust")
    return outcome_of([(maps, measure_trials(bench, maps, trials_of(maps, quick=bench.quick)))])


EXPERIMENT = Experiment(
    name="faust",
    title="FAUST: maps of bodies and of raw scans",
    about=_ABOUT,
    measure=measure,
    collections=(FOLDERS["faust"],),
)
