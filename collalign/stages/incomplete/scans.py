"""Aligns shapes none of which is complete, such as range scans: each on what it shares with its neighbours.

Every pair is matched by what both share, at poses on which neighbourhoods agree, in the units of the files.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from collalign.confidence.overlap_model import hinted_log_odds, overlap_log_odds
from collalign.engine.job import Results
from collalign.products.pair import AlignedPair, Alternative, Pair, median_mismatch
from collalign.products.shapes import Constraints, Incomplete, Shapes
from collalign.products.trust import DOUBT
from collalign.stages.incomplete.add import incomplete_note, label_map
from collalign.stages.incomplete.join import (
    JOINING_CHANCE,
    JoinedScans,
    Overlaps,
    join_scans,
)
from collalign.stages.incomplete.place import nearest_labels
from collalign.stages.incomplete.scan_pairs import (
    common_cell,
    describe_scans,
    overlap_pairs,
    side_known,
)
from collalign.stages.poses.placement import common_positions, with_origin
from collalign.stages.steps import Posed, Run
from collalign.stages.trust.trust_notes import components_left_out
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import CollectionError, InputError
from data_tools.local_surface import LocalSurface, shows_scene
from data_tools.notes import Note
from data_tools.poses import AGREE_DEG, moved_by, pose_angle_deg, scales_of
from data_tools.sight import TUNED
from pairwise.features.overlap import LocalPoses
from pairwise.results import Status

#: Shapes with open borders may be scans where the median pair matches so badly as whole shapes: its neighbourhoods
#: differ by this share of what any two do. Bunny scans and generated views have .84 to .88; molars, planes and chairs
#: .50 to .54, people .70.
BADLY_MATCHED = 0.75
#: Shapes that nobody called scans are scans where so many of them are sure when they are joined by overlaps, and were
#: seen from different directions: the mean of the unit lines of sight is shorter than this. Those of a cone of about
#: 40 degrees to either side have .87, those all around 0.
MOST_SURE, MOST_ALIKE = 0.5, 0.8
#: ... and so many of those that do not match badly as wholes, or were not matched so. Of twelve pianos made of plates
#: seven were joined, of ten scans of a bunny and 15 views of a horse all.
NEARLY_ALL = 0.75
#: A scene is wider than its images: their middles are spread by more than this share of their root mean square
#: radius. Frames of a room have .9, views of a bunny, a horse and a piano .17 to .44, whole shapes less.
LEAST_WIDER = 0.6
#: Overlap alone does not tell a part of the same object from another one that was cut elsewhere: of 33 generated
#: shapes that nothing saw and nobody called scans, most of them bones with an end cut off, such a share was right of
#: those that overlaps state at .9 or more.
OVERLAP_ALONE = 0.67
#: Why shapes count as incomplete that nobody called so.
SCAN = "scan"
#: Scans that are joined: all pairs of them are matched. Fewer are no scans unless somebody says so.
FEWEST_SCANS, MOST_SCANS = 3, 200


def were_seen(shapes: Shapes) -> bool:
    """Return whether most have open borders and were seen from one direction each, like depth images."""
    local = [item.local for item in shapes.samples if item.local is not None]
    num_seen = sum(bool(len(one.sights)) for one in local)
    return _are_open(shapes) and num_seen > 0.5 * len(shapes.names)


def match_badly(shapes: Shapes, pairs: Sequence[Pair]) -> bool:
    """Return whether most have open borders, and the median pair matches badly as whole shapes."""
    return _are_open(shapes) and median_mismatch(pairs) >= BADLY_MATCHED


def _are_open(shapes: Shapes) -> bool:
    """Return whether most of some shapes have open borders, and most enough points that tell something."""
    opened = np.mean([item.may_be_cut for item in shapes.samples])
    if not (FEWEST_SCANS <= len(shapes.names) <= MOST_SCANS and opened > 0.5):
        return False
    local = [item.local for item in shapes.samples if item.local is not None]
    return bool(local) and np.median([len(one.points) for one in local]) >= TUNED.least_points


def align_scans(run: Run, pairs: Sequence[Pair], reasons: Mapping[int, str]) -> Posed | None:
    """Return the poses of shapes none of which is complete; None where nobody said so, and they are no scans.

    Sizes are those of the files.

    Parameters
    ----------
    run : Run
        Its group is decided.
    pairs : sequence of Pair
        The shapes as if they were complete, if they were matched.
    reasons : mapping of int to str
        Why each counts as incomplete; empty where nobody said so.

    Raises
    ------
    InputError
        If there are too many shapes, or poses are fixed.
    CollectionError
        If nothing can be read of a shape's surface.
    """
    session, shapes, constraints = run.session, run.shapes, run.constraints
    num = len(shapes.names)
    if num > MOST_SCANS or constraints.fixed:
        raise InputError(
            "incomplete: poses of shapes of which at most one is complete are found together, for at most "
            f"{MOST_SCANS} shapes and without fixed poses"
        )
    is_scene = shows_scene([item.local for item in shapes.samples if item.local is not None])
    with run.stage("incomplete shapes"):
        cell = common_cell(shapes.samples)
        surfaces = describe_scans(session, shapes, cell, of_scene=is_scene)
        if not reasons and len(surfaces) < max(FEWEST_SCANS, num - len(surfaces)):
            return None
        if reasons and surfaces.failures:
            raise CollectionError(
                "; ".join(f"{shapes.names[i]}: {why}" for i, why in surfaces.failures.items())
            )
        described, joined = _joined(run, surfaces)
    if not reasons:
        if not _are_scans(joined, described, pairs, are_seen=were_seen(shapes), is_scene=is_scene):
            return None
        if not were_seen(shapes):
            joined = replace(joined, confidence=OVERLAP_ALONE * joined.confidence)
    posed = posed_scans(run, pairs, joined, reasons or dict.fromkeys(range(num), SCAN))
    overlap_alone = not reasons and not were_seen(shapes)
    return replace(posed, limited_by=(("overlap-alone",) * num if overlap_alone else ()))


def _joined(
    run: Run, surfaces: Results[int, LocalSurface]
) -> tuple[dict[int, LocalSurface], JoinedScans]:
    """Return the surfaces, each on the side that it was joined on, and what overlaps join of them.

    Nothing joins shapes that could not be described.

    The outer side of a cloud is guessed. So if most shapes are joined, clouds that are not are seen from behind as
    well, and those that are joined then stay so.
    """
    shapes, num = run.shapes, len(run.shapes.names)

    def with_turned(turned: frozenset[int]) -> tuple[dict[int, LocalSurface], JoinedScans]:
        overlaps = overlap_pairs(run.session, shapes, surfaces, turned)
        sides = {i: one.seen_from_behind() if i in turned else one for i, one in surfaces.items()}
        return sides, join_scans(sides, overlaps, log_odds_of(overlaps, run.constraints), num=num)

    as_guessed = with_turned(frozenset())
    held = {*as_guessed[1].parts[0].tolist()}
    apart = frozenset(i for i in surfaces if i not in held and not side_known(shapes, i))
    if not apart or 2 * len(held) <= len(surfaces):
        return as_guessed
    joined = {*with_turned(apart)[1].parts[0].tolist()}
    return with_turned(apart & joined) if len(joined) > len(held) else as_guessed


def log_odds_of(overlaps: Overlaps, constraints: Constraints) -> dict[tuple[int, int], FloatArray]:
    """Return the log-odds of the poses of pairs; the order of the scans and rough poses add theirs."""
    after = {frozenset(two) for two in itertools.pairwise(constraints.order)}
    return {
        pair: overlap_log_odds(poses)
        + hinted_log_odds(
            poses.rotations,
            in_order=frozenset(pair) in after,
            rough=constraints.candidates.get(pair),
        )
        for pair, poses in overlaps.items()
    }


def _are_images_of_scene(joined: JoinedScans, surfaces: Mapping[int, LocalSurface]) -> bool:
    """Return whether overlaps hold most shapes, and the middles of the joined ones do not lie together.

    Those of hollow shapes that are whole, such as bowls, do.
    """
    if (joined.confidence >= JOINING_CHANCE).sum() < MOST_SURE * len(surfaces):
        return False
    part = joined.parts[0].tolist()
    middles = [moved_by(joined.transforms[i], surfaces[i].points.mean(axis=0)) for i in part]
    radii = [np.sqrt(surfaces[i].points.var(axis=0).sum()) for i in part]
    spread = np.sqrt(np.var(middles, axis=0).sum())
    return bool(spread >= LEAST_WIDER * np.median(radii))


def _are_scans(
    joined: JoinedScans,
    surfaces: Mapping[int, LocalSurface],
    pairs: Sequence[Pair],
    *,
    are_seen: bool,
    is_scene: bool,
) -> bool:
    """Return whether overlaps join most shapes surely, which match badly as wholes or were seen from all around.

    Faces of several people, each seen from the front, are whole shapes of one kind. Shapes most of which were seen
    from one direction each, and which match badly as wholes, are scans even where hardly one is sure: poses as whole
    shapes would be wrong.
    """
    is_bad = median_mismatch(pairs) >= BADLY_MATCHED
    if is_bad and are_seen:
        return True
    if is_scene:
        return _are_images_of_scene(joined, surfaces)
    least = (MOST_SURE if is_bad else NEARLY_ALL) * len(surfaces)
    if (joined.confidence[joined.parts[0]] >= DOUBT).sum() < least:
        return False
    sights = [
        joined.transforms[i, :3, :3] @ surfaces[i].sights[0]
        for i in joined.parts[0]
        if len(surfaces[i].sights)
    ]
    return is_bad or (
        len(sights) > 1 and float(np.linalg.norm(np.mean(sights, axis=0))) < MOST_ALIKE
    )


def framed_poses(run: Run, transforms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return poses (N, 4, 4), and their rotations (N, 3, 3), in the frame of the reference.

    All samples are centred there, and of the reference's normalised size unless sizes stay.
    """
    shapes, reference = run.shapes, run.constraints.reference
    framed = np.linalg.inv(transforms[reference]) @ transforms
    if run.constraints.rotation is not None:
        framed[:, :3] = run.constraints.rotation @ framed[:, :3]
    rotations = framed[:, :3, :3] / scales_of(framed)[:, None, None]
    if run.session.options.scaling == "similarity":
        framed[:, :3] /= shapes.samples[reference].scale
    framed[:, :3, 3] -= common_positions(shapes.samples, framed).mean(axis=(0, 1))
    return with_origin(framed, run.constraints), rotations


def universe_labels(shapes: Shapes, transforms: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the labels (N, k) of all samples at poses (N, 4, 4), -1 for none, and the points (l, 3) they are of."""
    positions = common_positions(shapes.samples, transforms)
    universe = common_points(positions)
    return np.stack([nearest_labels(points, universe) for points in positions]), universe


def common_points(positions: FloatArray) -> FloatArray:
    """Return points that stand for all samples (N, k, 3): those farther from all before than samples lie apart."""
    every = positions.reshape(-1, 3)
    gaps = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3)
    gaps[:, np.arange(gaps.shape[1]), np.arange(gaps.shape[1])] = np.inf
    spacing, kept = float(np.median(gaps.min(axis=2))), [0]
    for n in range(1, len(every)):
        if np.linalg.norm(every[kept] - every[n], axis=1).min() > spacing:
            kept.append(n)
    return every[kept]


def posed_scans(
    run: Run,
    matched: Sequence[Pair],
    joined: JoinedScans,
    reasons: Mapping[int, str],
) -> Posed:
    """Return what follows from the poses of joined scans."""
    shapes = run.shapes
    transforms, rotations = framed_poses(run, joined.transforms)
    labels, universe = universe_labels(shapes, transforms)
    incomplete = tuple(_incomplete(i, joined.kept, reason) for i, reason in reasons.items())
    in_doubt = joined.confidence < DOUBT
    in_doubt[np.concatenate([np.empty(0, dtype=np.int64), *joined.parts[1:]])] = True
    lost = components_left_out(shapes, np.flatnonzero(in_doubt).tolist())
    pairs = [
        _pair(pair, poses, joined, rotations, labels)
        for pair, poses in joined.overlaps.items()
        if pair in joined.kept or joined.chances[pair].max() >= JOINING_CHANCE
    ]
    solution = SynchronizationResult(
        rotations=read_only(rotations),
        confidence=read_only(joined.confidence),
        edge_inlier=read_only(np.array([pair.inlier for pair in pairs], dtype=np.bool_)),
        edge_choice=read_only(np.array([pair.choice for pair in pairs], dtype=np.int64)),
        parts=tuple(joined.parts),
        components=tuple(joined.parts),
        alternatives=_alternatives(joined, transforms),
        warnings=_unjoined(shapes.names, joined),
    )
    return Posed(
        pairs=pairs,
        matched=[*matched],
        solution=solution,
        rotations=rotations,
        transforms=transforms,
        labels=labels,
        consensus=universe,
        notes=(incomplete_note(shapes.names, incomplete), *lost),
        side_chances={},
        incomplete=incomplete,
    )


def _unjoined(names: Sequence[str], joined: JoinedScans) -> tuple[Note, ...]:
    """Return the note that names the parts that no overlap joins, if there are several."""
    if len(joined.parts) < 2:
        return ()
    groups = "; ".join(", ".join(names[i] for i in part.tolist()) for part in joined.parts)
    return (Note("unjoined-scans", values={"groups": groups}),)


def _incomplete(i: int, kept: Overlaps, reason: str) -> Incomplete:
    """Return what is known of a scan: the shapes that it overlaps with, and by how much."""
    partners, shares = [], []
    for (a, b), poses in kept.items():
        if i in (a, b):
            partners.append(b if i == a else a)
            shares.append(poses.overlaps[0] if i == b else poses.overlaps[0][::-1])
    return Incomplete(
        shape=i,
        reason=reason,
        partners=read_only(np.array(partners, dtype=np.int64)),
        overlaps=read_only(np.array(shares, dtype=np.float64).reshape(-1, 2)),
    )


def _pair(
    ends: tuple[int, int],
    poses: LocalPoses,
    joined: JoinedScans,
    rotations: FloatArray,
    labels: IntArray,
) -> AlignedPair:
    """Return a pair with its poses, the most probable first, and the map of its samples at the common ones."""
    i, j = ends
    order = np.argsort(-joined.chances[ends], kind="stable")
    chosen = poses[order]
    angles = pose_angle_deg(chosen.rotations, rotations[i].T @ rotations[j])
    nearest = int(np.argmin(angles))
    agrees = ends in joined.kept and bool(angles[nearest] <= AGREE_DEG)
    return AlignedPair(
        target=i,
        source=j,
        rotations=read_only(chosen.rotations),
        maps=read_only(np.full((len(chosen), labels.shape[1]), -1)),
        energies=read_only(1.0 - chosen.overlap),
        how="overlap",
        status=Status.LOCAL_OPTIMUM.name,
        choice=nearest if agrees else -1,
        inlier=agrees,
        disagreement_deg=float(angles[0]),
        map_target_source=read_only(label_map(labels[i], labels[j])),
        energy=1.0 - float(joined.kept[ends].overlap[0] if agrees else chosen.overlap[nearest]),
    )


def _alternatives(
    joined: JoinedScans, transforms: FloatArray
) -> tuple[tuple[Alternative, ...], ...]:
    """Return for each shape the other places that pairs ask for, of itself or of a block with others."""
    found: list[list[Alternative]] = [[] for _ in transforms]
    inverse = np.linalg.inv(joined.transforms)
    for cut in joined.cuts:
        for i in cut.members.tolist() if cut.against > 0 else ():
            moved = transforms[i] @ inverse[i] @ cut.move @ joined.transforms[i]
            found[i].append(
                Alternative(
                    rotation=read_only(moved[:3, :3] / scales_of(moved)),
                    log_odds=cut.held - cut.against,
                    origin="overlaps",
                    transform=read_only(moved),
                )
            )
    return tuple(tuple(own) for own in found)
