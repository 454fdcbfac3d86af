"""The robust method as a whole: components, blocks of coordinates, poses, and how far these can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collalign.products.pair import MAX_ALTERNATIVES, Alternative
from collalign.synchronization.frames import fix_gauge, transposed
from collalign.synchronization.graph import PairGraph, degrees
from collalign.synchronization.model import PRIORS, best_candidates, squared_distances
from collalign.synchronization.search import State, find_poses
from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line, read_only
from data_tools.notes import Note
from pairwise.rotation_pattern import RotationPattern


@dataclass(frozen=True, kw_only=True, eq=False)
class SynchronizationResult:
    """One pose per shape, and how far each can be trusted. All arrays are read-only.

    Attributes
    ----------
    rotations : ndarray, shape (N, d, d)
        ``R_common_i``. Shapes of different components have no common frame: each has its own gauge.
    confidence : ndarray, shape (N,)
        Probability that the shape's pose is right relative to its group; NaN where it was not estimated.
    edge_inlier : ndarray of bool, shape (E,)
        Whether the pair agrees with the answer.
    edge_choice : ndarray of int, shape (E,)
        The candidate of each pair nearest to the answer.
    parts : tuple of ndarray of int
        Partition of the shapes: poses are comparable within a part. Here the components; a run may split further.
    components : tuple of ndarray of int
        Connected parts of the graph of pairs.
    alternatives : tuple of tuple of Alternative
        For each shape its best other poses, most probable first.
    warnings : tuple of Note
        Which poses cannot be compared.
    """

    rotations: FloatArray
    confidence: FloatArray
    edge_inlier: BoolArray
    edge_choice: IntArray
    parts: tuple[IntArray, ...]
    components: tuple[IntArray, ...]
    alternatives: tuple[tuple[Alternative, ...], ...]
    warnings: tuple[Note, ...]

    __repr__ = one_line


#: No confidence is stated beyond this: the model itself may be wrong.
MOST_BELIEVED = 0.999


def assess(
    state: State, frames: FloatArray, free: BoolArray
) -> tuple[FloatArray, list[tuple[Alternative, ...]]]:
    """Return the doubts about an answer: of one connected group the confidence of each pose and its alternatives.

    Parameters
    ----------
    state : State
        The answer.
    frames : ndarray, shape (N, d, d)
        The reported frames: the answer's, refined.
    free : ndarray of bool, shape (N,)
        Shapes that are not fixed by hand; the others are certain.

    Returns
    -------
    confidence : ndarray, shape (N,)
    alternatives : list of tuple of Alternative
        Per shape.
    """
    beliefs = np.minimum(state.beliefs[:, 0], MOST_BELIEVED)
    confidence = beliefs * (0.5 + 0.5 * np.minimum(1.0, evidence(state)))
    confidence[~free] = 1.0
    return confidence, pose_alternatives(state, frames)


def evidence(state: State) -> FloatArray:
    """Return how much the pairs can say about each pose, in units of what makes beliefs trustworthy, shape (N,).

    A pair chooses among m alternatives of probabilities ``pi``: its candidates, or the common rotations. The squared
    correlation between what it says and what is right is ``(m sum pi^2 - 1) / (m - 1)``, the second eigenvalue,
    squared, of this channel. Where only a share e of the pairs is explained the eigenvalue falls by e: the others say
    nothing. The signal of the graph is this times the mean degree less one. Below one no method can do better than
    chance (Kesten and Stigum 1966). A shape's own evidence is the squared correlation times the number of its
    explained pairs less one. The smaller of both counts.
    """
    model = state.model
    graph = model.graph
    explained = state.alternatives.explained
    chances = np.exp(model.log_prior)
    if graph.candidates.shape[1] == 1:
        rates = state.alternatives.rates
        chances = np.concatenate([[max(1.0 - rates.sum(), 0.0)], rates])[None] / max(
            1.0, rates.sum()
        )
    size = (chances > 0).sum(axis=1)
    power = float(
        np.mean(
            np.where(
                size > 1, (size * (chances**2).sum(axis=1) - 1.0) / np.maximum(size - 1, 1), 1.0
            )
        )
    )
    degree = 2.0 * graph.num_edges / graph.num_shapes
    signal = power * explained.mean() ** 2 * max(degree - 1.0, 0.0)
    own = power * np.maximum(degrees(graph, explained) - 1.0, 0.0)
    return np.minimum(signal / PRIORS.enough_signal, own / PRIORS.enough_pairs)


def pose_alternatives(state: State, frames: FloatArray) -> list[tuple[Alternative, ...]]:
    """Return for each shape its most probable other poses with their log-odds.

    Parameters
    ----------
    state : State
    frames : ndarray, shape (N, d, d)
        The reported frames, in the gauge of the report.
    """
    found = []
    for shape, beliefs in enumerate(state.beliefs):
        order = [
            a
            for a in np.argsort(-beliefs[1:], kind="stable") + 1
            if state.alternatives.offered[shape, a]
        ]
        rotations = state.alternatives.rotations[shape]
        found.append(
            tuple(
                Alternative(
                    rotation=(frames[shape] @ rotations[a]).T,
                    log_odds=float(
                        np.log(max(beliefs[0], 1e-300)) - np.log(max(beliefs[a], 1e-300))
                    ),
                )
                for a in order[:MAX_ALTERNATIVES]
            )
        )
    return found


#: Pairs whose right candidate is at least this probable agree with the answer.
INLIER_PROBABILITY = 0.5


def solve_block(
    graph: PairGraph, fixed: Mapping[int, FloatArray]
) -> tuple[FloatArray, IntArray, BoolArray, State]:
    """Find the poses of a connected group.

    Returns
    -------
    frames : ndarray, shape (N, b, b)
    choice : ndarray of int, shape (E,)
    inlier : ndarray of bool, shape (E,)
    state : State
        The answer with the model fitted to it.
    """
    state = find_poses(graph, fixed)
    squared = squared_distances(graph, state.frames)
    right = state.model.responsibilities(squared).sum(axis=1)
    return state.frames, best_candidates(squared, state.model), right >= INLIER_PROBABILITY, state


def restricted(graph: PairGraph, index: IntArray, choice: IntArray | None = None) -> PairGraph:
    """Return the graph of one block of coordinates.

    Parameters
    ----------
    graph : PairGraph
    index : ndarray of int, shape (b,)
        Coordinates of the block, adjacent.
    choice : ndarray of int, shape (E,), optional
        The candidate of each pair that the graph keeps; all of them by default.
    """
    special = any(
        start == index[0] and stop == index[-1] + 1 for start, stop in graph.pattern.special_blocks
    )
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
        block,
        candidates=part[rows, choice][:, None],
        present=np.ones((len(rows), 1), dtype=bool),
        energies=energies,
        log_odds=None,
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
    components = full.connected_components()
    draft = _Draft.empty(full)
    for members in components:
        part, kept = full.subgraph(members)
        local = {int(np.searchsorted(members, i)): fixed[i].T for i in fixed if i in members}
        if part.num_edges:
            _solve_component(draft, part, members, kept, local)
    poses = fix_gauge(
        transposed(draft.frames),
        components,
        reference=reference,
        fixed=fixed,
        pattern=graph.pattern,
    )
    return _result(graph, full, draft, poses, components)


@dataclass(kw_only=True, eq=False)
class _Draft:
    """The result while it is filled group by group; frames and what is said about them have no common gauge yet."""

    frames: FloatArray
    choice: IntArray
    inlier: BoolArray
    confidence: FloatArray
    alternatives: list[tuple[Alternative, ...]]

    @classmethod
    def empty(cls, graph: PairGraph) -> _Draft:
        return cls(
            frames=np.tile(np.eye(graph.dim), (graph.num_shapes, 1, 1)),
            choice=graph.best_choice.copy(),
            inlier=np.zeros(graph.num_edges, dtype=bool),
            confidence=np.full(graph.num_shapes, np.nan),
            alternatives=[()] * graph.num_shapes,
        )


def _solve_component(
    draft: _Draft, part: PairGraph, members: IntArray, kept: IntArray, fixed: dict[int, FloatArray]
) -> None:
    """Solve one component: the rotation block with its doubts, then the other blocks by the same candidates."""
    for number, index in enumerate(part.pattern.components):
        block = restricted(part, index, draft.choice[kept] if number else None)
        given = {i: frame[index[:, None], index] for i, frame in fixed.items()}
        frames, choice, inlier, state = solve_block(block, given)
        draft.frames[np.ix_(members, index, index)] = frames
        if number:
            continue
        draft.choice[kept], draft.inlier[kept] = choice, inlier
        free = np.ones(len(members), dtype=bool)
        free[list(fixed)] = False
        draft.confidence[members], alternatives = assess(state, frames, free)
        for shape, own in zip(members, alternatives, strict=True):  # in the component's own frame
            draft.alternatives[shape] = own


def _result(
    graph: PairGraph,
    full: PairGraph,
    draft: _Draft,
    poses: FloatArray,
    components: tuple[IntArray, ...],
) -> SynchronizationResult:
    """Bring what the draft says to the reported gauge."""
    count, index = graph.num_edges, graph.pattern.components[0]
    nearest = np.argmin(
        np.where(graph.present, squared_distances(graph, transposed(poses)), np.inf), axis=1
    )
    choice = np.where(full.fixed[:count], nearest, draft.choice[:count])
    gauge = (poses @ draft.frames)[:, index[:, None], index]
    return SynchronizationResult(
        rotations=read_only(poses),
        confidence=read_only(draft.confidence),
        edge_inlier=read_only(draft.inlier[:count]),
        edge_choice=read_only(choice),
        parts=components,
        components=components,
        alternatives=_posed_alternatives(draft, poses, gauge, index),
        warnings=connectivity_warnings(len(components)),
    )


def _posed_alternatives(
    draft: _Draft, poses: FloatArray, gauge: FloatArray, index: IntArray
) -> tuple[tuple[Alternative, ...], ...]:
    """Return the alternatives as full poses in the reported gauge."""
    return tuple(
        tuple(
            Alternative(
                rotation=_embedded(rotation @ other.rotation, pose, index), log_odds=other.log_odds
            )
            for other in others
        )
        for others, pose, rotation in zip(draft.alternatives, poses, gauge, strict=True)
    )


def _embedded(block: FloatArray, around: FloatArray, index: IntArray) -> FloatArray:
    """Return a copy of a (d, d) matrix with one diagonal block replaced, read-only."""
    matrix = around.copy()
    matrix[index[:, None], index] = block
    return read_only(matrix)


def connectivity_warnings(num_components: int) -> tuple[Note, ...]:
    """Return the note that says that components are not connected, where there are several."""
    if num_components == 1:
        return ()
    return (Note("unconnected", values={"num": num_components}),)
