"""How pairs and collection come to agree: pairs are solved again from the common poses, where they disagree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from collalign.options import AlignOptions
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints
from collalign.stages.pairs.match import pair_problem
from collalign.stages.poses.synchronize import pair_graph
from collalign.synchronization import SynchronizationResult, synchronize_graph
from collalign.synchronization.resolve import disagreeing_pairs, with_resolved, with_room
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.rotations import rotation_angle_deg
from pairwise.local.local_search import LocalMinima, minimise

#: How often disagreeing pairs are solved again.
MAX_ROUNDS = 5


def resolve_pairs(
    options: AlignOptions,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    solution: SynchronizationResult,
    constraints: Constraints,
) -> tuple[list[Pair], SynchronizationResult]:
    """Solve pairs again from the common poses where they disagree, and synchronize, until nothing changes.

    The paper's steps 2 to 4 (section 6.3 of Maron et al. 2016); a pair's energy may veto a pose.

    Parameters
    ----------
    options : AlignOptions
        With a decided group; with the paper's own synchronization nothing is solved again.
    samples : sequence of Samples
    pairs : sequence of Pair
    solution : SynchronizationResult
        Of these pairs.
    constraints : Constraints

    Returns
    -------
    pairs : list of Pair
        Re-solved poses are appended to their candidates.
    solution : SynchronizationResult
        Its ``edge_choice`` counts the candidates of the returned pairs.
    """
    agreed = list(pairs)
    if options.synchronization != "robust":
        return agreed, solution
    graph = with_room(pair_graph(pairs, len(samples), options.group))
    for _ in range(MAX_ROUNDS):
        edges, asked = disagreeing_pairs(graph, solution.rotations)
        poses = [_pose_from(samples, pairs[e], start, options.group) for e, start in zip(edges, asked, strict=True)]
        graph, accepted = with_resolved(
            graph,
            edges,
            [np.ascontiguousarray(pose.rotations[0, :3, :3]) for pose in poses],
            [float(pose.energies[0]) for pose in poses],
        )
        if not accepted.any():
            break
        for n in np.flatnonzero(accepted):
            agreed[edges[n]] = _with_pose(pairs[edges[n]], poses[n])
        solution = synchronize_graph(graph, fixed=constraints.fixed, reference=constraints.reference)
    last = np.array([len(pair.energies) - 1 for pair in agreed])
    is_resolved = solution.edge_choice == graph.present.shape[1] - 1
    return agreed, replace(solution, edge_choice=read_only(np.where(is_resolved, last, solution.edge_choice)))


def _with_pose(pair: Pair, pose: LocalMinima) -> Pair:
    return replace(
        pair,
        rotations=np.concatenate([pair.rotations, pose.rotations]),
        maps=np.concatenate([pair.maps, pose.maps]),
        energies=np.concatenate([pair.energies, pose.energies]),
    )


def with_common_match(
    samples: Sequence[Samples], pairs: Sequence[Pair], solution: SynchronizationResult, rotations: FloatArray
) -> list[Pair]:
    """Return the pairs with what synchronization says of them, and with their best match at the common poses.

    Parameters
    ----------
    samples : sequence of Samples
    pairs : sequence of Pair
    solution : SynchronizationResult
        Of these pairs.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``, refined and in the final gauge.
    """
    matched = []
    for e, pair in enumerate(pairs):
        point_map, energy = match_at(samples, pair, rotations)
        choice = int(solution.edge_choice[e])
        common = rotations[pair.target].T @ rotations[pair.source]
        matched.append(
            replace(
                pair,
                map_target_source=read_only(point_map),
                energy=energy,
                choice=choice,
                inlier=bool(solution.edge_inlier[e]),
                disagreement_deg=float(rotation_angle_deg(pair.rotations[choice, :3, :3], common)),
            )
        )
    return matched


def match_at(samples: Sequence[Samples], pair: Pair, rotations: FloatArray) -> tuple[IntArray, float]:
    """Return the best map of a pair at the common poses, and its energy."""
    target, source = samples[pair.target], samples[pair.source]
    rotation = rotations[pair.target].T @ rotations[pair.source]
    costs = cdist(source.positions @ rotation.T, target.positions, "sqeuclidean")
    costs += cdist(source.invariants, target.invariants, "sqeuclidean")
    rows, columns = linear_sum_assignment(costs)
    return columns.astype(np.int64), float(costs[rows, columns].sum())


def _pose_from(samples: Sequence[Samples], pair: Pair, start: FloatArray, group: str) -> LocalMinima:
    """Return the local minimum of a pair's energy next to a rotation of space."""
    target, source = samples[pair.target], samples[pair.source]
    problem = pair_problem(target, source, group)
    first = start
    if problem.dim > 3:
        # The eigenfunctions' block follows in closed form from the map that positions and invariants give.
        costs = cdist(source.positions @ start.T, target.positions, "sqeuclidean")
        costs += cdist(source.invariants, target.invariants, "sqeuclidean")
        first = problem.procrustes(linear_sum_assignment(costs)[1])
    return minimise(problem, first[None])
