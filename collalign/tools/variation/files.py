"""Files of a variation: the page, the mean surface and its modes, and tables."""

from __future__ import annotations

import html
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.analysis.symmetry import ObjectSymmetry
from collalign.engine.command_line import json_types
from collalign.output.members import LEFT_OUT_FILE, Members
from collalign.output.provenance import write_tool_record
from collalign.output.report.page import render_page
from collalign.output.report.payload import pack, sample_colors
from collalign.output.views import FEWEST_FACES, UNNAMED, camera, display_mesh
from collalign.products.named_frame import NamedFrame
from collalign.tools.variation.shape_statistics import (
    SYMMETRY_FOLDER,
    ShapeTests,
    procrustes_scores,
    symmetry_rows,
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
from data_tools.io.files import file_stems
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import write_ply
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import vertex_normals

#: Triangles of the mean that is drawn, and what all shapes together may have.
_MOST_FACES, _FACES_OF_PAGE = 8_000, 700_000
_LARGEST = int(np.iinfo(np.int16).max)
#: How much more than the mean is in view, for what is moved away from it.
_ROOM = 1.1


def build_variation(
    variation: SurfaceVariation,
    columns: dict[str, tuple[str, ...]],
    landmarks: tuple[tuple[str, ...], FloatArray],
    tests: ShapeTests,
    symmetry: ObjectSymmetry | None = None,
    frame: NamedFrame = UNNAMED,
) -> tuple[dict[str, Any], dict[str, str]]:
    """Collect the page's content.

    Parameters
    ----------
    variation : SurfaceVariation
    columns : dict of str to tuple of str
        Labels of the shapes, "" where unknown.
    landmarks : (names, points)
        Points (l, 3) on the mean, in its coordinates; NaN where a landmark is on no template.
    tests : ShapeTests
        Of the same columns.
    symmetry : ObjectSymmetry, optional
    frame : NamedFrame
        From where the surfaces are looked at first.

    Returns
    -------
    document : dict
        JSON types only.
    blobs : dict of str to str
        Base64 text by the element's id.
    """
    num = len(variation.names)
    most = int(np.clip(_FACES_OF_PAGE // num, FEWEST_FACES, _MOST_FACES))
    vertices, faces = display_mesh(variation.mean, variation.faces, max_faces=most)
    places = SurfaceLocator(variation.mean, variation.faces).closest(vertices)
    mean = places.on(variation.mean)
    count = min(NUM_COMPONENTS, len(variation.components.shares))
    deviations = np.sqrt(variation.components.variances[:count])
    axes = [
        d * places.on(axis)
        for d, axis in zip(deviations, variation.components.axes[:count], strict=True)
    ]
    surfaces = {
        "mean": mean,
        "axes": np.array(axes),
        "shapes": np.stack([places.on(shape) - mean for shape in variation.shapes]),
    }
    if symmetry is not None:
        parts = [symmetry.directional, *symmetry.asymmetric]
        surfaces |= {
            "symmetricMean": places.on(symmetry.mean),
            "asymmetric": np.stack([places.on(part) for part in parts]),
        }
    if variation.quality is not None:
        relative = variation.quality.distances / variation.quality.radii[:, None]
        surfaces["distances"] = relative[:, places.nearest]
    steps = {
        name: float(np.abs(values).max()) / _LARGEST or 1.0 for name, values in surfaces.items()
    }
    arrays: dict[str, NDArray[Any]] = {
        **{
            name: np.round(values / steps[name]).astype(np.int16)
            for name, values in surfaces.items()
        },
        "faces": faces.astype(np.uint16 if len(mean) <= np.iinfo(np.uint16).max else np.uint32),
        "colors": np.round(255 * sample_colors(mean[None])).astype(np.uint8),
    }
    fields, text = pack(arrays)
    view = camera([(mean, faces)], frame)
    document = {
        "kind": "variation",
        "camera": {
            "R": view,
            "extent": _ROOM * np.abs(mean @ view.T).max(axis=0) / np.abs(mean).max(),
        },
        "names": variation.names,
        "tables": tests.tables,
        "factors": tests.factors,
        "tests": {
            "sumsOfSquares": tests.options.sums_of_squares,
            "permutations": tests.options.permutations,
            "seed": tests.options.seed,
        },
        "columns": columns,
        "centroidSizes": variation.centroid_sizes,
        "fields": fields,
        "steps": steps,
        "numVertices": len(mean),
        "shares": variation.components.shares[:count],
        "deviations": deviations,
        "scores": procrustes_scores(variation.components)[:, :count],
        "landmarks": _shown(variation, *landmarks),
        "quality": None
        if variation.quality is None
        else [QUALITY_HEADING, *variation.quality.rows],
        "symmetry": None if symmetry is None else _asymmetries(symmetry),
    }
    return dict(json_types(document)), {"variation": text}


def _asymmetries(symmetry: ObjectSymmetry) -> dict[str, Any]:
    return {
        "asymmetry": symmetry.asymmetry,
        "fluctuating": symmetry.fluctuating,
        "anova": symmetry_rows(symmetry.anova),
    }


def _shown(
    variation: SurfaceVariation, names: tuple[str, ...], points: FloatArray
) -> dict[str, Any]:
    """Return the landmarks on the mean with outward directions, by which the page hides some; 0 on a cloud."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    points, normals = points[known], np.zeros((int(known.sum()), 3))
    if len(points) and len(variation.faces):
        places = SurfaceLocator(variation.mean, variation.faces).closest(points)
        normals = places.on(vertex_normals(variation.mean, variation.faces))
    shown = [name for name, there in zip(names, known, strict=True) if there]
    return {"names": shown, "points": points, "normals": normals}


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
        On the mean, see :func:`collalign.tools.variation.files.build_variation`.
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
        output.stage_text(page, PAGE_FILE)
        write_tables(variation, columns, tests.tables, output)
        notes = "".join(f"{note_text(note)}\n" for note in variation.notes)
        output.stage_text(notes, NOTES_FILE)
        output.stage_table(who.table, LEFT_OUT_FILE)
        if variation.quality is not None:
            output.stage_table([QUALITY_HEADING, *variation.quality.rows], QUALITY_FILE)
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
        *(
            (f"{100 * share:.0f} %", f"of the variance on component {at}")
            for at, share in enumerate(shares[:3], 1)
        ),
    ]
    items = "".join(
        f"<li><strong>{value}</strong>{html.escape(words)}</li>" for value, words in facts
    )
    listed = "".join(f"<li>{html.escape(note_text(note))}</li>" for note in variation.notes)
    return f'<ul class="facts">{items}</ul>' + (
        f'<ul class="notes">{listed}</ul>' if listed else ""
    )


def _write_meshes(
    variation: SurfaceVariation, columns: dict[str, tuple[str, ...]], output: OutputFolder
) -> None:
    """Write the mean, both ends of each component, group means and specimens, with offsets from the mean."""

    def write(folder: str, stem: str, vertices: FloatArray) -> None:
        offset = signed_offsets(variation.mean, variation.faces, vertices)
        write_ply(output.stage(folder, f"{stem}.ply"), vertices, variation.faces, offset=offset)

    write("components", "mean", variation.mean)
    for at in range(min(NUM_COMPONENTS, len(variation.components.shares))):
        for side, sign in (("low", -1), ("high", 1)):
            write(
                "components",
                f"PC{at + 1}-{side}",
                variation.components.shape_at(at, sign * DEVIATIONS),
            )
    means = {
        f"{column}-{kind}": mean
        for column, values in columns.items()
        for kind, mean in group_means(variation.shapes, values).items()
    }
    for stem, mean in zip(file_stems(means), means.values(), strict=True):
        write("groups", stem, mean)
    for stem, shape in zip(file_stems(variation.names), variation.shapes, strict=True):
        write("specimens", stem, shape)


def _write_asymmetry(
    variation: SurfaceVariation, symmetry: ObjectSymmetry, output: OutputFolder
) -> None:
    """Write the symmetric mean and, on it, the asymmetric component of all together and of every specimen."""
    stems = ["mean", *(f"specimens/{stem}" for stem in file_stems(variation.names))]
    for stem, parts in zip(stems, [symmetry.directional, *symmetry.asymmetric], strict=True):
        vertices = symmetry.mean + parts
        offset = signed_offsets(symmetry.mean, variation.faces, vertices)
        path = output.stage(SYMMETRY_FOLDER, *f"{stem}.ply".split("/"))
        write_ply(path, vertices, variation.faces, asymmetry=offset)
