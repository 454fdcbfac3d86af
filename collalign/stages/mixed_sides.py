"""Notices by itself whether a collection mixes left and right specimens (``group="auto"``).

Surfaces are asked first: where the chirality of each by itself names two sides, shapes may be mirrored. Else some
pairs of similar shapes are matched with mirror images, a pilot, which costs little more than without and gives the
best pose of either kind. Only where these few leave the suspicion of two sides, more pairs are. Shapes are mirrored
if both agree on two sides (:mod:`collalign.confidence.side_model`): bilateral shapes that bend, or that are nearly
bilateral, prefer mirror images as well. If the run goes on with mirror images, the pilot's pairs are among its own,
unless the collection is so large that the pilot looked at a part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np

from collalign.confidence.side_model import (
    MIN_SHAPES_FOR_SIDES,
    Sides,
    SurfaceSides,
    are_bilateral,
    are_mixed,
    are_one_kind,
    find_sides,
    lie_in_one_place,
    look_like_posture,
    surface_sides,
    undecided_sides,
)
from collalign.engine.job import Shared, table_of_values
from collalign.options import AlignSession
from collalign.products.pair import AlignedPair, FormerPairs, Pair
from collalign.products.shapes import Shapes
from collalign.stages.choose_pairs import all_pairs
from collalign.stages.match_pairs import match_pairs
from collalign.stages.self_symmetry import mirrored_costs
from collalign.stages.shape_stage import MOST_FOR_SIDES, measure_surfaces
from collalign.whole_pairs.local_evidence import surface_gap, surface_points
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.embedding.chirality import chirality_scores, place_shares
from data_tools.embedding.embedding import Samples
from data_tools.notes import Note
from pairwise.dense import DensePoints
from pairwise.surface_fit import fit_surfaces

#: Of the pilot's looks, the first one and that where it leaves a suspicion: nearest partners of each shape, poses
#: of either kind of their pairs that are refined on dense samples, and by how many steps at most.
LOOKS = ((2, 1, 4), (6, 3, 15))
#: Of several poses of a kind, the one that fits best after so many steps is refined to the end.
FIRST_STEPS = 4
#: Chance that the side of a pose is right whose mirror image is as likely, or if one place of each surface tells it;
#: and of those of a folder so small that surfaces alone named the sides. Confidences are multiplied by it.
ONE_OF_TWO, OF_FEW = 0.5, 0.8
#: Codes of notes that say that both sides are there, and that fits showed it; and of all that are about mixed sides.
MIXED, BY_FIT = "left-right-mixed", "sides-by-fit"
ABOUT_MIXED = {MIXED, BY_FIT, "sides-by-surface", "sides-in-one-place", "few-for-sides"}
#: The group; notes that say why, none where the user decided; and the chance that the side of a shape is right, where
#: that is in doubt, by position.
GroupChoice: TypeAlias = tuple[Literal["SO", "O"], tuple[Note, ...], Mapping[int, float]]


def decide_group(
    session: AlignSession,
    shapes: Shapes,
    descriptors: FloatArray,
    edges: IntArray,
    *,
    former: FormerPairs | None = None,
    any_mirrored: bool = False,
) -> GroupChoice:
    """Return the group asked for, or with "auto" that of the earlier run, of the fixed poses, or of the shapes.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    descriptors : ndarray, shape (N, m)
        Similar shapes have similar ones; mirror images have the same.
    edges : ndarray of int, shape (E, 2)
        The pairs that the run will match.
    former : FormerPairs, optional
        What an earlier run matched; its group stays.
    any_mirrored : bool
        Whether a pose that was given mirrors its shape.
    """
    if session.options.group != "auto":
        return session.options.group, (), {}
    if former is not None and former.group == "O":
        return "O", (Note("reflected-as-before"),), {}
    if any_mirrored:
        return "O", (Note("reflected-by-given-pose"),), {}
    group, notes, limits = group_of_shapes(session, shapes, descriptors, edges)
    if former is None or group == "SO":
        return group, notes, limits
    return "SO", (Note("added-not-reflected"), *notes), limits


def group_of_shapes(
    session: AlignSession, shapes: Shapes, descriptors: FloatArray, edges: IntArray
) -> GroupChoice:
    """Decide whether shapes may be mirrored, from their surfaces and from some pairs matched with mirror images.

    Parameters
    ----------
    session, shapes
    descriptors : ndarray, shape (N, m)
    edges : ndarray of int, shape (E, 2)
        All as for :func:`decide_group`.
    """
    num = len(shapes.names)
    if num > MOST_FOR_SIDES:
        some, chosen = _evenly_spaced(shapes, MOST_FOR_SIDES)
        group, notes, limits = group_of_shapes(
            session, some, descriptors[chosen], all_pairs(MOST_FOR_SIDES)
        )
        notes = (*notes, Note("sides-sampled", values={"num": MOST_FOR_SIDES, "total": num}))
        return group, notes, {int(chosen[i]): limit for i, limit in limits.items()}
    measured = measure_surfaces(session, shapes)
    scores = chirality_scores(measured)
    alone = surface_sides(scores)
    if alone.are_clear:
        in_one_place = lie_in_one_place(place_shares(measured, alone.mirrored))
        return _choice_of_surfaces(alone, shapes.names, in_one_place)
    both_kinds = replace(session, options=replace(session.options, group="O"))

    pilot: list[Pair] = []

    def energies_of(
        nearest: IntArray, num_poses: int, max_steps: int
    ) -> tuple[list[tuple[int, int]], FloatArray]:
        pairs, _ = match_pairs(both_kinds, shapes, nearest)
        pilot[:] = pairs
        tasks = {
            (pair.target, pair.source): {
                "pair": pair,
                "target": samples[pair.target],
                "source": samples[pair.source],
                "num_poses": num_poses,
                "max_steps": max_steps,
            }
            for pair in pairs
        }
        found = session.map_parallel("mirror images", chirality_energies, tasks, shared=table)
        return list(tasks), np.array([found[pair] for pair in tasks])

    samples = [Shared(key=str(i), reader=Samples) for i in range(num)]
    with table_of_values(shapes.samples) as table:
        sides, compared, energies = staged_sides(edges, descriptors, energies_of)
    surfaces = surface_sides(scores, sides.mirrored)
    if are_mixed(sides, surfaces) and not _are_bilateral(
        session, shapes, np.flatnonzero(sides.mirrored), pilot
    ):
        undecided = np.flatnonzero(sides.unsure).tolist()
        return "O", _notes_of_both(sides, shapes.names), dict.fromkeys(undecided, ONE_OF_TWO)
    one_kind = are_one_kind(alone.mirrored, compared, energies)
    doubted = undecided_sides(sides, surfaces, alone, one_kind=one_kind)
    doubted &= not _are_bilateral(session, shapes, np.flatnonzero(doubted), pilot)
    num_better = int((energies[:, 1] < energies[:, 0]).sum())
    note = _note_of_none(sides, surfaces, doubted, num_better, shapes.names)
    return "SO", (note,), dict.fromkeys(np.flatnonzero(doubted).tolist(), ONE_OF_TWO)


def _are_bilateral(
    session: AlignSession, shapes: Shapes, chosen: IntArray, pairs: Sequence[Pair]
) -> bool:
    """Return whether most of some shapes (n,) are nearly their own mirror images, by the pairs that they are in."""
    of_shapes = {
        i: own
        for i in chosen.tolist()
        if (own := [pair for pair in pairs if i in (pair.target, pair.source)])
    }
    if not of_shapes:
        return False
    needed = sorted({i for own in of_shapes.values() for p in own for i in (p.target, p.source)})
    shared = {i: Shared(key=str(at), reader=Samples) for at, i in enumerate(needed)}
    with table_of_values([shapes.samples[i] for i in needed]) as table:
        mirrored = session.map_parallel(
            "mirror images",
            mirrored_costs,
            {i: {"samples": shared[i]} for i in of_shapes},
            shared=table,
        )
        others = session.map_parallel(
            "mirror images",
            pair_costs,
            {
                (p.target, p.source): {
                    "pair": p,
                    "target": shared[p.target],
                    "source": shared[p.source],
                }
                for own in of_shapes.values()
                for p in own
            },
            shared=table,
        )
    costs = [
        np.mean([others[p.target, p.source] for p in own], axis=0) for own in of_shapes.values()
    ]
    return are_bilateral(np.array([mirrored[i] for i in of_shapes]), np.array(costs))


def pair_costs(pair: Pair, target: Samples, source: Samples) -> tuple[float, float]:
    """Return the least gap and the least mismatch of a pair's poses; runs inside a worker."""
    gaps = surface_gap(
        surface_points(target, first=1), surface_points(source, first=0), pair.rotations[:, :3, :3]
    )
    return float(gaps.min()), float(pair.mismatches.min()) if len(pair.mismatches) else np.nan


def staged_sides(
    edges: IntArray,
    descriptors: FloatArray,
    energies_of: Callable[[IntArray, int, int], tuple[list[tuple[int, int]], FloatArray]],
) -> tuple[Sides, IntArray, FloatArray]:
    """Find the sides that few pairs show, or where these leave a suspicion, more.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
        Pairs that may be compared.
    descriptors : ndarray, shape (N, m)
    energies_of : callable
        Compares some pairs, as :data:`LOOKS` says: those that it could, and their energies (e, 2) as they are and
        mirrored.

    Returns
    -------
    sides : Sides
    pairs : ndarray of int, shape (e, 2)
        That they were found in.
    energies : ndarray, shape (e, 2)
        Of these pairs, as they are and mirrored.
    """
    num = len(descriptors)
    for num_partners, num_poses, max_steps in LOOKS:
        pairs, energies = energies_of(
            nearest_pairs(edges, descriptors, num_partners), num_poses, max_steps
        )
        sides = find_sides(pairs, energies, num)
        if num < MIN_SHAPES_FOR_SIDES or not sides.are_suspected or sides.are_obvious:
            break
    return sides, np.array(pairs, dtype=np.int64).reshape(-1, 2), energies


def _evenly_spaced(shapes: Shapes, num: int) -> tuple[Shapes, IntArray]:
    """Return so many of the shapes, evenly spaced in their order, and their positions."""
    chosen = np.linspace(0, len(shapes.names) - 1, num).round().astype(np.int64)
    return shapes.some(chosen.tolist()), chosen


def nearest_pairs(edges: IntArray, descriptors: FloatArray, num_partners: int) -> IntArray:
    """Return those of the pairs that join a shape to one of its nearest partners.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    descriptors : ndarray, shape (N, m)
    num_partners : int
        Per shape, among those that it is paired with.
    """
    lengths = np.linalg.norm(descriptors[edges[:, 0]] - descriptors[edges[:, 1]], axis=1)
    order = np.argsort(lengths, kind="stable")
    taken = np.zeros(len(descriptors), dtype=np.int64)
    kept = np.zeros(len(edges), dtype=np.bool_)
    for e in order:
        i, j = edges[e]
        kept[e] = min(taken[i], taken[j]) < num_partners
        taken[[i, j]] += 1
    return edges[kept]


def chirality_energies(
    pair: Pair, target: Samples, source: Samples, num_poses: int, max_steps: int
) -> tuple[float, float]:
    """Return the least energy of a pair's poses of determinant +1, and of -1, NaN for none; runs in a worker.

    Where the shapes have dense samples, the best poses of either kind are refined and measured on these: the energies
    of few samples are mostly due to where on the surfaces the samples happen to lie.

    Parameters
    ----------
    pair : Pair
    target, source : Samples
        The pair's shapes.
    num_poses, max_steps : int
        Poses of either kind that are refined, and steps of each at most.
    """
    rotations, energies = pair.rotations[:, :3, :3], pair.energies
    best = [np.flatnonzero(np.linalg.det(rotations) * sign > 0)[:num_poses] for sign in (1, -1)]
    if min(len(target.dense_positions), len(source.dense_positions)) > 1:
        to, of = (DensePoints.from_user(samples.dense_positions) for samples in (target, source))
        plain, mirrored = (_least_energy(to, of, rotations[poses], max_steps) for poses in best)
    else:
        plain, mirrored = (float(energies[poses].min()) if len(poses) else np.nan for poses in best)
    return plain, mirrored


def _least_energy(
    target: DensePoints, source: DensePoints, rotations: FloatArray, max_steps: int
) -> float:
    """Return the least energy of poses (m, 3, 3) that are refined, the one that leads after some steps to the end."""
    if not len(rotations):
        return np.nan
    fit = partial(fit_surfaces, target, source, find_shared=False)
    tried = [fit(start, max_iterations=FIRST_STEPS) for start in rotations]
    best = min(tried, key=lambda one: one.energy)
    if max_steps <= FIRST_STEPS:
        return best.energy
    further = fit(best.pose.rotation, max_iterations=max_steps - FIRST_STEPS)
    return min(best.energy, further.energy)


def _choice_of_surfaces(
    sides: SurfaceSides, names: tuple[str, ...], in_one_place: bool
) -> GroupChoice:
    """Return the choice where surfaces name the sides alone."""
    notes, most = [_mixed(sides.mirrored, names), Note("sides-by-surface")], 1.0
    if in_one_place:
        most = ONE_OF_TWO
        notes.append(Note("sides-in-one-place", values={"most": most}))
    elif len(names) < MIN_SHAPES_FOR_SIDES:
        most = OF_FEW
        notes.append(Note("few-for-sides", values={"most": most}))
    return "O", tuple(notes), dict.fromkeys(range(len(names)), most) if most < 1.0 else {}


def _notes_of_both(sides: Sides, names: tuple[str, ...]) -> tuple[Note, ...]:
    """Return the notes about sides that fits find and surfaces confirm."""
    numbers = {
        "num_between": int(sides.num_between),
        "factor": float(np.exp(sides.median_between)),
        "contradicted": float(sides.contradicted),
    }
    return _mixed(sides.mirrored, names), Note(BY_FIT, values=numbers)


def sides_of_result(
    notes: Sequence[Note],
    names: Sequence[str],
    pairs: Sequence[AlignedPair],
    reflected: BoolArray,
    limits: Mapping[int, float],
) -> tuple[Note, ...]:
    """Return notes in which those about mixed sides say what the poses say.

    The pilot only decides whether shapes may be reflected; pairs and poses decide which are.

    Parameters
    ----------
    notes : sequence of Note
        As :func:`decide_group` made them, among others.
    names : sequence of str
    pairs : sequence of AlignedPair
    reflected : ndarray of bool, shape (N,)
        By the poses.
    limits : mapping of int to float
        The chances of sides that are in doubt.
    """
    meant = [note for note in notes if note.code == MIXED]
    if not meant:
        return tuple(notes)
    between, preferences = [], []
    for pair in pairs:
        signs = np.sign(np.linalg.det(pair.rotations[:, :3, :3]))
        plain, mirrored = (pair.energies[signs == sign].min(initial=np.inf) for sign in (1, -1))
        if 0.0 < plain < np.inf and 0.0 < mirrored < np.inf:
            between.append(bool(reflected[pair.target] != reflected[pair.source]))
            preferences.append(float(np.log(plain / mirrored)))
    if not 0 < reflected.sum() < len(reflected):
        numbers = {
            "num_better": sum(one > 0 for one in preferences),
            "num_pairs": len(preferences),
            "most": max(limits.values(), default=1.0),
        }
        others = [note for note in notes if note.code not in ABOUT_MIXED]
        return Note("sides-not-confirmed", meant[0].shapes, numbers), *others
    few = reflected if 2 * reflected.sum() <= len(reflected) else ~reflected
    ratios = np.where(between, preferences, np.negative(preferences))
    total = float(np.abs(ratios).sum())
    by_fit = {
        "num_between": int(np.sum(between)),
        "factor": float(np.exp(np.median(ratios[between]))) if any(between) else float("nan"),
        "contradicted": float(np.maximum(-ratios, 0.0).sum() / total) if total else 0.0,
    }
    said = {MIXED: _mixed(few, tuple(names)), BY_FIT: Note(BY_FIT, values=by_fit)}
    return tuple(
        said[note.code] if note.code == MIXED or (note.code == BY_FIT and any(between)) else note
        for note in notes
    )


def _mixed(mirrored: BoolArray, names: tuple[str, ...]) -> Note:
    few = tuple(name for name, is_meant in zip(names, mirrored, strict=True) if is_meant)
    return Note(MIXED, few, {"total": len(names)})


def _note_of_none(
    sides: Sides,
    surfaces: SurfaceSides,
    doubted: BoolArray,
    num_better: int,
    names: tuple[str, ...],
) -> Note:
    """Return the note about shapes that are not mirrored, some of whose sides may be in doubt."""
    evidence = {"num_better": num_better, "num_pairs": int(sides.num_pairs)}
    if doubted.any():
        cause = "surfaces" if surfaces.are_known else "no-outer-side"
        if surfaces.are_known and len(names) < MIN_SHAPES_FOR_SIDES:
            cause = "few-shapes"
        meant = tuple(name for name, is_meant in zip(names, doubted, strict=True) if is_meant)
        return Note("not-reflected-unclear", meant, {**evidence, "cause": cause})
    if look_like_posture(sides, surfaces):
        return Note("not-reflected-posture", values=evidence)
    if len(names) < MIN_SHAPES_FOR_SIDES:
        return Note("not-reflected-few", values={"num": len(names)})
    return Note("not-reflected", values=evidence)
