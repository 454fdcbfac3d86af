"""Joins the results of several kinds of shapes, each aligned by itself, into one result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from collalign.output.collection import Collection
from collalign.output.evidence_file import by_label
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.kinds import Kind
from collalign.products.pair import Alternative
from collalign.products.run_record import Made, RunRecord
from collalign.products.trust import KINDS, Trust
from collalign.stages.kinds.kind_frames import KindFrame
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.notes import Note, Value, listed
from data_tools.poses import each_moved_by


def in_frame(collection: Collection, rotation: FloatArray) -> Collection:
    """Return a result whose common frame is rotated.

    Parameters
    ----------
    collection : Collection
        Just made.
    rotation : ndarray, shape (3, 3)
        ``R_new_old``.
    """
    whole = np.eye(4)
    whole[:3, :3] = rotation

    def moved(pose: Alternative) -> Alternative:
        transform = None if pose.transform is None else read_only(whole @ pose.transform)
        return replace(pose, rotation=read_only(rotation @ pose.rotation), transform=transform)

    trust = collection.made.trust
    if trust is not None:
        trust = replace(
            trust,
            rivals=tuple(read_only(rotation @ of) for of in trust.rivals),
            symmetries=tuple(read_only(rotation @ of @ rotation.T) for of in trust.symmetries),
        )
    return replace(
        collection,
        transforms=read_only(whole @ collection.transforms),
        positions=read_only(collection.positions @ rotation.T),
        consensus=read_only(collection.consensus @ rotation.T),
        alternatives=tuple(tuple(map(moved, of)) for of in collection.alternatives),
        fresh=replace(collection.made, trust=trust),
    )


def join_kinds(
    names: Sequence[str],
    parts: Sequence[Collection],
    frames: Sequence[KindFrame],
    called: Sequence[str],
    confidence: Sequence[float],
) -> Collection:
    """Return one result of several, whose shapes do not correspond with each other.

    Parameters
    ----------
    names : sequence of str, length N
        All shapes, in order.
    parts : sequence of Collection
        Just made, one of each kind.
    frames : sequence of KindFrame
        How the frame of each lies.
    called : sequence of str
        The name of each kind.
    confidence : sequence of float
        How likely each is a kind of its own; NaN where the caller said so.
    """
    parts = [in_frame(part, frame.rotation) for part, frame in zip(parts, frames, strict=True)]
    at = {name: number for number, name in enumerate(name for part in parts for name in part.names)}
    order = np.array([at[name] for name in names if name in at], dtype=np.int64)
    position = {int(old): new for new, old in enumerate(order)}
    starts = np.cumsum([0, *(len(part) for part in parts)])
    num = max(part.samples.shape[1] for part in parts)
    labels = _labels(parts, num)[order]
    samples = np.concatenate([_padded(part.samples, num) for part in parts])[order]
    positions = np.concatenate([_padded(part.positions, num) for part in parts])[order]
    transforms = np.concatenate([part.transforms for part in parts])[order]
    kinds = tuple(
        Kind(
            called=name,
            shapes=read_only(np.sort([position[start + i] for i in range(len(part))])),
            confidence=float(sure),
            frame=frame.agreeing,
            group=part.group,
            cleaning=part.options.cleaning,
        )
        for name, sure, frame, part, start in zip(
            called, confidence, frames, parts, starts, strict=False
        )
    )
    in_files = each_moved_by(np.asarray(np.linalg.inv(transforms), dtype=np.float64), positions)

    def places(start: int, part: Collection) -> dict[int, int]:
        return {i: position[start + i] for i in range(len(part))}

    numbered = list(
        zip((places(s, p) for s, p in zip(starts, parts, strict=False)), parts, strict=True)
    )

    def every(field: str) -> tuple[Any, ...]:
        values = [one for part in parts for one in getattr(part, field)]
        return tuple(values[i] for i in order.tolist())

    return replace(
        parts[0],
        names=every("names"),
        files=every("files"),
        digests=every("digests"),
        transforms=read_only(transforms),
        confidence=read_only(np.concatenate([part.confidence for part in parts])[order]),
        samples=read_only(samples),
        positions=read_only(positions),
        maps=ConsistentMaps(names=every("names"), labels=read_only(labels)),
        consensus=read_only(np.concatenate([part.consensus for part in parts])),
        landmarks=read_only(by_label(in_files, labels)),
        landmark_names=(),
        pairs=[
            replace(pair, target=where[pair.target], source=where[pair.source])
            for where, part in numbered
            for pair in part.pairs
        ],
        alternatives=every("alternatives"),
        part_numbers=read_only(_part_numbers(parts)[order]),
        kinds=kinds,
        excluded=tuple(one for part in parts for one in part.excluded),
        notes=_notes(parts, called),
        copies=tuple(one for part in parts for one in part.copies),
        incomplete=tuple(one.among(where) for where, part in numbered for one in part.incomplete),
        extra=tuple(
            replace(one, shape=where[one.shape]) for where, part in numbered for one in part.extra
        ),
        assembled=tuple(name for name in names if any(name in part.assembled for part in parts)),
        limited_by={name: code for part in parts for name, code in part.limited_by.items()},
        by_hand={name: value for part in parts for name, value in part.by_hand.items()},
        group="O" if any(part.group == "O" for part in parts) else "SO",
        own=tuple(dict.fromkeys(name for part in parts for name in part.own)),
        run=_run(parts),
        cycle_errors_deg=read_only(np.concatenate([part.cycle_errors_deg for part in parts])),
        fresh=_made(parts, order, num),
    )


def kind_notes(
    kinds: Sequence[Kind], names: Sequence[str], *, are_given: bool, named: Sequence[str] = ()
) -> tuple[Note, ...]:
    """Return what to say about kinds: which there are, how sure that is, and whose frames are known.

    Parameters
    ----------
    kinds : sequence of Kind
    names : sequence of str
        Of all shapes.
    are_given : bool
        Whether the caller said which shapes are of which kind.
    named : sequence of str
        Directions that the caller named on a shape of one kind: up, front.
    """
    several = [kind for kind in kinds if not kind.is_alone]
    groups = tuple(
        f"{kind.called} ({listed([names[i] for i in kind.shapes.tolist()])})" for kind in several
    )
    values: dict[str, Value] = {"num": len(kinds), "groups": groups}
    if are_given:
        notes = [Note("kinds-given", values=values)]
    else:
        least = min(kind.confidence for kind in kinds)
        notes = [Note("kinds-found", values={**values, "confidence": least})]
    alone = tuple(names[int(kind.shapes[0])] for kind in kinds if kind.is_alone)
    if alone:
        notes.append(Note("kind-alone", alone))
    posed = [kind for kind in several if 0.0 < kind.frame < 1.0]
    if posed:
        called, shares = tuple(one.called for one in posed), tuple(one.frame for one in posed)
        notes.append(Note("kinds-posed", values={"kinds": called, "shares": shares}))
    apart = tuple(kind.called for kind in several if kind.frame == 0.0)
    if apart:
        notes.append(Note("kinds-apart", values={"kinds": apart, "named": tuple(named)}))
    return tuple(notes)


def _labels(parts: Sequence[Collection], num: int) -> IntArray:
    """Return labels (N, num) of which each part has its own; -1 for samples that only fill up."""
    found, above = [], 0
    for part in parts:
        own = np.full((len(part), num), -1)
        own[:, : part.maps.labels.shape[1]] = np.where(
            part.maps.labels >= 0, part.maps.labels + above, -1
        )
        above += int(part.maps.labels.max(initial=-1)) + 1
        found.append(own)
    return np.concatenate(found)


def _padded(values: FloatArray | IntArray, num: int) -> FloatArray | IntArray:
    """Return values of samples (n, k, ...) with the first sample again in place of those that lack to ``num``."""
    lacking = num - values.shape[1]
    return np.concatenate([values, np.repeat(values[:, :1], lacking, axis=1)], axis=1)


def _part_numbers(parts: Sequence[Collection]) -> IntArray:
    """Return the part of each shape, of which every kind has its own."""
    found, above = [], 0
    for part in parts:
        found.append(part.part_numbers + above)
        above += int(part.part_numbers.max()) + 1
    return np.concatenate(found)


def _notes(parts: Sequence[Collection], called: Sequence[str]) -> tuple[Note, ...]:
    """Return the notes of all kinds, what is the same once; with the names of the kinds where no shapes are named."""
    found = dict[tuple[str, str], tuple[Note, list[str], list[str]]]()
    for part, name in zip(parts, called, strict=True):
        for note in part.notes:
            # Of notes with values per shape, each stays by itself.
            own = note.shapes if note.shapes and note.values else ()
            _, shapes, kinds = found.setdefault(
                (note.code, repr((own, note.values))), (note, [], [])
            )
            shapes += note.shapes
            kinds.append(name)
    notes = list[Note]()
    for note, shapes, kinds in found.values():
        if shapes and not note.values:
            notes.append(Note(note.code, tuple(shapes)))
        else:
            values: dict[str, Value] = {"of_kind": listed(kinds), "of_code": note.code}
            notes.append(Note("kind-of", tuple(shapes), {**values, **note.values}))
    return tuple(notes)


def _run(parts: Sequence[Collection]) -> RunRecord:
    """Return how the runs of all kinds went together."""
    times_s = dict[str, float]()
    for part in parts:
        for stage, seconds in part.run.times_s.items():
            times_s[stage] = times_s.get(stage, 0.0) + seconds
    num_reused = sum(part.run.num_reused for part in parts)
    return replace(parts[0].run, times_s=times_s, num_reused=num_reused)


def _made(parts: Sequence[Collection], order: IntArray, num: int) -> Made:
    """Return what only the runs know."""
    made = [part.made for part in parts]
    coordinates = max(one.coordinates.shape[2] for one in made)

    def wide(values: FloatArray, width: int) -> FloatArray:
        lacking = ((0, 0), (0, 0), (0, width - values.shape[2]))
        return np.asarray(np.pad(_padded(values, num), lacking))

    invariants = max(one.invariants.shape[2] for one in made)
    files = [file for one in made for file in one.files]
    notes = [own for one in made for own in one.shape_notes]
    return Made(
        files=tuple(files[i] for i in order.tolist()),
        coordinates=read_only(
            np.concatenate([wide(one.coordinates, coordinates) for one in made])[order]
        ),
        invariants=read_only(
            np.concatenate([wide(one.invariants, invariants) for one in made])[order]
        ),
        shape_notes=tuple(notes[i] for i in order.tolist()),
        trust=_trust(
            [(one.trust, len(part)) for one, part in zip(made, parts, strict=True)], order
        ),
    )


def _trust(parts: Sequence[tuple[Trust | None, int]], order: IntArray) -> Trust | None:
    """Return the evidence of all kinds, of which one may have none; None where none has any."""
    if all(trust is None for trust, _ in parts):
        return None
    every = [unknown_trust(num) if trust is None else trust for trust, num in parts]
    values: dict[str, Any] = {}
    for field in fields(Trust):
        own = [getattr(trust, field.name) for trust in every]
        if isinstance(own[0], tuple):
            flat = [one for of in own for one in of]
            values[field.name] = tuple(flat[i] for i in order.tolist())
        else:
            values[field.name] = read_only(np.concatenate(own)[order])
    return Trust(**values)


def unknown_trust(num: int) -> Trust:
    """Return the evidence of shapes of which nothing is known."""
    nothing = read_only(np.full((num, len(KINDS)), np.nan))
    return Trust(
        evidence=nothing,
        rivals=(read_only(np.zeros((0, 3, 3))),) * num,
        excess=(read_only(np.zeros(0)),) * num,
        local_excess=(read_only(np.zeros(0)),) * num,
        leads=(read_only(np.zeros(0)),) * num,
        symmetries=(read_only(np.eye(3)[None]),) * num,
        up_to_symmetry=nothing,
    )
