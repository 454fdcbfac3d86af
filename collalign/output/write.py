"""Writes an aligned collection: everything into a temporary folder first, then into place, the summary last."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.collection import AlignedCollection
from collalign.output.contact_sheet import Tile, draw_contact_sheet, tile_of
from collalign.output.evidence.file import save_view
from collalign.output.evidence.gather import view_collection
from collalign.output.report.page import write_report
from data_tools.errors import InputError
from data_tools.io.files import write_atomic
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

ALIGNMENT_FILE = "alignment.json"
CORRESPONDENCES_FILE = "correspondences.npz"
PAIRS_FILE = "pairs.csv"
RUN_FILE = "run.json"
CONTACT_SHEET_FILE = "contact_sheet.png"
REPORT_FILE = "report.html"
MESH_FOLDER = "meshes"

_PAIR_COLUMNS = (
    "target",
    "source",
    "energy",
    "lower_bound",
    "status",
    "chirality_proven",
    "num_candidates",
    "choice",
    "inlier",
    "disagreement_deg",
)
#: More shapes than this are drawn as an evenly spaced choice.
_MAX_TILES = 100


@one_blas_thread()
def save_collection(
    collection: AlignedCollection,
    folder: Path,
    *,
    report: bool = True,
    labels: Mapping[str, tuple[str, ...]] | None = None,
) -> tuple[Path, ...]:
    """Write every output of a collection into ``folder``.

    Everything is written beside it first, and then moved into place. ``alignment.json`` goes first and comes back
    last: an interruption leaves the former outputs, or a folder without a summary, and never a half-written file.

    Parameters
    ----------
    collection : AlignedCollection
    folder : Path
        Made if it does not exist; other files in it are left alone.
    report : bool
        Write ``report.html`` as well.
    labels : mapping of str to tuple of str, optional
        Columns of labels, one value per shape, for the report.

    Returns
    -------
    tuple of Path
        What was written.

    Raises
    ------
    InputError
        If the folder cannot be written, or a shape's file has vanished meanwhile.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".collalign-", dir=folder))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        _write_tables(collection, staging)
        _write_shapes(collection, staging, report=report, labels=labels)
        return _move_into_place(staging, folder)
    except OSError as error:
        raise InputError(f"{folder}: the results cannot be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def alignment_record(collection: AlignedCollection) -> dict[str, Any]:
    """Return the contents of ``alignment.json``: what the result is, without anything that differs between runs."""
    from collalign import __version__

    shapes = zip(
        collection.names,
        collection.files,
        collection.transforms,
        collection.reflected,
        collection.confidence,
        strict=True,
    )
    return {
        "version": __version__,
        "options": asdict(collection.options),
        "decided": {"group": collection.group},
        "shapes": [
            {
                "name": name,
                "file": file.name,
                "transform": transform.tolist(),
                "reflected": bool(reflected),
                "confidence": _number(confidence),
            }
            for name, file, transform, reflected, confidence in shapes
        ],
        "groups": [[collection.names[i] for i in group] for group in collection.groups],
        "excluded": [{"file": item.file, "reason": item.reason} for item in collection.excluded],
        "notes": list(collection.notes),
        "shape_notes": {
            name: list(notes) for name, notes in zip(collection.names, collection.shape_notes, strict=True) if notes
        },
    }


def aligned_shape(shape: Shape, transform: np.ndarray) -> Shape:
    """Return a shape in the common frame; triangles are turned round where the transform mirrors.

    Parameters
    ----------
    shape : Shape
    transform : ndarray, shape (4, 4)
    """
    faces = shape.faces[:, ::-1] if np.linalg.det(transform[:3, :3]) < 0 else shape.faces
    vertices = shape.vertices @ transform[:3, :3].T + transform[:3, 3]
    return replace(shape, vertices=vertices, faces=np.ascontiguousarray(faces))


def _write_tables(collection: AlignedCollection, staging: Path) -> None:
    _write_text(staging / ALIGNMENT_FILE, json.dumps(alignment_record(collection), indent=1))
    _write_text(staging / RUN_FILE, json.dumps(_run_record(collection), indent=1))
    _write_text(staging / PAIRS_FILE, _pairs_table(collection))
    np.savez_compressed(
        staging / CORRESPONDENCES_FILE,
        names=np.array(collection.names),
        vertex_indices=np.stack(collection.samples),
        labels=collection.maps.labels,
        positions=collection.positions,
        consensus=collection.consensus,
    )


def _write_shapes(
    collection: AlignedCollection, staging: Path, *, report: bool, labels: Mapping[str, tuple[str, ...]] | None
) -> None:
    """Write what needs the shapes themselves, which are read once each, one in memory at a time."""
    num = len(collection.names)
    drawn = set(np.linspace(0, num - 1, min(num, _MAX_TILES)).round().astype(int).tolist())
    tiles: list[Tile] = []
    order = iter(range(num))

    def read_next(file: Path) -> Shape:
        """Read a shape, write its aligned copy and draw it, in the order of the collection."""
        i = next(order)
        shape = read_shape(file, collection.options.cleaning, name=collection.names[i])
        write_mesh(staging / MESH_FOLDER / f"{shape.name}.ply", aligned_shape(shape, collection.transforms[i]))
        if i in drawn:
            tiles.append(tile_of(shape, collection.transforms[i], float(collection.confidence[i])))
        return shape

    view = view_collection(collection, read_next, labels=labels)
    save_view(view, staging)
    draw_contact_sheet(tiles, staging / CONTACT_SHEET_FILE)
    if report:
        write_report(view, staging / REPORT_FILE, title=f"Aligned collection {collection.files[0].parent.name}")


def _run_record(collection: AlignedCollection) -> dict[str, Any]:
    return {**asdict(collection.run), "skipped": list(collection.skipped)}


def _pairs_table(collection: AlignedCollection) -> str:
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(_PAIR_COLUMNS)
    for pair in collection.pairs:
        writer.writerow(
            [
                collection.names[pair.target],
                collection.names[pair.source],
                repr(pair.energy),
                repr(pair.lower_bound),
                pair.status,
                int(pair.chirality_proven),
                len(pair.energies),
                pair.choice,
                int(pair.inlier),
                f"{pair.disagreement_deg:.3f}",
            ]
        )
    return table.getvalue()


def _move_into_place(staging: Path, folder: Path) -> tuple[Path, ...]:
    names = sorted(p.name for p in staging.iterdir() if p.name != ALIGNMENT_FILE)
    (folder / ALIGNMENT_FILE).unlink(missing_ok=True)
    if REPORT_FILE not in names:
        (folder / REPORT_FILE).unlink(missing_ok=True)
    for name in names:
        place = folder / name
        if place.is_dir():
            os.replace(place, staging / f"{name}.old")
        os.replace(staging / name, place)
    os.replace(staging / ALIGNMENT_FILE, folder / ALIGNMENT_FILE)
    return tuple(folder / name for name in [ALIGNMENT_FILE, *names])


def _write_text(path: Path, text: str) -> None:
    write_atomic(path, text.encode())


def _number(value: float) -> float | None:
    """Return a number that JSON knows: NaN becomes null."""
    return None if value != value else float(value)
