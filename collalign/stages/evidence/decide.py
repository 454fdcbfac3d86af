"""When non-rigid maps are worth their cost, decided from how well the pairs match rigidly."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np

from collalign.options import AlignOptions
from collalign.products.pair import Pair, median_mismatch
from data_tools.errors import OptionsError
from data_tools.poses import APART_DEG
from data_tools.rotations import rotation_angle_deg

#: Maps are asked where the median of the pairs' lowest energies is above this share of the points' squared size: the
#: shapes differ so much that one-to-one matches of positions do not settle poses. At default options teeth have .09,
#: fish and chairs of SHREC07 .14 and .15, its ants, teddy bears and glasses .19 to .20, SCAPE .23, its humans and
#: armadillos .25 and .33.
BENT_ENERGY = 0.16
#: And only where the pairs contradict each other: rigid evidence is settled where this share of the cycles of three
#: pairs closes. Of 12 mouse skulls and 12 glasses of SHREC07, whose energies are above, .95 and all close; of teddy
#: bears, ants, SCAPE and humans .46 to .74.
CLOSING_CYCLES = 0.9
#: And not where neighbourhoods agree at rigid poses: shapes that carry a stand differ like shapes that bend, but only
#: there. The median over pairs of the least mismatch is .46 of teddy bears and .66 to .74 of ants, glasses, humans,
#: armadillos and SCAPE; guns have .15, skulls .16, guitars .22, generated bones half of which are on a stand .27.
BENT_MISMATCH = 0.35
#: Cycles that are looked at.
MAX_CYCLES = 2000


def wants_maps(options: AlignOptions, pairs: Sequence[Pair]) -> bool:
    """Return whether the poses of maps join the pairs' candidates.

    Parameters
    ----------
    options : AlignOptions
    pairs : sequence of Pair
        With their first, rigid candidates.

    Raises
    ------
    OptionsError
        If maps are asked for beside an embedding or a synchronization that cannot use them.
    """
    able = options.synchronization == "robust" and not options.embedding.has_eigenfunctions
    if options.maps == "always" and not able:
        raise OptionsError("maps: needs the robust synchronization and an embedding without eigenfunctions")
    if options.maps != "auto" or not able:
        return options.maps == "always"
    is_weak = float(np.median([pair.energies.min() for pair in pairs])) > BENT_ENERGY
    may_bend = not median_mismatch(pairs) < BENT_MISMATCH
    return is_weak and may_bend and closing_share(pairs) < CLOSING_CYCLES


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
