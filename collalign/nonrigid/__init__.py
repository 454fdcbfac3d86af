"""Non-rigid matching: from two meshes to a map of all their vertices (Maron et al. 2016, section 6.1, and beyond)."""

from collalign.nonrigid.match import match_prepared, match_shapes
from collalign.nonrigid.options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.prepare import prepare_file, prepare_shape
from collalign.nonrigid.result import NonrigidCandidate, NonrigidMatch
from collalign.nonrigid.surface.spectral import SpectralShape

__all__ = [
    "NonrigidCandidate",
    "NonrigidMatch",
    "NonrigidOptions",
    "SpectralShape",
    "SurfaceOptions",
    "match_prepared",
    "match_shapes",
    "prepare_file",
    "prepare_shape",
]
