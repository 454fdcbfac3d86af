"""Maps between surfaces: of two shapes that bend, and one triangulation on all shapes of a result."""

from collalign.confidence.map_model import Evidence
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.products.consistent_maps import ConsistentMaps, VertexMaps
from collalign.tools.correspond import DenseCorrespondence, dense_correspondence
from collalign.tools.match.nonrigid import NonrigidCandidate, NonrigidMatch, match_shapes

__all__ = [
    "ConsistentMaps",
    "DenseCorrespondence",
    "Evidence",
    "NonrigidCandidate",
    "NonrigidMatch",
    "NonrigidOptions",
    "SurfaceOptions",
    "VertexMaps",
    "dense_correspondence",
    "match_shapes",
]
