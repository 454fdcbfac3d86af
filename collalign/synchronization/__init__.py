"""One consistent pose per shape from many pairs that are partly wrong, with doubts."""

from collalign.synchronization.frames import principal_axes_gauge
from collalign.synchronization.graph import PairGraph
from collalign.synchronization.permutations import synchronize_maps
from collalign.synchronization.robust import SynchronizationResult
from collalign.synchronization.solve import synchronize, synchronize_graph
from collalign.synchronization.spectral import alternate_assignments

__all__ = [
    "PairGraph",
    "SynchronizationResult",
    "alternate_assignments",
    "principal_axes_gauge",
    "synchronize",
    "synchronize_graph",
    "synchronize_maps",
]
