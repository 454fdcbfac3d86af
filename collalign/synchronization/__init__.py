"""One consistent pose per shape from many pairs that are partly wrong, with certificates and doubts."""

from collalign.synchronization.clusters import ClusteredSynchronization, synchronize_clusters
from collalign.synchronization.doubt.certificate import SynchronizationCertificate
from collalign.synchronization.gauge import principal_axes_gauge
from collalign.synchronization.maps.permutations import UniverseLabels, synchronize_maps
from collalign.synchronization.maps.superimpose import Superimposition, superimpose
from collalign.synchronization.resolve import RefinedSynchronization, refine_with_pairs
from collalign.synchronization.result import PoseAlternative, SynchronizationResult, WeakCut
from collalign.synchronization.solve import synchronize
from collalign.synchronization.solvers.signs import ChiralityResult, synchronize_signs
from collalign.synchronization.solvers.spectral import alternate_assignments

__all__ = [
    "ChiralityResult",
    "ClusteredSynchronization",
    "PoseAlternative",
    "RefinedSynchronization",
    "Superimposition",
    "SynchronizationCertificate",
    "SynchronizationResult",
    "UniverseLabels",
    "WeakCut",
    "alternate_assignments",
    "principal_axes_gauge",
    "refine_with_pairs",
    "superimpose",
    "synchronize",
    "synchronize_clusters",
    "synchronize_maps",
    "synchronize_signs",
]
