"""When non-rigid maps are worth their cost, decided from how well the pairs match rigidly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.options import AlignOptions
from collalign.products.pair import Pair
from data_tools.errors import OptionsError

#: Maps are asked where the median of the pairs' lowest energies is above this share of the points' squared size: the
#: shapes differ so much that one-to-one matches of positions do not settle poses. At default options teeth have .09,
#: fish and chairs of SHREC07 .14 and .15, its ants, teddy bears and glasses .19 to .20, SCAPE .23, its humans and
#: armadillos .25 and .33.
BENT_ENERGY = 0.16


def wants_maps(options: AlignOptions, pairs: Sequence[Pair]) -> bool:
    """Whether the poses of maps join the pairs' candidates.

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
    return float(np.median([pair.energies.min() for pair in pairs])) > BENT_ENERGY
