"""When non-rigid maps are worth their cost, decided from how well the pairs match rigidly."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np

from collalign.confidence.candidate_model import candidate_costs
from collalign.options import AlignOptions
from collalign.products.pair import Pair
from collalign.stages.local_evidence import rigid_overlap
from data_tools.embedding.embedding import Samples
from data_tools.errors import OptionsError
from data_tools.poses import APART_DEG
from data_tools.rotations import rotation_angle_deg
from data_tools.surface.cleaning import are_assembled

#: Maps are asked where the median of the pairs' lowest energies is above this share of the points' squared size: the
#: shapes differ so much that one-to-one matches of positions do not settle poses. At default options teeth have .09,
#: fish and chairs of SHREC07 .14 and .15, its ants, teddy bears and glasses .19 to .20, SCAPE .23, its humans and
#: armadillos .25 and .33.
BENT_ENERGY = 0.16
#: And only where the pairs contradict each other: rigid evidence is settled where this share of the cycles of three
#: pairs closes. Of 12 mouse skulls and 12 glasses of SHREC07, whose energies are above, .95 and all close; of teddy
#: bears, ants, SCAPE and humans .46 to .74.
CLOSING_CYCLES = 0.9
#: And not where surfaces overlap at rigid poses: shapes that carry a stand differ like shapes that bend, but there
#: alone. After refinement the median pair of teddy bears overlaps by .71, of humans by .65, of armadillos, ants,
#: glasses and SCAPE by .52 to .55, of generated lizards by .85; of skulls, guitars and guns by .92 to .96.
#: So many pairs are refined for that.
RIGID_OVERLAP, MOST_REFINED = 0.88, 24
#: Cycles that are looked at.
MAX_CYCLES = 2000


def wants_maps(options: AlignOptions, samples: Sequence[Samples], pairs: Sequence[Pair]) -> bool:
    """Return whether the poses of maps join the pairs' candidates.

    Parameters
    ----------
    options : AlignOptions
    samples : sequence of Samples
    pairs : sequence of Pair
        With their first, rigid candidates.

    Raises
    ------
    OptionsError
        If maps are asked for beside an embedding or a synchronization that cannot use them.
    """
    able = options.synchronization == "robust" and not options.embedding.has_eigenfunctions
    if options.maps == "always" and not able:
        raise OptionsError(
            "maps: needs the robust synchronization and an embedding without eigenfunctions"
        )
    if options.maps != "auto" or not able:
        return options.maps == "always"
    if are_assembled(options.cleaning, [item.notes for item in samples]):
        return False  # a map is of one component
    is_weak = float(np.median([pair.energies.min() for pair in pairs])) > BENT_ENERGY
    return (
        is_weak and closing_share(pairs) < CLOSING_CYCLES and not _overlap_rigidly(samples, pairs)
    )


def _overlap_rigidly(samples: Sequence[Samples], pairs: Sequence[Pair]) -> bool:
    """Return whether the surfaces of the median pair overlap at its likeliest pose, refined."""
    by_energy = sorted(pairs, key=lambda pair: float(pair.energies.min()))
    overlaps = []
    for pair in by_energy[:: -(-len(by_energy) // MOST_REFINED)]:
        likeliest = int(np.argmin(candidate_costs(pair.energies, pair.mismatches)))
        overlaps.append(
            rigid_overlap(samples[pair.target], samples[pair.source], pair.rotations[[likeliest]])
        )
    return float(np.median(overlaps)) >= RIGID_OVERLAP


def closing_share(pairs: Sequence[Pair]) -> float:
    """Return the share of cycles of three pairs whose likeliest poses compose to nearly nothing; 0 without cycles."""
    best = {}
    for pair in pairs:
        rotation = pair.rotations[int(np.argmin(pair.energies)), :3, :3]
        best[pair.target, pair.source], best[pair.source, pair.target] = rotation, rotation.T
    graph = nx.Graph([(pair.target, pair.source) for pair in pairs])
    cycles = [
        (a, b, c)
        for a, b in sorted(tuple(sorted(edge)) for edge in graph.edges)
        for c in sorted(set(graph[a]) & set(graph[b]))
        if c > b
    ]
    chosen = cycles[:: -(-len(cycles) // MAX_CYCLES)] if cycles else []
    turns = [best[a, b] @ best[b, c] @ best[c, a] for a, b, c in chosen]
    return float(np.mean(rotation_angle_deg(np.stack(turns)) <= APART_DEG)) if turns else 0.0
