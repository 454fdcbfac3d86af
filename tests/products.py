"""Pairs and samples as small as a test wants them."""

import numpy as np

from collalign.products.pair import AlignedPair, Pair
from data_tools.embedding.embedding import Samples


def pair_of(rotations, energies, *, target=0, source=1, num_samples=8, **fields):
    """A pair of these candidates, which match every sample to its like."""
    num = len(energies)
    return Pair(
        target=target,
        source=source,
        rotations=np.array(rotations, dtype=float).reshape(num, 3, 3),
        maps=np.tile(np.arange(num_samples), (num, 1)),
        energies=np.array(energies, dtype=float),
        **fields,
    )


def settled_pair_of(rotations, energies, **fields):
    """Such a pair of a result, which chose its first candidate."""
    own = pair_of(
        rotations,
        energies,
        **{name: fields.pop(name) for name in ("target", "source") if name in fields},
    )
    settled = {
        "choice": 0,
        "inlier": True,
        "disagreement_deg": 0.0,
        "map_target_source": own.maps[0] if len(own.maps) else np.full(8, -1),
        "energy": energies[0] if len(energies) else np.nan,
    }
    return AlignedPair(**vars(own) | settled | fields)


def samples_at(points, *, invariants=None, **fields):
    """Samples at these points, without dense ones."""
    plain = {
        "name": "",
        "vertex_indices": np.arange(len(points)),
        "positions": points,
        "coordinates": points,
        "block_sizes": (3,),
        "invariants": np.empty((len(points), 0)) if invariants is None else invariants,
        "offset": np.zeros(3),
        "scale": 1.0,
        "dense_indices": np.empty(0, dtype=np.int64),
        "dense_positions": np.empty((0, 3)),
        "dense_normals": np.empty((0, 3)),
        "signature": np.zeros(18),
        "rim": "closed",
    }
    return Samples(**plain | fields)
