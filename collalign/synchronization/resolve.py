"""Which pairs disagree with a synchronization, and whether their energies allow the pose that it asks for.

Steps 2 to 4 of the paper's algorithm (section 5), with a veto of the energies: a pair takes the pose that the
collection asks for only where its energy allows it, and keeps its own candidates besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from collalign.synchronization.problem.frames import angles_rad, relative, transposed
from collalign.synchronization.problem.graph import PairGraph
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only

#: A pair is solved again where its candidates are all off by more than this, radians.
SAME_POSE_RAD = np.deg2rad(1.0)
#: A pose of more than this times the pair's lowest energy is vetoed, unless the pair has it already.
MAX_ENERGY_RATIO = 2.0


def with_room(graph: PairGraph) -> PairGraph:
    """Return the graph with an absent candidate appended to each pair, where :func:`with_resolved` puts its pose.

    Parameters
    ----------
    graph : PairGraph
        With energies: they decide which of the collection's poses a pair accepts.
    """
    assert graph.energies is not None
    room = np.tile(np.eye(graph.dim), (graph.num_edges, 1, 1, 1))
    return replace(
        graph,
        candidates=read_only(np.concatenate([graph.candidates, room], axis=1)),
        present=read_only(np.pad(graph.present, ((0, 0), (0, 1)))),
        energies=read_only(np.pad(graph.energies, ((0, 0), (0, 1)), constant_values=np.inf)),
    )


def disagreeing_pairs(graph: PairGraph, poses: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the pairs whose candidates are all off their synchronized rotation, and that rotation.

    Parameters
    ----------
    graph : PairGraph
    poses : ndarray, shape (N, d, d)
        ``R_common_i``.

    Returns
    -------
    edges : ndarray of int, shape (e,)
    asked : ndarray, shape (e, d, d)
        ``R_i_j`` that the poses ask for.
    """
    asked = relative(transposed(poses), graph.edges)
    stack = graph.candidates
    away = np.stack([angles_rad(transposed(stack[:, k]) @ asked) for k in range(stack.shape[1])], axis=1)
    edges = np.flatnonzero(np.where(graph.present, away, np.inf).min(axis=1) > SAME_POSE_RAD)
    return edges, asked[edges]


def with_resolved(
    graph: PairGraph, edges: IntArray, rotations: Sequence[FloatArray], energies: Sequence[float]
) -> tuple[PairGraph, BoolArray]:
    """Put the poses of pairs that were solved again into their last candidate, where their energies allow it.

    Parameters
    ----------
    graph : PairGraph
        From :func:`with_room`.
    edges : ndarray of int, shape (e,)
    rotations, energies : sequences of length e
        The pose of each, (d, d), and its energy.

    Returns
    -------
    graph : PairGraph
    accepted : ndarray of bool, shape (e,)
        Whether the pose is new to its pair and not vetoed.
    """
    assert graph.energies is not None
    stack, costs, present = graph.candidates.copy(), graph.energies.copy(), graph.present.copy()
    accepted = np.zeros(len(edges), dtype=np.bool_)
    for n, (edge, pose, energy) in enumerate(zip(edges, rotations, energies, strict=True)):
        own = stack[edge, graph.present[edge]]
        is_known = angles_rad(own.transpose(0, 2, 1) @ pose).min() <= SAME_POSE_RAD
        if is_known or not energy <= MAX_ENERGY_RATIO * costs[edge, :-1].min():
            continue
        stack[edge, -1], costs[edge, -1], present[edge, -1] = pose, energy, True
        accepted[n] = True
    return replace(
        graph, candidates=read_only(stack), energies=read_only(costs), present=read_only(present)
    ), accepted
