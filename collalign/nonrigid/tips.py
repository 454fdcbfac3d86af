"""Ends of limbs, and maps that start from which end of one surface belongs to which of another.

**Ends.**
A tip is a local maximum of the average geodesic distance that rises above the saddle at which it meets a higher one
(persistence): heads, hands, feet, tails. It is found on the inside of a surface, in any posture.

**Matches.**
Front and back of a body look alike to the inside, and so do left and right; which hand is which says both at once.
Every way to match the tips is rated by the geodesic distances between them, and the best ones start a map each: the
right one, those that exchange left and right of the arms, of the legs, or of both, and those that are upside down.
Limbs may differ in length: what rates is where they branch off.

**Sides.**
Closeness to the tips tells where along a limb a point is, and n . (grad w_a x grad w_b) of the closeness to two tips
tells on which side of it. So points that agree in both belong to a map that keeps the orientation of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.surface.shape import Shape
from data_tools.surface.topology import mesh_edges

#: Least persistence of a tip, in units of sqrt(area), and how many are kept at most. Chosen on SHREC07's humans and
#: armadillos, whose limbs have .08 to .6; fingers and ears have less or little more.
LEAST_PERSISTENCE, MAX_TIPS = 0.06, 7
#: Ways to match the tips that start a map: on 20 pairs of humans and armadillos and 15 of bipeds the right one
#: is among the first 26.
NUM_MATCHES = 32
#: Cost of the square of a change of a limb's length relative to that of a distance. On these pairs .5 to 3 are alike.
LIMB_COST = 1.0
#: Closeness to a tip is one over the square of this plus the distance, in units of sqrt(area).
SOFTENING = 0.05


@dataclass(frozen=True, eq=False)
class Tips:
    """The tips of a surface.

    Attributes
    ----------
    vertices : ndarray of int, shape (t,)
        Working vertices, the most persistent first.
    distances : ndarray, shape (t, w)
        From each along the edges of the surface, over sqrt(area).
    """

    vertices: IntArray
    distances: FloatArray

    @classmethod
    def none(cls) -> Tips:
        """Return those of a point cloud, which has no edges."""
        return cls(read_only(np.empty(0, dtype=np.int64)), read_only(np.empty((0, 0))))

    @property
    def between(self) -> FloatArray:
        """Distances between the tips, shape (t, t)."""
        return self.distances[:, self.vertices]

    @property
    def closeness(self) -> FloatArray:
        """How close each working vertex is to each tip, shape (w, t): large near it, and smooth."""
        return np.asarray((SOFTENING + self.distances.T) ** -2.0)


def find_tips(shape: Shape, agd: FloatArray, area: float) -> Tips:
    """Return the tips of a mesh by its average geodesic distances over sqrt(area), shape (w,)."""
    net = edge_net(shape.vertices / area**0.5, shape.faces)
    persistence = _persistence(net, agd)
    order = np.argsort(-persistence, kind="stable")[:MAX_TIPS]
    tips = order[persistence[order] >= LEAST_PERSISTENCE]
    return Tips(
        read_only(tips), read_only(scipy.sparse.csgraph.dijkstra(net, directed=False, indices=tips))
    )


def edge_net(places: FloatArray, faces: IntArray) -> scipy.sparse.csr_array:
    """Return the lengths of a mesh's edges, either way, as a sparse matrix (w, w)."""
    edges = mesh_edges(faces)
    lengths = np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1)
    both = np.concatenate([edges, edges[:, ::-1]])
    return scipy.sparse.csr_array((np.tile(lengths, 2), both.T), shape=(len(places),) * 2)


def _persistence(net: scipy.sparse.csr_array, heights: FloatArray) -> FloatArray:
    """Return by how much each vertex rises above where its peak meets a higher one, shape (w,); 0 for no peak."""
    parent = np.full(len(heights), -1)
    found = np.zeros(len(heights))

    def peak(vertex: int) -> int:
        while parent[vertex] != vertex:
            parent[vertex] = parent[parent[vertex]]
            vertex = int(parent[vertex])
        return vertex

    order = np.argsort(-heights, kind="stable")
    for vertex in order.tolist():
        around = net.indices[net.indptr[vertex] : net.indptr[vertex + 1]].tolist()
        peaks = {peak(other) for other in around if parent[other] >= 0}
        ordered = sorted(peaks, key=lambda one: (-heights[one], one))
        parent[vertex] = ordered[0] if ordered else vertex
        for lower in ordered[1:]:
            parent[lower] = ordered[0]
            found[lower] = heights[lower] - heights[vertex]
    found[order[0]] = heights[order[0]] - heights[order[-1]]
    return found


def tip_matches(target: Tips, source: Tips) -> list[tuple[IntArray, IntArray]]:
    """Return ways to match all tips of the surface that has fewer, the best first: positions on target and source.

    Kinds differ most in the lengths of their limbs: a tip may be farther from all others than its match is. The cost
    is what such changes of length leave of the differences between distances (squares), and a little for the changes.
    Fewer than two tips match nowhere.
    """
    is_fewer = len(target.vertices) < len(source.vertices)
    fewer, more = (target, source) if is_fewer else (source, target)
    num = len(fewer.vertices)
    if num < 2:
        return []
    ways = np.array(list(permutations(range(len(more.vertices)), num)))
    a, b = np.triu_indices(num, 1)
    differences = more.between[ways[:, a], ways[:, b]] - fewer.between[a, b]
    ends = np.eye(num)[a] + np.eye(num)[b]
    longer = np.linalg.solve(ends.T @ ends + LIMB_COST * np.eye(num), ends.T @ differences.T).T
    left = ((differences - longer @ ends.T) ** 2).sum(axis=1) + LIMB_COST * (longer**2).sum(axis=1)
    best = np.argsort(left, kind="stable")[:NUM_MATCHES]
    every = np.arange(num)
    return [(every, ways[i]) if is_fewer else (ways[i], every) for i in best]
