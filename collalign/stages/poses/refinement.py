"""Refines synchronized poses on dense samples: near pairs by closest points, then synchronization again.

Matches of few samples are accurate to their spacing, and distant shapes pull each other off the true pose. So the
discrete question (which pose) is settled on all pairs first, and then the pairs of similar shapes alone are refined
on hundreds of points each and synchronized again. Pairs that share a part of one surface are refined on it and weigh
more: the variance of a pose follows that of the points that it is fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import networkx as nx
import numpy as np

from collalign.engine.job import Shared, table_of_values
from collalign.engine.records import Record, from_record
from collalign.options import AlignSession
from collalign.products.pair import Pair, are_weighed
from collalign.products.shapes import Constraints
from collalign.stages.poses.agreement import match_at
from collalign.stages.poses.bent import bent_poses
from collalign.synchronization import PairGraph, SynchronizationResult, synchronize_graph
from collalign.whole_pairs.problem import dense_points
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.surface.topology import vertex_components
from pairwise.dense import DensePoints
from pairwise.rotation_pattern import RotationPattern
from pairwise.surface_fit import fit_surfaces

#: Pairs that each shape is refined with, in addition to a spanning tree.
NUM_NEIGHBOURS = 8
#: Most that a pair weighs compared with another one of its energy. Chosen on the collections that
#: :class:`pairwise.surface_fit.FitTuning` names, and CAPOD's guns: 30 to 300 hardly differ.
MOST_WEIGHT = 100.0


def refine_pair(
    target: DensePoints, source: DensePoints, start: FloatArray
) -> tuple[FloatArray, float, float]:
    """Refine the pose of one pair on the dense samples; runs inside a worker.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
        ``R_target_source``.
    energy : float
        In squares of the target's radius.
    weight : float
        At least 1: how many times the energy is that of the part which both surfaces share.
    """
    found = fit_surfaces(target, source, start)
    least = max(found.energy / MOST_WEIGHT, np.finfo(float).tiny)
    weight = max(found.energy / max(found.shared_energy, least), 1.0)
    return found.pose.rotation, found.energy / target.radius**2, weight


def points_from_record(record: Record, name: str) -> DensePoints:
    """Return the dense points of a shape's record."""
    return dense_points(from_record(Samples, record, name))


def refine_poses(
    session: AlignSession,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    solution: SynchronizationResult,
    constraints: Constraints,
) -> FloatArray:
    """Return ``R_common_shape``, (N, 3, 3), refined by the pairs within components, each held where it is.

    Parameters
    ----------
    session : Session
        Its group is decided; without ``options.refine``, with the paper's own synchronization, or where a shape has
        no dense samples, nothing is refined. Where maps chose the poses, closest points would pull off bent limbs
        (SHREC07's humans from 2 to 14 % of pairs beyond 30 deg): there maps and the samples' energies are averaged.
    samples : sequence of Samples
    pairs : sequence of Pair
    solution : SynchronizationResult
        Of these pairs.
    constraints : Constraints
    """
    rotations, options = solution.rotations, session.options
    if not options.refine or options.synchronization != "robust":
        return rotations
    part = np.empty(len(samples), dtype=np.int64)
    kept = dict(constraints.fixed)
    for number, members in enumerate(solution.components):
        part[members] = number
        if not set(members.tolist()) & constraints.fixed.keys():
            first = constraints.reference if constraints.reference in members else int(members[0])
            kept[first] = rotations[first]
    if are_weighed(pairs):
        return bent_poses(session, samples, pairs, solution, fixed=kept)
    if not all(len(item.dense_indices) > 1 for item in samples):
        return rotations
    within = [pair for pair in pairs if part[pair.target] == part[pair.source]]
    edges = np.array([(pair.target, pair.source) for pair in within])
    energies = np.array([match_at(samples, pair, rotations)[1] for pair in within])
    poor = np.array([item.is_poor for item in samples])
    if (
        poor.any() and not poor.all()
    ):  # shapes of few points are refined on the others, and move none of these
        among_rich = ~poor[edges].any(axis=1)
        held = {int(i): rotations[i] for i in np.flatnonzero(poor)}
        held |= {i: rotations[i] for i in _loose(edges[among_rich], len(samples), kept)}
        rotations = refine_rotations(
            session,
            samples,
            rotations,
            edges[among_rich],
            energies[among_rich],
            group=options.group,
            fixed=held | kept,
        )
        kept |= {int(i): rotations[i] for i in np.flatnonzero(~poor)}
        edges, energies = edges[~among_rich], energies[~among_rich]
    return refine_rotations(
        session, samples, rotations, edges, energies, group=options.group, fixed=kept
    )


def _loose(edges: IntArray, num: int, fixed: Mapping[int, FloatArray]) -> list[int]:
    """Return the first shape of each part that the edges (e, 2) connect, where none of the part is fixed."""
    parts = vertex_components(num, [edges])[1]
    firsts = np.unique(parts, return_index=True)[1]
    return np.setdiff1d(firsts, firsts[parts[list(fixed)]]).tolist()


def refine_rotations(
    session: AlignSession,
    samples: Sequence[Samples],
    rotations: FloatArray,
    edges: IntArray,
    energies: FloatArray,
    *,
    group: str,
    fixed: Mapping[int, FloatArray],
) -> FloatArray:
    """Return ``R_common_shape`` refined on the shapes' dense samples, shape (N, 3, 3).

    Parameters
    ----------
    session : Session
    samples : sequence of Samples
        With dense samples.
    rotations : ndarray, shape (N, 3, 3)
        Synchronized poses.
    edges : ndarray of int, shape (E, 2)
        Pairs that agree with them.
    energies : ndarray, shape (E,)
        How well each pair matches at these poses.
    group : {"SO", "O"}
    fixed : mapping of int to ndarray (3, 3)
        Poses that stay, at least one in each part that the edges connect.
    """
    local = local_pairs(len(samples), edges, energies)
    pattern = RotationPattern.from_user(None, 3, group)
    points = [Shared(key=str(i), reader=points_from_record) for i in range(len(samples))]
    starts = {(i, j): rotations[i].T @ rotations[j] for i, j in local.tolist()}
    tasks = {
        (i, j): {"target": points[i], "source": points[j], "start": start}
        for (i, j), start in starts.items()
    }
    with table_of_values(samples) as table:
        poses = list(session.map_parallel("refinements", refine_pair, tasks, shared=table).values())
    graph = PairGraph.of_candidates(
        local,
        [(rotation[None], np.array([energy])) for rotation, energy, _ in poses],
        num_shapes=len(samples),
        pattern=pattern,
        weights=np.array([weight for _, _, weight in poses]),
    )
    return synchronize_graph(graph, fixed=fixed).rotations


def local_pairs(
    num_shapes: int, edges: IntArray, energies: FloatArray, *, num: int = NUM_NEIGHBOURS
) -> IntArray:
    """Return the pairs that are refined: those of least energy of every shape, and a spanning forest.

    Parameters
    ----------
    num_shapes : int
    edges : ndarray of int, shape (E, 2)
    energies : ndarray, shape (E,)
    num : int
        Pairs that each shape names.

    Returns
    -------
    ndarray of int, shape (L, 2)
        A choice of the edges, in their order; shapes that the edges connect stay connected.
    """
    graph = nx.Graph()
    graph.add_nodes_from(range(num_shapes))
    graph.add_weighted_edges_from(
        (int(i), int(j), float(e)) for (i, j), e in zip(edges, energies, strict=True)
    )
    kept = {frozenset(pair) for pair in nx.minimum_spanning_edges(graph, data=False)}
    for shape in graph:
        nearest = sorted((data["weight"], other) for other, data in graph[shape].items())[:num]
        kept |= {frozenset((shape, other)) for _, other in nearest}
    return np.array([pair for pair in edges.tolist() if frozenset(pair) in kept]).reshape(-1, 2)
