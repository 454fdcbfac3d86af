"""Pairs, samples, shapes, kinds and maps of vertices as small as a test wants them."""

import numpy as np

from collalign.products.consistent_maps import VertexMaps
from collalign.products.kinds import Kind
from collalign.products.pair import AlignedPair, Pair
from collalign.products.shapes import Shapes
from data_tools.embedding.embedding import Samples
from data_tools.options import CleaningOptions


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


def shapes_of(samples, components="largest"):
    """Shapes of samples, all read by the same components and of no files."""
    return Shapes(
        names=tuple("abcdefgh"[: len(samples)]),
        files=(),
        digests=(),
        keys=(),
        samples=tuple(samples),
        cleaning=(CleaningOptions(components=components),) * len(samples),
        chirality=(),
        excluded=(),
    )


def kind_of(called, shapes, *, frame=1.0, group="SO"):
    """A kind that is likely one."""
    return Kind(
        called=called,
        shapes=np.array(shapes),
        confidence=0.9,
        frame=frame,
        group=group,
        cleaning=CleaningOptions(),
    )


def vertex_maps_of(names, places, **fields):
    """Maps of vertices through the first shape that are sure of all places."""
    sure = {
        "reference": names[0],
        "confidence": np.ones(len(names)),
        "vertex_confidence": tuple(np.ones(len(own)) for own in places),
    }
    return VertexMaps(names=tuple(names), places=tuple(places), **sure | fields)
