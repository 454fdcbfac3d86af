"""Joins shapes none of which is complete, such as scans, by the pairs that overlap, and refines all together.

Pairs that share nothing say nothing. The poses follow from a robust synchronization of the pairs that overlap, in
rotation first, then in place; all overlaps together refine them. A scan is as sure as the weakest cut of overlaps
that holds it to the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import networkx as nx
import numpy as np

from collalign.confidence.overlap_model import MOST_CERTAIN, overlap_chances, overlap_log_odds
from collalign.confidence.pose_model import MOST_CONFIDENT
from collalign.synchronization import PairGraph, synchronize_graph
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.local_surface import LocalSurface
from data_tools.poses import moved_by, turn_deg
from data_tools.threads import one_blas_thread
from pairwise.features.overlap import LocalPoses, judge_poses
from pairwise.features.poses import STEP_COSINE, rotations_by
from pairwise.problem.pattern import RotationPattern

#: Pairs join shapes if one of their poses is at least this probable.
JOINING_CHANCE = 0.5
#: A pose of a pair agrees with the common poses within so many degrees and cells.
AGREE_DEG, AGREE_CELLS = 10.0, 5.0
#: Rounds of the joint least squares that settle places, and their scale of outliers, in cells.
NUM_ROUNDS, OUTLIER_CELLS = 20, 2.0
#: Cutoffs of the joint refinement's steps, in cells, and points of each surface that take part in a pair.
JOINT_STEPS, JOINT_POINTS = (*(2.0,) * 3, *(1.2,) * 5, *(0.8,) * 8), 400
#: Blocks of shapes that are moved to a place that more pairs ask for, one after the other.
MOST_MOVES = 6

#: Poses of pairs, by target and source.
Overlaps: TypeAlias = Mapping[tuple[int, int], LocalPoses]
#: How probable each of them is.
Chances: TypeAlias = Mapping[tuple[int, int], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakCut:
    """Some shapes, what holds them to the others, and what asks for another place of theirs.

    Attributes
    ----------
    ends : (int, int)
        Two shapes that this cut parts, and no weaker one does.
    members : ndarray of int
        The shapes of the smaller side.
    held, against : float
        Minus the logarithm of the chance that all pairs across that agree with the poses are wrong; the same of those
        pairs across that agree with each other on another place.
    move : ndarray, shape (4, 4)
        Takes the members to that place.
    """

    ends: tuple[int, int]
    members: IntArray
    held: float
    against: float
    move: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedScans:
    """Poses of shapes none of which is complete, and what holds them.

    Attributes
    ----------
    transforms : ndarray, shape (N, 4, 4)
        Rigid, to a common frame of each part.
    confidence : ndarray, shape (N,)
        That a shape lies right relative to the best held one of its part; 0 for shapes that nothing joins.
    kept : mapping of (int, int) to LocalPoses
        The pairs that hold them, each with one pose: the common one.
    parts : list of ndarray of int
        Shapes that overlaps join, the largest part first.
    cuts : list of WeakCut
        Between the shapes of each part.
    """

    transforms: FloatArray
    confidence: FloatArray
    kept: Overlaps
    parts: list[IntArray]
    cuts: list[WeakCut]


@one_blas_thread()
def join_scans(surfaces: Sequence[LocalSurface], overlaps: Overlaps, group: str) -> JoinedScans:
    """Join shapes by the pairs that overlap.

    Parameters
    ----------
    surfaces : sequence of LocalSurface
        In one unit of length, with one cell.
    overlaps : mapping of (int, int) to LocalPoses
        What pairs i < j share.
    group : {"SO", "O"}
    """
    chances = {pair: overlap_chances(poses) for pair, poses in overlaps.items()}
    joining = {pair: overlaps[pair] for pair, own in chances.items() if own.max(initial=0.0) >= JOINING_CHANCE}
    transforms = np.tile(np.eye(4), (len(surfaces), 1, 1))
    transforms[:, :3, :3] = _synchronized(joining, chances, len(surfaces), group)
    transforms, agreeing = _settled(surfaces, joining, transforms)
    for _ in range(MOST_MOVES):
        cuts = weak_cuts(surfaces, overlaps, chances, agreeing, transforms)
        worst = min(cuts, key=lambda cut: cut.held - cut.against, default=None)
        if worst is None or worst.held >= worst.against:
            break
        moved = transforms.copy()
        moved[worst.members] = worst.move @ moved[worst.members]
        transforms, agreeing = _settled(surfaces, joining, moved)
    cuts = weak_cuts(surfaces, overlaps, chances, agreeing, transforms)
    kept = {}
    for i, j in agreeing:
        relative = np.linalg.inv(transforms[i]) @ transforms[j]
        kept[i, j] = judge_poses(surfaces[i], surfaces[j], relative[None, :3, :3], relative[None, :3, 3])
    graph = _held_together(len(surfaces), kept)
    parts = sorted((np.array(sorted(part)) for part in nx.connected_components(graph)), key=lambda p: (-len(p), p[0]))
    confidence = _confidence(len(surfaces), cuts, parts)
    return JoinedScans(transforms=transforms, confidence=confidence, kept=kept, parts=parts, cuts=cuts)


def _settled(
    surfaces: Sequence[LocalSurface], joining: Overlaps, transforms: FloatArray
) -> tuple[FloatArray, Overlaps]:
    """Return poses in which the pairs that agree in rotation settle places and refine all, and these pairs."""
    rotations, cell = transforms[:, :3, :3], surfaces[0].cell
    agreeing = {}
    for (i, j), poses in joining.items():
        angles = turn_deg(poses.rotations, rotations[i].T @ rotations[j])
        nearest = int(np.argmin(angles))
        if angles[nearest] < AGREE_DEG:
            agreeing[i, j] = poses[[nearest]]
    shifts = _placed(agreeing, rotations, cell)
    agreeing = {
        (i, j): poses
        for (i, j), poses in agreeing.items()
        if np.linalg.norm(rotations[i] @ poses.shifts[0] - (shifts[j] - shifts[i])) < AGREE_CELLS * cell
    }
    return _refined(surfaces, list(agreeing), rotations, shifts), agreeing


def _synchronized(joining: Overlaps, chances: Chances, num: int, group: str) -> FloatArray:
    """Return ``R_common_i`` of every shape, shape (N, 3, 3), from the candidates of the pairs that overlap."""
    if not joining:
        return np.tile(np.eye(3), (num, 1, 1))
    graph = PairGraph.of_candidates(
        np.array(list(joining), dtype=np.int64),
        [(poses.rotations, 1.0 - poses.overlap) for poses in joining.values()],
        num_shapes=num,
        pattern=RotationPattern.from_user(None, 3, group),
        log_odds=[overlap_log_odds(poses) for poses in joining.values()],
        weights=np.array([chances[pair].max() for pair in joining]),
    )
    return synchronize_graph(graph).rotations


def _placed(agreeing: Overlaps, rotations: FloatArray, cell: float) -> FloatArray:
    """Return the shifts (N, 3) that fit those of the pairs best, outliers damped (Cauchy's weights)."""
    num = len(rotations)
    shifts = np.zeros((num, 3))
    if not agreeing:
        return shifts
    pairs = np.array(list(agreeing))
    asked = np.stack([rotations[i] @ poses.shifts[0] for (i, _), poses in agreeing.items()])
    incidence = np.zeros((len(pairs), num))
    incidence[np.arange(len(pairs)), pairs[:, 0]], incidence[np.arange(len(pairs)), pairs[:, 1]] = -1.0, 1.0
    weights = np.ones(len(pairs))
    for _ in range(NUM_ROUNDS):
        roots = np.sqrt(weights)[:, None]
        shifts = np.linalg.lstsq(roots * incidence, roots * asked, rcond=None)[0]
        gaps = np.linalg.norm(incidence @ shifts - asked, axis=1)
        weights = 1.0 / (1.0 + (gaps / (OUTLIER_CELLS * cell)) ** 2)
    return shifts


def _refined(
    surfaces: Sequence[LocalSurface], pairs: Sequence[tuple[int, int]], rotations: FloatArray, shifts: FloatArray
) -> FloatArray:
    """Refine all poses together: points to planes over all pairs that overlap, trimmed, Gauss-Newton."""
    rotations, shifts, cell = rotations.copy(), shifts.copy(), surfaces[0].cell
    num = len(surfaces)
    samples = [slice(None, None, -(-len(one.points) // JOINT_POINTS)) for one in surfaces]
    for cutoff in JOINT_STEPS if pairs else ():
        moments, slopes = np.zeros((num, 6, num, 6)), np.zeros((num, 6))
        for pair in pairs:
            for a, b in (pair, pair[::-1]):
                ends, poses = (surfaces[a], surfaces[b]), (rotations, shifts)
                rows, gaps = _plane_rows(*ends, samples[b], poses, (a, b), cutoff * cell)
                block = rows.T @ rows
                slope = rows.T @ gaps
                for p, sign_p in ((a, -1.0), (b, 1.0)):
                    slopes[p] += sign_p * slope
                    for q, sign_q in ((a, -1.0), (b, 1.0)):
                        moments[p, :, q] += sign_p * sign_q * block
        full = moments.reshape(6 * num, 6 * num)
        damping = 1e-6 * np.trace(full) / len(full) + np.finfo(float).tiny
        steps = np.linalg.solve(full + damping * np.eye(len(full)), slopes.ravel()).reshape(num, 6)
        turns = rotations_by(steps[:, :3])
        shifts = (turns @ shifts[:, :, None])[:, :, 0] + steps[:, 3:]
        rotations = turns @ rotations
    transforms = np.tile(np.eye(4), (num, 1, 1))
    transforms[:, :3, :3], transforms[:, :3, 3] = rotations, shifts
    return transforms


def _plane_rows(
    target: LocalSurface,
    source: LocalSurface,
    chosen: slice,
    poses: tuple[FloatArray, FloatArray],
    pair: tuple[int, int],
    reach: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the rows (n, 6) and gaps (n,) of points of b on planes of a, in the common frame."""
    rotations, shifts = poses
    a, b = pair
    placed = source.points[chosen] @ rotations[b].T + shifts[b]
    normals = source.normals[chosen] @ rotations[b].T
    distances, nearest = target.tree.query((placed - shifts[a]) @ rotations[a], distance_upper_bound=reach)
    near = np.flatnonzero(np.isfinite(distances))
    planes = target.normals[nearest[near]] @ rotations[a].T
    near = near[(planes * normals[near]).sum(axis=1) > STEP_COSINE]
    planes = target.normals[nearest[near]] @ rotations[a].T
    feet = target.points[nearest[near]] @ rotations[a].T + shifts[a]
    rows = np.concatenate([np.cross(placed[near], planes), planes], axis=1)
    return rows, ((feet - placed[near]) * planes).sum(axis=1)


def weak_cuts(
    surfaces: Sequence[LocalSurface],
    overlaps: Overlaps,
    chances: Chances,
    agreeing: Overlaps,
    transforms: FloatArray,
) -> list[WeakCut]:
    """Return the weakest cut between every two shapes that hang together (a tree of them: Gomory and Hu 1961)."""
    num, cell = len(surfaces), surfaces[0].cell
    graph = _held_together(num, agreeing)
    for i, j in agreeing:
        same = _same_poses(overlaps[i, j], transforms[i], transforms[j])
        graph[i][j]["capacity"] = _weight(float(chances[i, j][same].sum()))
    cuts = []
    for part in map(sorted, nx.connected_components(graph)):
        tree = nx.gomory_hu_tree(graph.subgraph(part)) if len(part) > 1 else nx.Graph()
        for a, b, data in sorted(tree.edges(data=True), key=lambda edge: edge[:2]):
            side = nx.Graph(tree)
            side.remove_edge(a, b)
            halves = sorted((sorted(half) for half in nx.connected_components(side)), key=lambda h: (len(h), h))
            asked = _other_places(overlaps, chances, transforms, set(halves[0]), set(halves[1]))
            middles = [moved_by(transforms[i], surfaces[i].points.mean(axis=0)) for i in halves[0]]
            middle = np.mean(middles, axis=0)
            against, move = _strongest(asked, middle, cell)
            cuts.append(
                WeakCut(
                    ends=(a, b), members=np.array(halves[0]), held=float(data["weight"]), against=against, move=move
                )
            )
    return cuts


def _held_together(num: int, pairs: Iterable[tuple[int, int]]) -> nx.Graph:
    """Return the graph of all shapes and some pairs."""
    graph = nx.Graph()
    graph.add_nodes_from(range(num))
    graph.add_edges_from(pairs)
    return graph


def _same_poses(poses: LocalPoses, target: FloatArray, source: FloatArray) -> BoolArray:
    """Return which poses of a pair agree in rotation with those of its two shapes (4, 4)."""
    return np.asarray(turn_deg(poses.rotations, target[:3, :3].T @ source[:3, :3]) < AGREE_DEG)


def _weight(chance: float) -> float:
    return -float(np.log1p(-min(chance, MOST_CERTAIN)))


def _other_places(
    overlaps: Overlaps,
    chances: Chances,
    transforms: FloatArray,
    members: set[int],
    others: set[int],
) -> list[tuple[float, FloatArray]]:
    """Return the weight and the move of the members (4, 4) of each probable pose across that asks for another place.

    Improbable ones do not add up: what makes one pair err, such as a symmetry, makes many.
    """
    asked = []
    for (i, j), poses in overlaps.items():
        if (i in members and j in others) or (i in others and j in members):
            relative = np.tile(np.eye(4), (len(poses), 1, 1))
            relative[:, :3, :3], relative[:, :3, 3] = poses.rotations, poses.shifts
            others_asked = ~_same_poses(poses, transforms[i], transforms[j]) & (chances[i, j] >= JOINING_CHANCE)
            for k in np.flatnonzero(others_asked):
                move = transforms[i] @ relative[k] @ np.linalg.inv(transforms[j])
                asked.append((_weight(float(chances[i, j][k])), move if j in members else np.linalg.inv(move)))
    return asked


def _strongest(
    asked: Sequence[tuple[float, FloatArray]], middle: FloatArray, cell: float
) -> tuple[float, FloatArray]:
    """Return the largest weight of moves that agree with each other, and the heaviest of these moves."""
    if not asked:
        return 0.0, np.eye(4)
    weights, moves = np.array([weight for weight, _ in asked]), np.stack([move for _, move in asked])
    places = moves[:, :3, :3] @ middle + moves[:, :3, 3]
    near = turn_deg(moves[:, None, :3, :3], moves[None, :, :3, :3]) < 2.0 * AGREE_DEG
    near &= np.linalg.norm(places[:, None] - places, axis=2) < 2.0 * AGREE_CELLS * cell
    total = near @ weights
    best = int(np.argmax(total))
    return float(total[best]), moves[best]


def _confidence(num: int, cuts: Sequence[WeakCut], parts: Sequence[IntArray]) -> FloatArray:
    """Return the chance that no cut between a shape and the best held one of its part is wrong, shape (N,)."""
    tree = nx.Graph()
    tree.add_nodes_from(range(num))
    for cut in cuts:
        tree.add_edge(*cut.ends, margin=max(cut.held - cut.against, 0.0))
    confidence = np.zeros(num)
    for part in parts:
        if len(part) > 1:
            root = max(part.tolist(), key=lambda i: (tree.degree(i, weight="margin"), -i))
            held = {root: max(data["margin"] for _, _, data in tree.edges(root, data=True))}
            for parent, child in nx.bfs_edges(tree, root):
                held[child] = min(held[parent], tree[parent][child]["margin"])
            for i in part.tolist():
                confidence[i] = min(1.0 - np.exp(-held[i]), MOST_CONFIDENT)
    return confidence
