"""The robust method as a whole: groups, blocks of coordinates, poses, doubts and the certificate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collalign.synchronization.certificate import (
    SynchronizationCertificate,
    certify_frames,
    combine_certificates,
)
from collalign.synchronization.gauge import fix_gauge
from collalign.synchronization.geometry import angles_rad, relative, transposed
from collalign.synchronization.graph import PairGraph, degrees
from collalign.synchronization.least_squares import polish
from collalign.synchronization.model import best_candidates, squared_distances
from collalign.synchronization.result import SynchronizationResult
from collalign.synchronization.search import State, find_poses
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from pairwise.pattern import RotationPattern
from pairwise.status import Status


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockOutcome:
    """Poses of one connected group in one block of coordinates.

    Attributes
    ----------
    frames : ndarray, shape (N, b, b)
    choice : ndarray of int, shape (E,)
    weights : ndarray, shape (E,)
        Final weights: probability that the chosen candidate is right over its variance, largest 1.
    inlier : ndarray of bool, shape (E,)
    states : list of State
        What the starts led to, the answer first.
    certificate : SynchronizationCertificate
    """

    frames: FloatArray
    choice: IntArray
    weights: FloatArray
    inlier: BoolArray
    states: list[State]
    certificate: SynchronizationCertificate


def solve_block(graph: PairGraph, held: Mapping[int, FloatArray]) -> BlockOutcome:
    """Find the poses of a connected group and bring them to a stationary point of the weighted least squares."""
    anchors = dict(held) or {int(np.argmax(degrees(graph, graph.weights))): np.eye(graph.dim)}
    states = find_poses(graph, anchors)
    best = states[0]
    squared = squared_distances(graph, best.frames)
    choice = best_candidates(squared, best.model)
    share = best.model.responsibilities(squared)[np.arange(graph.num_edges), choice]
    weights = share / best.model.variances
    weights = np.maximum(weights / weights.max(), 1e-9)
    free = np.ones(graph.num_shapes, dtype=bool)
    free[list(anchors)] = False
    frames = polish(best.frames, graph.edges, graph.chosen(choice), weights, free)
    return BlockOutcome(
        frames=frames,
        choice=choice,
        weights=weights,
        inlier=best.model.responsibilities(squared_distances(graph, frames)).sum(axis=1) >= 0.5,
        states=states,
        certificate=certify_frames(graph, graph.chosen(choice), weights, frames),
    )


def restricted(graph: PairGraph, index: IntArray, choice: IntArray | None = None) -> PairGraph:
    """Return the graph of one block of coordinates, of one chosen candidate per pair where a choice is given."""
    special = any(start == index[0] and stop == index[-1] + 1 for start, stop in graph.pattern.special_blocks)
    part = graph.candidates[:, :, index[:, None], index]
    block = replace(
        graph,
        candidates=part,
        pattern=RotationPattern.from_user(None, len(index), "SO" if special else "O"),
    )
    if choice is None:
        return block
    rows = np.arange(graph.num_edges)
    energies = None if graph.energies is None else graph.energies[rows, choice][:, None]
    return replace(
        block, candidates=part[rows, choice][:, None], present=np.ones((len(rows), 1), dtype=bool), energies=energies
    )


def robust_synchronization(
    graph: PairGraph, fixed: Mapping[int, FloatArray], reference: int
) -> SynchronizationResult:
    """Synchronize every connected group; the rotation block decides candidates, other blocks follow its choice.

    Parameters
    ----------
    graph : PairGraph
    fixed : mapping of int to ndarray (d, d)
        ``R_common_i`` of shapes set by hand.
    reference : int
        Shape whose pose is the identity where no shape is fixed.
    """
    full = graph.with_constraints(fixed)
    components = full.connected_groups()
    frames = np.tile(np.eye(graph.dim), (graph.num_shapes, 1, 1))
    choice = full.best_choice.copy()
    weights, inlier = np.zeros(full.num_edges), np.zeros(full.num_edges, dtype=bool)
    confidence = np.ones(graph.num_shapes)
    noise, certificates = [], []
    for members in components:
        part, kept = full.subgraph(members)
        if not part.num_edges:
            continue
        local = {int(np.searchsorted(members, i)): fixed[i].T for i in fixed if i in members}
        for number, index in enumerate(graph.pattern.components):
            block = restricted(part, index, choice[kept] if number else None)
            anchors = {i: frame[index[:, None], index] for i, frame in local.items()}
            found = solve_block(block, anchors)
            frames[np.ix_(members, index, index)] = found.frames
            certificates.append(found.certificate)
            if number == 0:
                choice[kept], weights[kept], inlier[kept] = found.choice, found.weights, found.inlier
                confidence[members] = found.states[0].beliefs[:, 0]
                noise.append(found.states[0].model.noise_rad)
    poses = fix_gauge(transposed(frames), components, reference=reference, fixed=fixed, pattern=graph.pattern)
    return _result(graph, full, poses, choice, weights, inlier, confidence, components, noise, certificates)


def _result(
    graph: PairGraph,
    full: PairGraph,
    poses: FloatArray,
    choice: IntArray,
    weights: FloatArray,
    inlier: BoolArray,
    confidence: FloatArray,
    components: tuple[IntArray, ...],
    noise: list[float],
    certificates: list[SynchronizationCertificate],
) -> SynchronizationResult:
    count = graph.num_edges
    nearest = np.argmin(np.where(graph.present, squared_distances(graph, transposed(poses)), np.inf), axis=1)
    choice, weights, inlier = np.where(full.held[:count], nearest, choice[:count]), weights[:count], inlier[:count]
    misfit = angles_rad(transposed(graph.chosen(choice)) @ relative(transposed(poses), graph.edges))
    return SynchronizationResult(
        rotations=read_only(poses),
        confidence=read_only(confidence),
        edge_inlier=read_only(inlier),
        edge_choice=read_only(choice),
        edge_inconsistency_rad=read_only(misfit),
        edge_weights=read_only(weights),
        groups=components,
        components=components,
        weak_cuts=(),
        alternatives=((),) * graph.num_shapes,
        reflected=read_only(reflected_shapes(poses, graph.pattern)),
        symmetries=(),
        noise_rad=max(noise, default=float("nan")),
        certificate=combine_certificates(certificates),
        status=Status.CONVERGED,
        warnings=connectivity_warnings(len(components)),
    )


def reflected_shapes(poses: FloatArray, pattern: RotationPattern) -> BoolArray:
    """Return which poses mirror the rotation block, the pattern's first component, shape (N,)."""
    index = pattern.components[0]
    return np.linalg.det(poses[:, index[:, None], index]) < 0


def connectivity_warnings(num_components: int) -> tuple[str, ...]:
    """Return the sentence that says that groups are not connected, where there are several."""
    if num_components == 1:
        return ()
    return (f"The pairs leave {num_components} groups unconnected: poses are comparable within each group only.",)
