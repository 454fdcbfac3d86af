"""The mirror symmetry of one shape: the orientation-reversing self-map with the best evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.nonrigid.options import NonrigidOptions
from collalign.nonrigid.portfolio import find_candidates
from collalign.nonrigid.surface import SpectralShape
from data_tools.arrays import FloatArray, read_only

#: A self-map is taken for a mirror symmetry if its orientation is below this and so many samples come back.
MAX_ORIENTATION, MIN_BIJECTIVITY = -0.5, 0.9


def mirror_symmetry(shape: SpectralShape) -> FloatArray:
    """Return the functional map of the shape's mirror symmetry, shape (m, m); of shape (0, 0) if it has none.

    Intrinsically symmetric shapes have two equally good maps to each other, of which normals tell the true one; with
    this self-map either is obtained from the other. Found by the same search as between two shapes, of which it keeps
    the best map that reverses the orientation.
    """
    none = read_only(np.empty((0, 0)))
    if not np.isfinite(shape.orientation).all():
        return none
    own = replace(shape, mirror=none)
    candidates, _ = find_candidates(own, own, NonrigidOptions(num_candidates=12))
    for candidate in candidates:
        evidence = candidate.evidence
        if evidence.orientation <= MAX_ORIENTATION and evidence.bijectivity >= MIN_BIJECTIVITY:
            return read_only(candidate.functional_map.C_source_target)
    return none
