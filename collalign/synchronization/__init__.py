"""One consistent pose per shape, or label per point, from many pairs that are partly wrong, with doubts.

>>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
>>> pairs, measured = [(0, 1), (1, 2), (0, 2)], [quarter, quarter, quarter @ quarter]
>>> collalign.synchronize(pairs, measured).edge_inlier
array([ True,  True,  True])

* ``graph``: ``PairGraph``: pairs, checked, and the shapes that they connect
* ``solve``: the entry: chooses the method
* ``robust``: the robust method, its result and confidences
* ``search``: poses of a component
* ``hypotheses``: rotations that pairs propose, belief propagation
* ``model``: the likelihood of pairs
* ``averaging``: least squares, robust against outliers
* ``spectral``: appendix B of the paper, signs
* ``clusters``: parts
* ``permutations``: labels
* ``frames``: the gauge

A new method is a module from a ``PairGraph`` with one rotation per pair to frames, its branch in
``synchronize_graph`` and its name in ``METHODS`` of ``solve``, and in ``Synchronizer`` of ``collalign/options.py``.

Words:

* **part**: shapes whose poses can be compared; ``--clusters`` asks for a number of them. ``groups`` in
  ``alignment.json`` lists them.
* **component**: shapes that pairs connect.
* **block**: shapes that a wrong rotation keeps together.
* **side**: left or right, of specimens. The chirality of a pair is *reflected*.
* **gauge**: what the common frame is; **reference**: the shape that sets it where nothing is fixed.
* **hypotheses**: candidate rotations of one shape from its present pose; belief propagation chooses among them.
"""

# The stages use what is not in ``__all__``, which is what a user finds here.
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
