"""Joins shapes none of which is complete, such as scans, by the pairs that overlap, and refines all together.

Pairs that share nothing say nothing. Two blocks of shapes at a time are joined where the poses of pairs between them
agree, and nothing lies in front of what was seen; the surest first. All overlaps together refine the poses. A scan is
as sure as the weakest cut of overlaps that holds it to the others.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import networkx as nx
import numpy as np

from collalign.confidence.overlap_model import (
    MOST_CERTAIN,
    chances_of,
    conflict_log_odds,
)
from collalign.confidence.pose_model import MOST_CONFIDENT
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.local_surface import LocalSurface
from data_tools.poses import moved_by, pose_angle_deg
from data_tools.threads import one_blas_thread
from pairwise.features.depth_images import sight_conflicts
from pairwise.features.overlap import LocalPoses, evaluate_poses
from pairwise.features.poses import STEP_COSINE, rotations_by

#: Pairs hold shapes if one of their poses is at least this probable; poses that are this probable may join blocks.
JOINING_CHANCE, PROPOSED_CHANCE = 0.5, 0.05
#: A pose of a pair agrees with the common poses within so many degrees and cells.
CONSISTENT_DEG, CONSISTENT_CELLS = 10.0, 5.0
#: Of pairs that agree, all but the surest count by this share: what makes one err, such as a symmetry, makes many.
SHARED_CAUSE = 0.3
#: Cutoffs of the joint refinement's steps, in cells, and points of each surface that take part in a pair.
JOINT_STEPS, JOINT_POINTS = (*(2.0,) * 3, *(1.2,) * 5, *(0.8,) * 8), 400

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
        Minus the logarithm of the chance that the pairs across that agree with the poses are wrong, less what
        contradicts these poses; the same of those pairs across that agree with each other on another place, negative
        where what was seen contradicts it.
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
    chances : mapping of (int, int) to ndarray, shape (p,)
        How probable each pose of each pair is.
    overlaps : mapping of (int, int) to LocalPoses
        The poses themselves.
    kept : mapping of (int, int) to LocalPoses
        The pairs that hold them, each with one pose: the common one.
    parts : list of ndarray of int
        Shapes that overlaps join, the largest part first.
    cuts : list of WeakCut
        Between the shapes of each part.
    """

    transforms: FloatArray
    confidence: FloatArray
    chances: Chances
    overlaps: Overlaps
    kept: Overlaps
    parts: list[IntArray]
    cuts: list[WeakCut]


@one_blas_thread()
def join_scans(
    surfaces: Mapping[int, LocalSurface],
    overlaps: Overlaps,
    log_odds: Mapping[tuple[int, int], FloatArray],
    *,
    num: int,
) -> JoinedScans:
    """Join shapes by the pairs that overlap.

    Parameters
    ----------
    surfaces : mapping of int to LocalSurface
        In one unit of length, with one cell; nothing joins shapes that are not among these.
    overlaps : mapping of (int, int) to LocalPoses
        What pairs i < j share.
    log_odds : mapping of (int, int) to ndarray, shape (p,)
        Of each of their poses against that none of the pair is right.
    num : int
        N, of all shapes.
    """
    chances = {pair: chances_of(odds) for pair, odds in log_odds.items()}
    transforms, block = np.tile(np.eye(4), (num, 1, 1)), np.arange(num)
    num_before = num + 1
    agreeing: Overlaps = {}
    # Poses that were not refined yet may seem to contradict what was seen.
    while 1 < (num_blocks := len(np.unique(block))) < num_before:
        num_before = num_blocks
        transforms, block = _joined(surfaces, overlaps, chances, transforms, block)
        agreeing = _agreeing(surfaces, overlaps, chances, transforms)
        transforms = _refined(surfaces, list(agreeing), transforms)
    cuts = weak_cuts(surfaces, overlaps, chances, agreeing, transforms)
    kept = {}
    for i, j in agreeing:
        relative = np.linalg.inv(transforms[i]) @ transforms[j]
        kept[i, j] = evaluate_poses(
            surfaces[i], surfaces[j], relative[None, :3, :3], relative[None, :3, 3]
        )
    graph = _held_together(num, kept)
    parts = sorted(
        (np.array(sorted(part)) for part in nx.connected_components(graph)),
        key=lambda p: (-len(p), p[0]),
    )
    confidence = _confidence(num, cuts, parts)
    return JoinedScans(
        transforms=transforms,
        confidence=confidence,
        chances=chances,
        overlaps=overlaps,
        kept=kept,
        parts=parts,
        cuts=cuts,
    )


def _joined(
    surfaces: Mapping[int, LocalSurface],
    overlaps: Overlaps,
    chances: Chances,
    transforms: FloatArray,
    block: IntArray,
) -> tuple[FloatArray, IntArray]:
    """Return poses (N, 4, 4), and the block of each, by joining the two blocks that are surest to fit, repeatedly.

    Blocks (N,) are those that are joined already, at the poses given.
    """
    transforms, block = transforms.copy(), block.copy()
    probable = {pair: np.flatnonzero(own >= PROPOSED_CHANCE) for pair, own in chances.items()}
    proposed = {
        pair: (overlaps[pair][own], chances[pair][own])
        for pair, own in probable.items()
        if len(own)
    }
    known: dict[tuple[int, int], tuple[float, FloatArray]] = {}
    while True:
        blocks = ((int(block[i]), int(block[j])) for i, j in proposed)
        between = {(min(two), max(two)) for two in blocks if two[0] != two[1]}
        for two in sorted(between - known.keys()):
            ends = np.flatnonzero(block == two[0]), np.flatnonzero(block == two[1])
            known[two] = _best_place(surfaces, proposed, transforms, *ends)
        best = max(sorted(between), key=lambda two: known[two][0], default=None)
        if best is None or known[best][0] < _weight(JOINING_CHANCE):
            return transforms, block
        members = block == best[1]
        transforms[members] = known[best][1] @ transforms[members]
        block[members] = best[0]
        known = {two: place for two, place in known.items() if not {*two} & {*best}}


def _best_place(
    surfaces: Mapping[int, LocalSurface],
    proposed: Mapping[tuple[int, int], tuple[LocalPoses, FloatArray]],
    transforms: FloatArray,
    others: IntArray,
    members: IntArray,
) -> tuple[float, FloatArray]:
    """Return how sure the best place of the members among the others is, and the move there (4, 4).

    Places that are too unsure to join them are not compared: 0 and no move where all are.
    """
    asked = _moves(proposed, transforms, {*members.tolist()}, {*others.tolist()})
    middle = _middle(surfaces, transforms, members)
    best = (0.0, np.eye(4))
    for weight, move in _places(asked, middle, _cell(surfaces)):
        enough = max(best[0], _weight(JOINING_CHANCE))
        if weight < enough:
            break
        moved = transforms.copy()
        moved[members] = move @ moved[members]
        sure = weight - _contradictions(surfaces, moved, others, members, most=weight - enough)
        if sure > best[0]:
            best = sure, move
    return best


def _agreeing(
    surfaces: Mapping[int, LocalSurface],
    overlaps: Overlaps,
    chances: Chances,
    transforms: FloatArray,
) -> Overlaps:
    """Return the pairs whose likeliest pose is probable and agrees with the common poses, with this pose."""
    found = {}
    for (i, j), poses in overlaps.items():
        best = int(np.argmax(chances[i, j]))
        likeliest = poses[[best]]
        same = _same_poses(likeliest, transforms[i], transforms[j], surfaces[j])
        if same[0] and chances[i, j][best] >= JOINING_CHANCE:
            found[i, j] = likeliest
    return found


def _refined(
    surfaces: Mapping[int, LocalSurface], pairs: Sequence[tuple[int, int]], transforms: FloatArray
) -> FloatArray:
    """Refine all poses together: points to planes over all pairs that overlap, trimmed, Gauss-Newton."""
    rotations, shifts, cell = transforms[:, :3, :3], transforms[:, :3, 3], _cell(surfaces)
    num = len(transforms)
    samples = {
        i: slice(None, None, -(-len(one.points) // JOINT_POINTS)) for i, one in surfaces.items()
    }
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
        corrections = rotations_by(steps[:, :3])
        shifts = (corrections @ shifts[:, :, None])[:, :, 0] + steps[:, 3:]
        rotations = corrections @ rotations
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
    distances, nearest = target.tree.query(
        (placed - shifts[a]) @ rotations[a], distance_upper_bound=reach
    )
    near = np.flatnonzero(np.isfinite(distances))
    planes = target.normals[nearest[near]] @ rotations[a].T
    near = near[(planes * normals[near]).sum(axis=1) > STEP_COSINE]
    planes = target.normals[nearest[near]] @ rotations[a].T
    feet = target.points[nearest[near]] @ rotations[a].T + shifts[a]
    rows = np.concatenate([np.cross(placed[near], planes), planes], axis=1)
    return rows, ((feet - placed[near]) * planes).sum(axis=1)


def weak_cuts(
    surfaces: Mapping[int, LocalSurface],
    overlaps: Overlaps,
    chances: Chances,
    agreeing: Overlaps,
    transforms: FloatArray,
) -> list[WeakCut]:
    """Return the weakest cut between every two shapes that hang together (a tree of them: Gomory and Hu 1961).

    Transforms have shape (N, 4, 4).
    """
    num, cell = len(transforms), _cell(surfaces)
    graph = _held_together(num, agreeing)
    for i, j in agreeing:
        same = _same_poses(overlaps[i, j], transforms[i], transforms[j], surfaces[j])
        graph[i][j]["capacity"] = _weight(float(chances[i, j][same].sum()))
    # Improbable poses do not add up: what makes one pair err, such as a symmetry, makes many.
    elsewhere = {}
    for (i, j), poses in overlaps.items():
        same = _same_poses(poses, transforms[i], transforms[j], surfaces[j])
        asking = np.flatnonzero(~same & (chances[i, j] >= JOINING_CHANCE))
        elsewhere[i, j] = poses[asking], chances[i, j][asking]
    cuts = []
    for part in map(sorted, nx.connected_components(graph)):
        tree = nx.gomory_hu_tree(graph.subgraph(part)) if len(part) > 1 else nx.Graph()
        for a, b in sorted(tree.edges):
            side = nx.Graph(tree)
            side.remove_edge(a, b)
            halves = sorted(
                (sorted(half) for half in nx.connected_components(side)), key=lambda h: (len(h), h)
            )
            members, others = (np.array(half) for half in halves)
            across = [
                graph[i][j]["capacity"]
                for i in halves[0]
                for j in halves[1]
                if graph.has_edge(i, j)
            ]
            held = float(_together(np.array(across)))
            held -= _contradictions(surfaces, transforms, members, others)
            asked = _moves(elsewhere, transforms, {*halves[0]}, {*halves[1]})
            middle = _middle(surfaces, transforms, members)
            against, move = 0.0, np.eye(4)
            for weight, other in _places(asked, middle, cell)[:1]:
                moved = transforms.copy()
                moved[members] = other @ moved[members]
                move = other
                against = weight - _contradictions(surfaces, moved, members, others)
            cuts.append(
                WeakCut(ends=(a, b), members=members, held=held, against=against, move=move)
            )
    return cuts


def _contradictions(
    surfaces: Mapping[int, LocalSurface],
    transforms: FloatArray,
    members: IntArray,
    others: IntArray,
    most: float = np.inf,
) -> float:
    """Return the log-odds against poses (N, 4, 4): what of some shapes is in front of what was seen of others.

    As soon as those of some pairs exceed ``most``, they are returned, and the other pairs are left out.
    """
    found: list[float] = []
    for i, j in itertools.product(members.tolist(), others.tolist()):
        if surfaces[i].depth_images or surfaces[j].depth_images:
            relative = np.linalg.inv(transforms[i]) @ transforms[j]
            in_front, beside = sight_conflicts(
                surfaces[i], surfaces[j], relative[None, :3, :3], relative[None, :3, 3]
            )
            # A scan that lacks a part has others' points beside it, but none of its own beside theirs.
            mutual = beside.min(axis=1, keepdims=True)
            found.append(float(conflict_log_odds(in_front, np.broadcast_to(mutual, (1, 2)))[0]))
            if found[-1] > 0.0 and _together(np.array(found)) > most:
                break
    return float(_together(np.array(found))) if found else 0.0


def _held_together(num: int, pairs: Iterable[tuple[int, int]]) -> nx.Graph:
    """Return the graph of all shapes and some pairs."""
    graph = nx.Graph()
    graph.add_nodes_from(range(num))
    graph.add_edges_from(pairs)
    return graph


def _same_poses(
    poses: LocalPoses, target: FloatArray, source: FloatArray, surface: LocalSurface
) -> BoolArray:
    """Return which poses of a pair agree with those of its two shapes (4, 4), also in where the source lies."""
    relative, middle = np.linalg.inv(target) @ source, surface.points.mean(axis=0)
    agree = pose_angle_deg(poses.rotations, relative[:3, :3]) < CONSISTENT_DEG
    moved = np.linalg.norm(
        poses.rotations @ middle + poses.shifts - moved_by(relative, middle), axis=1
    )
    return np.asarray(agree & (moved < CONSISTENT_CELLS * surface.cell))


def _weight(chance: float) -> float:
    return -float(np.log1p(-min(chance, MOST_CERTAIN)))


def _cell(surfaces: Mapping[int, LocalSurface]) -> float:
    return next(iter(surfaces.values())).cell


def _middle(
    surfaces: Mapping[int, LocalSurface], transforms: FloatArray, members: IntArray
) -> FloatArray:
    """Return the middle (3,) of some shapes."""
    return np.mean(
        [moved_by(transforms[i], surfaces[i].points.mean(axis=0)) for i in members], axis=0
    )


def _together(weights: FloatArray) -> FloatArray:
    """Return what weights (..., n) of pairs that agree amount to, shape (...)."""
    return np.asarray(
        (1.0 - SHARED_CAUSE) * weights.max(axis=-1) + SHARED_CAUSE * weights.sum(axis=-1)
    )


def _moves(
    proposed: Mapping[tuple[int, int], tuple[LocalPoses, FloatArray]],
    transforms: FloatArray,
    members: set[int],
    others: set[int],
) -> list[tuple[float, FloatArray]]:
    """Return the weight and the move (4, 4) of the members that each pose of a pair with an other one asks for."""
    asked = []
    for (i, j), (poses, chances) in proposed.items():
        if (i in members and j in others) or (i in others and j in members):
            relative = np.tile(np.eye(4), (len(poses), 1, 1))
            relative[:, :3, :3], relative[:, :3, 3] = poses.rotations, poses.shifts
            for pose, chance in zip(relative, chances, strict=True):
                move = transforms[i] @ pose @ np.linalg.inv(transforms[j])
                asked.append(
                    (_weight(float(chance)), move if j in members else np.linalg.inv(move))
                )
    return asked


def _places(
    asked: Sequence[tuple[float, FloatArray]], middle: FloatArray, cell: float
) -> list[tuple[float, FloatArray]]:
    """Return distinct moves with what all moves near each amount to, less of the farther ones, the largest first."""
    if not asked:
        return []
    weights, moves = (
        np.array([weight for weight, _ in asked]),
        np.stack([move for _, move in asked]),
    )
    middles = moves[:, :3, :3] @ middle + moves[:, :3, 3]
    angles = pose_angle_deg(moves[:, None, :3, :3], moves[None, :, :3, :3]) / (2.0 * CONSISTENT_DEG)
    gaps = np.linalg.norm(middles[:, None] - middles, axis=2) / (2.0 * CONSISTENT_CELLS * cell)
    near = (angles < 1.0) & (gaps < 1.0)
    # Less of what lies farther off: a stray one beside the right ones would count as much as these.
    total = _together(np.where(near, (1.0 - angles**2) * (1.0 - gaps**2), 0.0) * weights)
    kept: list[int] = []
    for p in np.argsort(-total, kind="stable").tolist():
        if not near[p, kept].any():
            kept.append(p)
    return [(float(total[p]), moves[p]) for p in kept]


def _confidence(num: int, cuts: Sequence[WeakCut], parts: Sequence[IntArray]) -> FloatArray:
    """Return the chance that no cut between a shape and the best held one of its part is wrong, shape (N,)."""
    tree = nx.Graph()
    tree.add_nodes_from(range(num))
    for cut in cuts:
        tree.add_edge(*cut.ends, margin=max(cut.held - max(cut.against, 0.0), 0.0))
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
