"""Poses incomplete shapes on the complete ones, which stay exactly as they are without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from collalign.confidence.candidate_model import LEAST_MISMATCH
from collalign.confidence.incomplete_model import is_other_body, is_unlike, log_odds
from collalign.confidence.pose_model import resembles_none
from collalign.engine.records import Record
from collalign.options import AlignSession
from collalign.products.consistent_maps import VertexMaps
from collalign.products.pair import MAX_ALTERNATIVES, AlignedPair, Alternative
from collalign.products.shapes import STRANGER, Constraints, Incomplete, Shapes
from collalign.products.trust import KINDS, LOCAL_MISFIT, MISMATCH, UNCERTAIN, Trust
from collalign.stages.incomplete.place import nearest_labels, place_shape, pose_chance
from collalign.stages.incomplete.posed_points import prepare_points
from collalign.stages.poses.placement import common_positions
from collalign.stages.steps import Posed, Run
from collalign.stages.trust.trust_notes import strange_note
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.notes import Note
from data_tools.poses import AGREE_DEG, pose_angle_deg
from pairwise.results import Status

#: Complete shapes that an incomplete one is posed on, those that are not uncertain first.
MAX_COMPLETE_PARTNERS = 8


def with_incomplete(run: Run, complete: Posed, reasons: Mapping[int, str]) -> Posed:
    """Return the poses of all shapes: the incomplete ones are posed on the complete ones, which stay as they are.

    The run is that of all shapes, its group decided; ``complete`` holds the others in their order, and ``reasons``
    why shapes count as incomplete, by their positions among all.
    """
    shapes = run.shapes
    at = np.array([i for i in range(len(shapes.names)) if i not in reasons])
    chosen = _partners(shapes.some(at.tolist()), complete, np.arange(len(at)))
    partners = at[chosen]
    with run.stage("incomplete shapes"):
        found = place_on(
            run.session,
            shapes,
            sorted(reasons),
            partners,
            complete.transforms[chosen],
            run.constraints,
        )
    return _merged(run, complete, at, found, reasons, partners)


def chances_as_parts(run: Run, posed: Posed, doubtful: Sequence[int]) -> dict[int, float]:
    """Return what would be stated of some posed shapes if they were posed on the others as parts, by position.

    It is 0 where the largest part has no other shapes.
    """
    others = np.setdiff1d(np.arange(len(run.shapes.names)), doubtful)
    partners = _partners(run.shapes, posed, others)
    if not len(partners):
        return dict.fromkeys(doubtful, 0.0)
    found = place_on(
        run.session, run.shapes, doubtful, partners, posed.transforms[partners], run.constraints
    )
    most = _mean_confidence(posed.solution.confidence, partners)
    return {
        i: _stated(pose_chance(record), most, in_doubt=lies_elsewhere(record))
        for i, record in found.items()
    }


def _stated(chance: float, most: float, *, in_doubt: bool) -> float:
    """Return what is stated of a shape that was posed as a part: half where it may be none, and at most ``most``."""
    return min(0.5 * chance if in_doubt else chance, most)


def lies_elsewhere(record: Record) -> bool:
    """Return whether nothing tells that a piece is a part of the shapes that it was posed on."""
    excess = float(np.asarray(record["evidence"])[1, 0])
    return is_unlike(float(record["mismatch"]), float(record["likeness"]), excess)


def place_on(
    session: AlignSession,
    shapes: Shapes,
    chosen: Sequence[int],
    partners: IntArray,
    transforms: FloatArray,
    constraints: Constraints,
) -> dict[int, Record]:
    """Return what :func:`place_shape` finds for some shapes on partners (n,) that lie at transforms (n, 4, 4)."""
    surfaces = prepare_points(session, shapes, sorted({*chosen, *partners.tolist()}))
    tasks = {}
    for i in chosen:
        others = partners != i
        tasks[i] = {
            "source": surfaces.shared(i),
            "partners": tuple(surfaces.shared(j) for j in partners[others].tolist()),
            "transforms": transforms[others],
            "group": session.options.group,
            "estimate_scale": session.options.scaling == "similarity",
            "fixed": constraints.fixed.get(i),
            "fixed_transform": constraints.fixed_transforms.get(i),
        }
    return session.map_parallel("incomplete shapes", place_shape, tasks)


def _partners(shapes: Shapes, posed: Posed, others: IntArray) -> IntArray:
    """Return those of some shapes (m,), by position, that further ones are posed on: sure ones, by content."""
    part, confidence = max(posed.solution.parts, key=len), posed.solution.confidence
    order = sorted(
        np.intersect1d(part, others).tolist(),
        key=lambda i: (not confidence[i] >= UNCERTAIN, shapes.keys[i]),
    )
    return np.array(sorted(order[:MAX_COMPLETE_PARTNERS]), dtype=np.int64)


def _mean_confidence(confidence: FloatArray, partners: IntArray) -> float:
    """Return how sure the shapes are that one lies on: its pose is no surer. One other shape alone sets the frame."""
    return float(confidence[partners].mean()) if len(partners) > 1 else 1.0


def _merged(
    run: Run,
    complete: Posed,
    at: IntArray,
    found: Mapping[int, Record],
    reasons: Mapping[int, str],
    partners: IntArray,
) -> Posed:
    """Return the poses of all shapes, in the order of the folder; fixed transforms stay to the bit."""
    names, solution = run.shapes.names, complete.solution
    num = len(names)
    transforms, rotations = np.tile(np.eye(4), (num, 1, 1)), np.tile(np.eye(3), (num, 1, 1))
    confidence, limited_by = np.full(num, np.nan), [""] * num
    alternatives: list[tuple[Alternative, ...]] = [()] * num
    labels = np.full((num, complete.labels.shape[1]), -1, dtype=np.int64)
    transforms[at], rotations[at] = complete.transforms, complete.rotations
    confidence[at], labels[at] = solution.confidence, complete.labels
    for c, i in enumerate(at):
        alternatives[i] = solution.alternatives[c]
        limited_by[i] = complete.limited_by[c] if complete.limited_by else ""
    mismatches = {i: float(record["mismatch"]) for i, record in found.items()}
    strange = _strange(_trust(complete.trust, at, num, mismatches), found)
    trust = _trust(
        complete.trust, at, num, {i: mismatch for i, mismatch in mismatches.items() if i in strange}
    )
    for i, record in found.items():
        rotations[i] = record["rotations"][0]
        transforms[i] = run.constraints.fixed_transforms.get(i, record["transforms"][0])
        may_be_stranger = i in strange or lies_elsewhere(record)
        chance = pose_chance(record)
        most = _mean_confidence(confidence, partners[partners != i])
        confidence[i] = _stated(chance, most, in_doubt=may_be_stranger)
        if may_be_stranger:
            limited_by[i] = "no-relative"
        elif confidence[i] < chance:
            limited_by[i] = "partners"
        alternatives[i] = incomplete_alternatives(record, transforms[i])
        placed = common_positions([run.shapes.samples[i]], transforms[i][None])[0]
        labels[i] = nearest_labels(placed, complete.consensus)
    pairs = [
        replace(pair, target=int(at[pair.target]), source=int(at[pair.source]))
        for pair in complete.pairs
    ]
    for i, record in found.items():
        pairs.extend(incomplete_pairs(i, record, partners[partners != i], rotations, labels))
    parts = [at[part] for part in solution.parts]
    largest = max(range(len(parts)), key=lambda n: len(parts[n]))
    parts[largest] = np.sort(
        np.concatenate([parts[largest], np.array(sorted(found), dtype=np.int64)])
    )
    incomplete = tuple(
        incomplete_record(
            i, record, STRANGER if i in strange else reasons[i], partners[partners != i]
        )
        for i, record in found.items()
    )
    parts_only = [one for one in incomplete if not one.is_stranger]
    notes = [incomplete_note(names, parts_only)] if parts_only else []
    if trust is not None:
        notes += strange_note(names, trust, [one.shape for one in incomplete if one.is_stranger])
    return replace(
        complete,
        pairs=pairs,
        solution=replace(
            solution, confidence=confidence, alternatives=tuple(alternatives), parts=tuple(parts)
        ),
        limited_by=tuple(limited_by),
        rotations=rotations,
        transforms=transforms,
        labels=labels,
        notes=(*complete.notes, *notes),
        trust=trust,
        side_chances={int(at[c]): chance for c, chance in complete.side_chances.items()},
        vertices=_vertex_maps(complete.vertices, [names[i] for i in found]),
        incomplete=incomplete,
    )


def _strange(judged: Trust | None, found: Mapping[int, Record]) -> set[int]:
    """Return which of the incomplete shapes resemble no other one, by the evidence of all shapes."""
    if judged is None:
        return set()
    resemble_none, misfits = resembles_none(judged.evidence), judged.evidence[:, LOCAL_MISFIT]
    return {
        i
        for i, record in found.items()
        if resemble_none[i]
        or is_other_body(
            float(np.mean(np.asarray(record["overlaps"])[:, 0])),
            float(record["on_rim"]),
            float(misfits[i]),
        )
    }


def _vertex_maps(maps: VertexMaps | None, without: Sequence[str]) -> VertexMaps | None:
    """Return the maps of the complete shapes' vertices, which say that the others have none."""
    if maps is None:
        return None
    return replace(maps, left_out=(*maps.left_out, *((name, "incomplete") for name in without)))


def incomplete_record(i: int, record: Record, reason: str, partners: IntArray) -> Incomplete:
    """Return what is known of an incomplete shape on its partners, shape (n,)."""
    return Incomplete(
        shape=i,
        reason=reason,
        partners=read_only(partners),
        overlaps=read_only(np.array(record["overlaps"])),
        beyond=record["beyond"],
    )


def incomplete_alternatives(record: Record, transform: FloatArray) -> tuple[Alternative, ...]:
    """Return the rivals of a pose, the likeliest first, in the frame in which it is ``transform`` (4, 4)."""
    apart = pose_angle_deg(record["rotations"], record["rotations"][0]) > AGREE_DEG
    odds = log_odds(record["evidence"])
    poses = transform @ np.linalg.inv(record["transforms"][0]) @ record["transforms"]
    return tuple(
        Alternative(
            rotation=read_only(record["rotations"][m]),
            log_odds=float(odds[0] - odds[m]),
            transform=read_only(poses[m]),
        )
        for m in np.flatnonzero(apart)[:MAX_ALTERNATIVES]
    )


def incomplete_pairs(
    i: int, record: Record, partners: IntArray, rotations: FloatArray, labels: IntArray
) -> list[AlignedPair]:
    """Return the pairs of an incomplete shape: how each partner likes its poses, and the map at the common ones.

    Partners have shape (n,), rotations ``R_common_shape`` (N, 3, 3) and labels (N, k).
    """
    pairs = []
    for n, partner in enumerate(partners.tolist()):
        first, second = min(i, partner), max(i, partner)
        asked = rotations[partner].T @ np.asarray(record["rotations"])
        asked = asked if second == i else np.swapaxes(asked, 1, 2)
        energies = np.asarray(record["energies"])[:, n]
        pairs.append(aligned_pair((first, second), asked, energies, rotations, labels))
    return pairs


def aligned_pair(
    ends: tuple[int, int],
    asked: FloatArray,
    energies: FloatArray,
    rotations: FloatArray,
    labels: IntArray,
) -> AlignedPair:
    """Return a pair of shapes, one of which is a part, with poses (m, 3, 3) of energies (m,), at the common ones.

    It agrees where its pose of least energy does. Rotations are ``R_common_shape`` (N, 3, 3), labels (N, k).
    """
    target, source = ends
    order = np.argsort(energies, kind="stable")
    angles = pose_angle_deg(asked[order], rotations[target].T @ rotations[source])
    agrees = bool(angles[0] <= AGREE_DEG)
    return AlignedPair(
        target=target,
        source=source,
        rotations=read_only(np.ascontiguousarray(asked[order])),
        maps=read_only(np.full((len(order), labels.shape[1]), -1)),
        energies=read_only(energies[order]),
        how="part",
        status=Status.LOCAL_OPTIMUM.name,
        choice=0 if agrees else -1,
        inlier=agrees,
        disagreement_deg=float(angles[0]),
        map_target_source=read_only(label_map(labels[target], labels[source])),
        energy=float(energies[order[0]]),
    )


def label_map(target: IntArray, source: IntArray) -> IntArray:
    """Return the sample of the target with the label of each of the source's, all (k,); -1 where there is none."""
    inverse = np.full(int(max(target.max(), source.max())) + 2, -1, dtype=np.int64)
    inverse[target[target >= 0]] = np.flatnonzero(target >= 0)
    return np.where(source >= 0, inverse[source], -1)


def _trust(
    trust: Trust | None, at: IntArray, num: int, mismatches: Mapping[int, float]
) -> Trust | None:
    """Return the evidence of all shapes; of the incomplete ones none but mismatches that are given, by position."""
    if trust is None:
        return None
    position = {int(i): c for c, i in enumerate(at)}
    none, nothing = read_only(np.zeros((0, 3, 3))), read_only(np.zeros(0))

    def rows(known: FloatArray) -> FloatArray:
        spread = np.full((num, len(KINDS)), np.nan)
        spread[at] = known
        complete = known[~np.isnan(known[:, MISMATCH]), MISMATCH]
        usual = float(np.log(np.median(complete) + LEAST_MISMATCH)) if len(complete) else np.nan
        for i, mismatch in mismatches.items():
            spread[i, [MISMATCH, LOCAL_MISFIT]] = (
                mismatch,
                np.log(mismatch + LEAST_MISMATCH) - usual,
            )
        return read_only(spread)

    def each(known: Sequence[FloatArray], other: FloatArray) -> tuple[FloatArray, ...]:
        return tuple(known[position[i]] if i in position else other for i in range(num))

    return Trust(
        evidence=rows(trust.evidence),
        rivals=each(trust.rivals, none),
        excess=each(trust.excess, nothing),
        local_excess=each(trust.local_excess, nothing),
        leads=each(trust.leads, nothing),
        symmetries=each(trust.symmetries, none),
        up_to_symmetry=rows(trust.up_to_symmetry),
    )


def incomplete_note(names: Sequence[str], incomplete: Sequence[Incomplete]) -> Note:
    """Return the note that names the incomplete shapes, why each is one, and how much of the others it covers."""
    return Note(
        "all-incomplete" if len(incomplete) == len(names) else "incomplete",
        tuple(names[one.shape] for one in incomplete),
        {
            "reasons": tuple(one.reason for one in incomplete),
            "coverages": tuple(float(one.coverage) for one in incomplete),
        },
    )
