"""One consistent pose per shape from many pairs that are partly wrong, with doubts."""

from collalign.synchronization.clusters import ClusteredSynchronization, synchronize_clusters
from collalign.synchronization.gauge import principal_axes_gauge
from collalign.synchronization.permutations import synchronize_maps
from collalign.synchronization.problem.graph import PairGraph
from collalign.synchronization.result import SynchronizationResult, WeakCut
from collalign.synchronization.solve import synchronize, synchronize_graph
from collalign.synchronization.solvers.spectral import alternate_assignments

__all__ = [
    "ClusteredSynchronization",
    "PairGraph",
    "SynchronizationResult",
    "WeakCut",
    "alternate_assignments",
    "principal_axes_gauge",
    "synchronize",
    "synchronize_clusters",
    "synchronize_graph",
    "synchronize_maps",
]
