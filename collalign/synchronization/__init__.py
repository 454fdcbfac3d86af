"""One consistent pose per shape, or label per point, from many pairs that are partly wrong, with doubts.

>>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
>>> pairs, measured = [(0, 1), (1, 2), (0, 2)], [quarter, quarter, quarter @ quarter]
>>> collalign.synchronize(pairs, measured).edge_inlier
array([ True,  True,  True])

The graph and its solvers know arrays alone: ``graph`` checks what a caller gives, ``solve`` chooses the method.
"""

# The stages use what is not in ``__all__``, which is what a user finds here.
from collalign.synchronization.clusters import find_parts as find_parts
from collalign.synchronization.frames import principal_axes_gauge as principal_axes_gauge
from collalign.synchronization.graph import PairGraph
from collalign.synchronization.permutations import synchronize_maps as synchronize_maps
from collalign.synchronization.permutations import synchronize_permutations
from collalign.synchronization.robust import SynchronizationResult
from collalign.synchronization.solve import synchronize, synchronize_graph
from collalign.synchronization.spectral import alternate_assignments as alternate_assignments

__all__ = [
    "PairGraph",
    "SynchronizationResult",
    "synchronize",
    "synchronize_graph",
    "synchronize_permutations",
]
