"""Writes an aligned collection: everything is staged first, then moved into place, the summary last."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from collalign.confidence.candidate_model import candidate_chances
from collalign.confidence.pose_model import symmetric_confidence
from collalign.output.certificates import write_certificates
from collalign.output.collection_data import MESH_FOLDER, CollectionData
from collalign.output.evidence_file import (
    CORRESPONDENCES_FILE,
    EVIDENCE_FILE,
    RUN_FILE,
    save_correspondences,
    save_evidence,
    save_run,
    shown_pair,
)
from collalign.output.label_notes import with_label_notes
from collalign.output.report.page import report_pages
from collalign.output.shape_files import share_out, write_shapes
from collalign.output.vertex_maps import VERTEX_MAPS_FILE, PlaceColours, save_vertex_maps
from collalign.output.views import tile_of, write_contact_sheet
from collalign.products.named_frame import NamedFrame
from collalign.products.pair import are_weighed
from collalign.products.run_record import OUTPUTS
from collalign.products.trust import KINDS, Trust
from collalign.version import __version__
from collalign.wording import note_records, reason_text
from data_tools.errors import InputError
from data_tools.io.files import file_stems, readable_name, system_reason
from data_tools.io.output_folder import OutputFolder, refuse_overlap
from data_tools.io.shapes import declared_system
from data_tools.io.source import inputs_of
from data_tools.poses import scales_of
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: The command whose files these are, in the manifest of an output folder.
WRITER = "align"
ALIGNMENT_FILE = "alignment.json"
PAIRS_FILE = "pairs.csv"
CONTACT_SHEET_FILE = "contact_sheet.png"
REPORT_FILE = "report.html"
#: More shapes than this are drawn as an evenly spaced choice.
_MAX_TILES = 100
#: Written by every run; the report can be left out.
_TABLES = (
    ALIGNMENT_FILE,
    CORRESPONDENCES_FILE,
    PAIRS_FILE,
    RUN_FILE,
    CONTACT_SHEET_FILE,
    EVIDENCE_FILE,
)

_PAIR_COLUMNS = (
    "target",
    "source",
    "how",
    "energy",
    "lower_bound",
    "status",
    "chirality_proven",
    "num_candidates",
    "choice",
    "inlier",
    "disagreement_deg",
    "chance",
    "complete_within",
    "num_regions",
)


@one_blas_thread()
def save_collection(
    collection: CollectionData,
    output: OutputFolder,
    *,
    report: bool = True,
    labels: Mapping[str, tuple[str, ...]] | None = None,
    advance: Callable[[], None] | None = None,
    num_jobs: int = 1,
) -> tuple[Path, ...]:
    """Write every output of a collection.

    Everything is staged first, and then moved into place. ``alignment.json`` goes first and comes back last: an
    interruption leaves the former outputs, or a folder without a summary, and never a half-written file. What an
    earlier run wrote and this one does not write is removed; files of anybody else's stay.

    Parameters
    ----------
    collection : CollectionData
    output : OutputFolder
    report : bool
        Write ``report.html`` as well.
    labels : mapping of str to tuple of str, optional
        Columns of labels, one value per shape, for the report; notes say what they contradict.
    advance : callable, optional
        Called after each shape, for a display of the progress.
    num_jobs : int
        Processes of this machine that share the work; 1 is this one alone.

    Returns
    -------
    tuple of Path
        What was written.

    Raises
    ------
    InputError
        If the folder cannot be written, holds one of the shapes or somebody else's file under the name of an output,
        or a shape's file has vanished meanwhile.
    """
    began_s = time.perf_counter()
    collection = with_label_notes(collection, labels or {})
    try:
        refuse_overlap(output.folder, inputs_of(collection.made.files))
        output.refuse_foreign(output_names(collection.names))
        _write_tables(collection, output)
        write_certificates(collection.pairs, collection.made, output)
        stems = file_stems(collection.names)
        meshes = [output.stage(MESH_FOLDER, f"{stem}.ply").absolute() for stem in stems]
        vertices = collection.made.vertices
        colours = None if vertices is None else PlaceColours(vertices)
        parts = write_shapes(collection, meshes, colours, num_jobs=num_jobs, advance=advance)
        shown = replace(
            collection,
            pairs=[shown_pair(pair) for pair in collection.pairs],
            labels=dict(labels or {}),
            vertices=tuple(vertices for vertices, _, _ in parts),
            faces=tuple(faces for _, faces, _ in parts),
            places=() if colours is None else tuple(places for _, _, places in parts),
        )
        save_evidence(shown, output.staging)
        title = report_title(collection) if report else None
        tasks = ((name, {"write": write}) for name, write in _documents(shown, output, title))
        share_out(write_document, tasks, num_jobs=num_jobs)
        times_s = collection.run.times_s | {OUTPUTS: time.perf_counter() - began_s}
        run_folder = output.stage(RUN_FILE).parent
        save_run(replace(collection.run, times_s=times_s), run_folder)
        written = output.publish(last=ALIGNMENT_FILE, complete=True)
    except OSError as error:
        raise InputError(
            f"{output.folder}: the results cannot be written ({system_reason(error)})"
        ) from error
    tops = dict.fromkeys(
        output.folder / path.relative_to(output.folder).parts[0] for path in written
    )
    files, folders = (
        (path for path in tops if path.is_file()),
        (path for path in tops if path.is_dir()),
    )
    return (*files, *sorted(folders))


def report_title(collection: CollectionData) -> str:
    """Return the title of a report, by the folder of the first shape's file."""
    file = collection.files[0]
    return f"Aligned collection {readable_name(Path(file).parent) if file else ''}".rstrip()


def output_names(names: Sequence[str]) -> list[str]:
    """Return the paths, relative to the folder, that the results of shapes of these names take."""
    meshes = (f"{MESH_FOLDER}/{stem}.ply" for stem in file_stems(names))
    return [*_TABLES, REPORT_FILE, VERTEX_MAPS_FILE, *meshes]


def _evidence(collection: CollectionData, shape: int) -> dict[str, float | None]:
    """Return the evidence of a pose, by kind; empty where nothing was gathered."""
    trust = collection.made.trust
    if trust is None:
        return {}
    row = trust.evidence[shape]
    return {kind: _number(value) for kind, value in zip(KINDS, row, strict=True)}


def _by_hand(collection: CollectionData, name: str) -> dict[str, Any]:
    """Return that a person set a shape's pose, and what the evidence alone says of it; nothing of other shapes."""
    if name not in collection.by_hand:
        return {}
    return {"set_by_hand": True, "confidence_by_evidence": _number(collection.by_hand[name])}


def _limit(collection: CollectionData, name: str) -> dict[str, Any]:
    """Return what limits the confidence of a shape, as a code and in words; nothing where nothing does."""
    code = collection.limited_by.get(name)
    return {} if code is None else {"limited_by": code, "limited_by_text": reason_text(code)}


def _symmetry(trust: Trust | None, shape: int) -> dict[str, Any]:
    """Return the rotations that leave a shape's class unchanged, and the confidence up to them; {} without any."""
    if trust is None or len(trust.symmetries[shape]) < 2:
        return {}
    up_to = float(symmetric_confidence(trust)[shape])
    return {
        "confidence_up_to_symmetry": _number(up_to),
        "symmetry": trust.symmetries[shape][1:].tolist(),
    }


def _incomplete(collection: CollectionData) -> dict[str, Any]:
    """Return what is known of the incomplete shapes; nothing where all are complete."""
    if not collection.incomplete:
        return {}
    return {
        "incomplete": [
            {
                "name": collection.names[one.shape],
                "reason": one.reason,
                "reason_text": reason_text(one.reason),
                "scale": float(scales_of(collection.transforms[one.shape])),
                "translation": collection.transforms[one.shape][:3, 3].tolist(),
                "coverage": _number(one.coverage),
                "samples_with_labels": int((collection.maps.labels[one.shape] >= 0).sum()),
                "overlaps": {
                    collection.names[partner]: {"partner": float(theirs), "own": float(own)}
                    for partner, (theirs, own) in zip(
                        one.partners.tolist(), one.overlaps.tolist(), strict=True
                    )
                },
            }
            for one in collection.incomplete
        ]
    }


def _kinds(collection: CollectionData) -> dict[str, Any]:
    """Return which shapes are of which kind; nothing where all are of one."""
    if not collection.kinds:
        return {}
    return {
        "kinds": [
            {
                "name": kind.called,
                "shapes": [collection.names[i] for i in kind.shapes.tolist()],
                "confidence": _number(kind.confidence),
                "frame": _number(kind.frame),
                "group": kind.group,
            }
            for kind in collection.kinds
        ]
    }


def _extra(collection: CollectionData) -> dict[str, Any]:
    """Return where the extra material of shapes is; nothing where there is none."""
    if not collection.extra:
        return {}
    return {
        "extra": [
            {
                "name": collection.names[one.shape],
                "share": one.share,
                "direction": one.direction(collection.transforms[one.shape]).tolist(),
            }
            for one in collection.extra
        ]
    }


def alignment_record(collection: CollectionData) -> dict[str, Any]:
    """Return the contents of ``alignment.json``: what the result is, without anything that differs between runs."""
    shapes = zip(
        collection.names,
        collection.made.files,
        collection.relative_paths,
        collection.digests,
        collection.transforms,
        collection.reflected,
        collection.confidence,
        collection.kind_names,
        collection.is_alone,
        collection.centroid_sizes,
        strict=True,
    )
    return {
        "version": __version__,
        "options": asdict(collection.options),
        "decided": {
            "group": collection.group,
            "own": list(collection.own),
            "maps": are_weighed(collection.pairs),
            **(
                {"frame": asdict(NamedFrame.of(collection.options))}
                if collection.options.up
                else {}
            ),
        },
        "shapes": [
            {
                "name": name,
                "file": path,
                "digest": digest,
                "transform": transform.tolist(),
                "reflected": bool(reflected),
                "confidence": _number(confidence),
                **_by_hand(collection, name),
                **({"kind": kind} if kind else {}),
                **({"alone": True} if alone else {}),
                "centroid_size_points": _number(size),
                **({"pieces": "all"} if name in collection.assembled else {}),
                **_limit(collection, name),
                **_symmetry(collection.made.trust, i),
                "evidence": _evidence(collection, i),
                **({"coordinate_system": system} if (system := declared_system(file)) else {}),
            }
            for i, (
                name,
                file,
                path,
                digest,
                transform,
                reflected,
                confidence,
                kind,
                alone,
                size,
            ) in enumerate(shapes)
        ],
        **_kinds(collection),
        "groups": [
            [collection.names[i] for i in np.flatnonzero(collection.part_numbers == part)]
            for part in range(collection.part_numbers.max() + 1)
        ],
        "excluded": [{"file": item.file, "reason": item.reason} for item in collection.excluded],
        "copies": [asdict(one) for one in collection.copies],
        "notes": note_records(collection.notes),
        **_incomplete(collection),
        **_extra(collection),
        "shape_notes": {
            name: note_records(notes)
            for name, notes in zip(collection.names, collection.made.shape_notes, strict=True)
            if notes
        },
    }


def _write_tables(collection: CollectionData, output: OutputFolder) -> None:
    output.stage_text(json.dumps(alignment_record(collection), indent=1), ALIGNMENT_FILE)
    output.stage_table(_pairs_table(collection), PAIRS_FILE)
    save_correspondences(collection, output.stage(CORRESPONDENCES_FILE).parent)
    if collection.made.vertices is not None:
        save_vertex_maps(collection.made.vertices, output.stage(VERTEX_MAPS_FILE))


def write_document(write: Callable[[], None]) -> None:
    """Write a page or a picture; runs inside a worker."""
    write()


def _documents(
    shown: CollectionData, output: OutputFolder, title: str | None
) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield what writes the picture of all shapes and, with a title, the pages of the report, by name."""
    drawn = np.linspace(0, len(shown) - 1, min(len(shown), _MAX_TILES)).round().astype(np.int64)
    tiles = []
    for i in drawn.tolist():
        mesh = Shape.from_arrays(shown.vertices[i], shown.faces[i], name=shown.names[i])
        tiles.append(tile_of(mesh, shown.transforms[i], float(shown.confidence[i])))
    sheet, frame = output.stage(CONTACT_SHEET_FILE).absolute(), NamedFrame.of(shown.options)
    yield "sheet", partial(write_contact_sheet, sheet, tuple(tiles), frame)
    if title is not None:
        for page in report_pages(shown, output.stage(REPORT_FILE).absolute(), title=title):
            yield page.title, page.write


def _pairs_table(collection: CollectionData) -> list[Sequence[object]]:
    rows = (
        [
            collection.names[pair.target],
            collection.names[pair.source],
            pair.how,
            repr(pair.energy),
            repr(pair.lower_bound),
            pair.status,
            int(pair.chirality_proven),
            len(pair.energies),
            pair.choice,
            int(pair.inlier),
            f"{pair.disagreement_deg:.3f}",
            f"{candidate_chances(pair)[pair.choice]:.4f}" if pair.choice >= 0 else "",
            repr(pair.complete_within),
            len(pair.regions),
        ]
        for pair in collection.pairs
    )
    return [_PAIR_COLUMNS, *rows]


def _number(value: float) -> float | None:
    """Return a number that JSON knows: NaN becomes null."""
    return None if value != value else float(value)
