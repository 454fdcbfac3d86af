"""Rivals that dense points prefer on most near shapes: few samples can mislead all pairs of a shape alike."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any

import networkx as nx
import numpy as np

from collalign.confidence.pose_model import ALIKE
from collalign.engine.jobs.job import Shared, table_of_values
from collalign.options import AlignSession
from collalign.products.pair import Pair, are_weighed
from collalign.products.trust import Trust
from collalign.stages.poses.refinement import NUM_NEIGHBOURS, points_from_record, refine_pair
from collalign.stages.trust.assess import RESOLUTION
from collalign.stages.trust.rival_poses import MAX_PARTNERS
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.rotations import nearest_orthogonal

#: A rival is better where the mean of its excesses is below minus this many of their standard deviations: -1.9 and
#: -.9 for the two of fifty generated long bones that stood half turned, 1.1 and more for those tried that were right,
#: .3 for the one that was tried among 140 planes, birds, glasses, fish and teeth.
SPREADS = 0.8


def preferred_poses(
    session: AlignSession,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    trust: Trust,
    rotations: FloatArray,
    kept: Container[int | None],
) -> FloatArray:
    """Return ``R_common_shape``, shape (N, 3, 3), with a rival where dense points speak against the reported pose.

    Rivals that cost about as much on the shapes that match best, which few samples chose, are refined on the nearest
    ones along all pairs. Where maps were asked for, surfaces that bend would mislead, and every pose stays.

    Parameters
    ----------
    session : Session
    samples : sequence of Samples
    pairs : sequence of Pair
        As matched.
    trust : Trust
        Of the reported poses.
    rotations : ndarray, shape (N, 3, 3)
        The reported ones.
    kept : container of int
        Shapes whose poses were given.
    """
    if are_weighed(pairs) or not all(len(item.dense_indices) > 1 for item in samples):
        return rotations
    graph = nx.Graph()
    graph.add_weighted_edges_from((pair.target, pair.source, pair.energies.min()) for pair in pairs)
    points = [Shared(key=str(i), reader=points_from_record) for i in range(len(samples))]
    tried: dict[int, tuple[FloatArray, list[int]]] = {}
    tasks: dict[tuple[int, int, int], dict[str, Any]] = {}
    for i in sorted(graph):
        rivals = trust.rivals[i][trust.excess[i] < ALIKE]
        rivals = rivals[np.linalg.det(rivals @ rotations[i].T) > 0]
        near = list(nx.single_source_dijkstra_path_length(graph, i))[1 : NUM_NEIGHBOURS**2] if len(rivals) else []
        if i not in kept and len(near) >= MAX_PARTNERS:
            tried[i] = np.concatenate([rotations[i][None], rivals]), near
            tasks |= {
                (i, r, j): {"target": points[j], "source": points[i], "start": rotations[j].T @ pose}
                for r, pose in enumerate(tried[i][0])
                for j in near
            }
    with table_of_values(samples) as table:
        refined = session.map_parallel("poses tried", refine_pair, tasks, shared=table)
    poses = rotations.copy()
    for i, (own, near) in tried.items():
        energies = np.array([[refined[i, r, j][1] for j in near] for r in range(len(own))]) + RESOLUTION
        excess = np.log(energies[1:] / energies[0])
        spreads = excess.mean(axis=1) / np.maximum(excess.std(axis=1), RESOLUTION)
        best = int(np.argmin(spreads))
        if spreads[best] < -SPREADS:
            poses[i] = nearest_orthogonal(np.sum([rotations[j] @ refined[i, 1 + best, j][0] for j in near], axis=0))
    return poses
