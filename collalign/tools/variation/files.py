"""Writes the page, the meshes and the tables of a collection's shape variation."""

from __future__ import annotations

import html
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from collalign.analysis.symmetry import ObjectSymmetry
from collalign.output.evidence.members import LEFT_OUT_FILE, Members
from collalign.output.provenance import write_tool_record
from collalign.output.report.page import render_page
from collalign.output.views import UNNAMED
from collalign.products.named_frame import NamedFrame
from collalign.tools.variation.page_content import build_variation
from collalign.tools.variation.shape_statistics import (
    SYMMETRY_FOLDER,
    ShapeTests,
    write_symmetry_tables,
    write_tables,
)
from collalign.tools.variation.surface_variation import (
    NUM_COMPONENTS,
    QUALITY_HEADING,
    SurfaceVariation,
    group_means,
    signed_offsets,
)
from collalign.wording import note_text
from data_tools.arrays import FloatArray
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import file_stems, write_atomic
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import write_ply

PAGE_FILE = "variation.html"
#: Where in a result's folder the page is, which its report names.
DEFAULT_FOLDER = "variation"
#: What a reader of the tables must know, one note a line.
NOTES_FILE = "notes.txt"
QUALITY_FILE = "quality.csv"
#: Of the surfaces drawn along a component.
DEVIATIONS = 2.0
_WRITER = "variation"


def write_variation(
    variation: SurfaceVariation,
    to: Path,
    *,
    columns: dict[str, tuple[str, ...]],
    tests: ShapeTests,
    landmarks: tuple[tuple[str, ...], FloatArray],
    symmetry: ObjectSymmetry | None = None,
    frame: NamedFrame = UNNAMED,
    version: str = "",
    who: Members,
    record: Mapping[str, Any] = MappingProxyType({}),
) -> tuple[Path, ...]:
    """Write everything into a folder and return the paths, the page first.

    Parameters
    ----------
    variation : SurfaceVariation
    to : Path
    columns : dict of str to tuple of str
        Labels of the shapes.
    tests : ShapeTests
        Of the same columns.
    landmarks : (names, points)
        On the mean, see :func:`collalign.tools.variation.page_content.build_variation`.
    symmetry : ObjectSymmetry, optional
        Of bilateral shapes.
    frame : NamedFrame
        From where the page looks first.
    version : str
        Of the toolkit, for the page's last line.
    who : Members
        Who counts; ``left_out.csv`` names the others.
    record : mapping of str to Any
        What decided the files, for the record.

    Raises
    ------
    InputError
        If the folder cannot be written or files of somebody else's are in the way.
    """
    with OutputFolder.open(to, writer=_WRITER) as output:
        document, blobs = build_variation(variation, columns, landmarks, tests, symmetry, frame)
        page = render_page("Shape variation", _summary(variation), document, blobs, version=version)
        write_atomic(output.stage(PAGE_FILE), page.encode("utf-8", "backslashreplace"))
        write_tables(variation, columns, tests.tables, output)
        notes = "".join(f"{note_text(note)}\n" for note in variation.notes)
        write_atomic(output.stage(NOTES_FILE), notes.encode("utf-8", "backslashreplace"))
        write_atomic(output.stage(LEFT_OUT_FILE), who.table)
        if variation.quality is not None:
            rows = csv_text([QUALITY_HEADING, *variation.quality.rows])
            write_atomic(output.stage(QUALITY_FILE), rows.encode("utf-8", "backslashreplace"))
        write_tool_record(output, _WRITER, record)
        _write_meshes(variation, {name: columns[name] for name in tests.factors}, output)
        if symmetry is not None:
            write_symmetry_tables(variation.names, symmetry, columns, output)
            _write_asymmetry(variation, symmetry, output)
        return output.publish(last=PAGE_FILE, complete=True)


def _summary(variation: SurfaceVariation) -> str:
    shares = variation.components.shares
    facts = [
        (str(len(variation.names)), "surfaces in correspondence"),
        (str(len(variation.mean)), "points on each"),
        *((f"{100 * share:.0f} %", f"of the variance on component {at}") for at, share in enumerate(shares[:3], 1)),
    ]
    items = "".join(f"<li><strong>{value}</strong>{html.escape(words)}</li>" for value, words in facts)
    listed = "".join(f"<li>{html.escape(note_text(note))}</li>" for note in variation.notes)
    return f'<ul class="facts">{items}</ul>' + (f'<ul class="notes">{listed}</ul>' if listed else "")


def _write_meshes(variation: SurfaceVariation, columns: dict[str, tuple[str, ...]], output: OutputFolder) -> None:
    """Write the mean, both ends of each component, group means and specimens, with offsets from the mean."""

    def write(folder: str, stem: str, vertices: FloatArray) -> None:
        offset = signed_offsets(variation.mean, variation.faces, vertices)
        write_ply(output.stage(folder, f"{stem}.ply"), vertices, variation.faces, offset=offset)

    write("components", "mean", variation.mean)
    for at in range(min(NUM_COMPONENTS, len(variation.components.shares))):
        for side, sign in (("low", -1), ("high", 1)):
            write("components", f"PC{at + 1}-{side}", variation.components.shape_at(at, sign * DEVIATIONS))
    means = {
        f"{column}-{kind}": mean
        for column, values in columns.items()
        for kind, mean in group_means(variation.shapes, values).items()
    }
    for stem, mean in zip(file_stems(means), means.values(), strict=True):
        write("groups", stem, mean)
    for stem, shape in zip(file_stems(variation.names), variation.shapes, strict=True):
        write("specimens", stem, shape)


def _write_asymmetry(variation: SurfaceVariation, symmetry: ObjectSymmetry, output: OutputFolder) -> None:
    """Write the symmetric mean and, on it, the asymmetric component of all together and of every specimen."""
    stems = ["mean", *(f"specimens/{stem}" for stem in file_stems(variation.names))]
    for stem, parts in zip(stems, [symmetry.directional, *symmetry.asymmetric], strict=True):
        vertices = symmetry.mean + parts
        offset = signed_offsets(symmetry.mean, variation.faces, vertices)
        path = output.stage(SYMMETRY_FOLDER, *f"{stem}.ply".split("/"))
        write_ply(path, vertices, variation.faces, asymmetry=offset)
