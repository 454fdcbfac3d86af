"""One consistent pose per shape from many pairs that are partly wrong, with doubts."""

from collalign.synchronization.clusters import ClusteredSynchronization, synchronize_clusters
from collalign.synchronization.gauge import principal_axes_gauge
from collalign.synchronization.maps.permutations import UniverseLabels, synchronize_maps
from collalign.synchronization.maps.superimpose import superimpose
from collalign.synchronization.problem.graph import PairGraph
from collalign.synchronization.result import SynchronizationResult, WeakCut
from collalign.synchronization.solve import synchronize, synchronize_graph
from collalign.synchronization.solvers.spectral import alternate_assignments

__all__ = [
    "ClusteredSynchronization",
    "PairGraph",
    "SynchronizationResult",
    "UniverseLabels",
    "WeakCut",
    "alternate_assignments",
    "principal_axes_gauge",
    "superimpose",
    "synchronize",
    "synchronize_clusters",
    "synchronize_graph",
    "synchronize_maps",
]
