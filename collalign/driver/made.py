"""Makes the result of a run."""

from __future__ import annotations

import platform
from importlib.metadata import version

import numpy as np

from collalign.engine.command_line import COMMAND, now
from collalign.output.collection import Collection
from collalign.output.evidence_file import by_label, cycle_errors_deg, part_numbers
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.run_record import Made, RunRecord
from collalign.stages.match_pairs import num_reused_pairs
from collalign.stages.mixed_sides import sides_of_result
from collalign.stages.poses.placement import common_positions
from collalign.stages.steps import Matched, Posed, Run, with_group
from collalign.stages.trust.assess import confidence_by_evidence
from data_tools.arrays import FloatArray, read_only
from data_tools.embedding.copies import find_copies
from data_tools.io.listing import FolderListing
from data_tools.io.source import location
from data_tools.notes import Note
from data_tools.poses import each_moved_by

_LIBRARIES = ("collalign", "numpy", "scipy", "trimesh", "potpourri3d", "robust-laplacian", "joblib")


def collected(run: Run, matched: Matched, posed: Posed, listing: FolderListing) -> Collection:
    """Return the result of a run: the one place where a collection is made."""
    shapes, solution, wanted = run.shapes, posed.solution, run.session.options
    samples, positions = shapes.samples, common_positions(shapes.samples, posed.transforms)
    in_files = each_moved_by(
        np.asarray(np.linalg.inv(posed.transforms), dtype=np.float64), positions
    )
    session = with_group(run, matched.group).session
    reflected = np.linalg.det(posed.transforms[:, :3, :3]) < 0
    signatures, notes = [item.signature for item in samples], [item.notes for item in samples]
    copies = find_copies(shapes.names, shapes.digests, signatures, notes)
    return Collection(
        names=shapes.names,
        files=tuple(location(file) for file in shapes.files),
        digests=shapes.digests,
        transforms=read_only(posed.transforms),
        confidence=read_only(solution.confidence),
        samples=read_only(np.stack([item.vertex_indices for item in samples])),
        positions=read_only(positions),
        maps=ConsistentMaps(names=shapes.names, labels=read_only(posed.labels)),
        consensus=read_only(posed.consensus),
        landmarks=read_only(by_label(in_files, posed.labels)),
        pairs=posed.pairs,
        alternatives=solution.alternatives,
        part_numbers=read_only(part_numbers(solution.parts, len(samples))),
        excluded=(*shapes.excluded, *matched.failed),
        notes=(
            *solution.warnings,
            *shapes.notes,
            *sides_of_result(
                matched.notes, shapes.names, posed.pairs, reflected, posed.side_chances
            ),
            *posed.notes,
            *_unknown_confidence(solution.confidence, wanted.synchronization),
            *(one.note for one in copies),
        ),
        copies=copies,
        incomplete=posed.incomplete,
        extra=posed.extra,
        assembled=tuple(
            name
            for name, how in zip(shapes.names, shapes.cleaning, strict=True)
            if how.components == "all" and wanted.cleaning.components != "all"
        ),
        limited_by={
            name: code for name, code in zip(shapes.names, posed.limited_by, strict=False) if code
        },
        by_hand=_by_hand(run, posed),
        options=wanted,
        group=matched.group,
        run=record_of_run(
            run.times_s,
            session.num_reused("shapes", shapes.keys)
            + num_reused_pairs(session, shapes, posed.pairs),
            listing.skipped_names,
        ),
        cycle_errors_deg=read_only(cycle_errors_deg(posed.pairs, len(samples))),
        fresh=Made(
            files=shapes.files,
            coordinates=read_only(np.stack([item.coordinates for item in samples])),
            invariants=read_only(np.stack([item.invariants for item in samples])),
            shape_notes=tuple(item.notes for item in samples),
            trust=posed.trust,
            vertices=posed.vertices,
        ),
    )


def record_of_run(
    times_s: dict[str, float], num_reused: int, skipped: tuple[str, ...]
) -> RunRecord:
    """Return how a run went that ends now."""
    return RunRecord(
        times_s=times_s,
        versions={"python": platform.python_version()}
        | {name: version(name) for name in _LIBRARIES},
        num_reused=num_reused,
        skipped=skipped,
        command=COMMAND.get(),
        date=now(),
    )


def _by_hand(run: Run, posed: Posed) -> dict[str, float]:
    """Return the shapes that a person posed, each with the confidence that the evidence alone gives to that pose."""
    known = confidence_by_evidence(posed.trust, len(run.shapes.names))
    return {run.shapes.names[i]: float(known[i]) for i in sorted(run.constraints.by_hand)}


def _unknown_confidence(confidence: FloatArray, method: str) -> tuple[Note, ...]:
    """Return the note that says that nothing is known about the poses, where that is so."""
    if not np.isnan(confidence).all():
        return ()
    return (Note("no-confidence", values={"method": method}),)
