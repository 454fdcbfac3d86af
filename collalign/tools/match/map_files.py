"""What a non-rigid match leaves in a folder: the map both ways, picture, coloured surfaces, landmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from collalign.landmarks.on_surface import place_templates
from collalign.landmarks.templates import read_templates
from collalign.output.vertex_maps import at_vertices
from collalign.tools.match.pictures import match_figure, transferred_colours, vertices_map
from collalign.tools.match.result import NonrigidMatch
from data_tools.arrays import FloatArray
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import write_ply
from data_tools.landmarks.landmark_files import Landmarks
from data_tools.notes import Note
from data_tools.surface.shape import Shape

LANDMARKS_FILE = "map_landmarks.csv"
NONRIGID_FILES = (
    "map.npz", "map.txt", "map_back.txt", "map.png", "map_target.ply", "map_source.ply", LANDMARKS_FILE,
)  # fmt: skip


def stage_match(
    output: OutputFolder,
    found: NonrigidMatch,
    left: Shape,
    right: Shape,
    placed: Mapping[str, Landmarks],
) -> None:
    """Stage all files of a match.

    Parameters
    ----------
    output : OutputFolder
    found : NonrigidMatch
    left, right : Shape
        The target and the source, as stored.
    placed : mapping of str to Landmarks
        Those of either, see :func:`placed_landmarks`.
    """
    found.stage(output)
    point_map = vertices_map(found.point_map_target_source, left, right)
    confidence = at_vertices(np.append(found.vertex_confidence, np.nan), right)
    figure = match_figure(left, right, point_map, confidence, title=found.summary)
    figure.savefig(output.stage("map.png"), format="png", metadata={"Software": None})
    of_target, of_source = transferred_colours(left, point_map)
    _write_coloured(output.stage("map_target.ply"), left, of_target)
    _write_coloured(output.stage("map_source.ply"), right, of_source, confidence=confidence)
    if placed:
        write_atomic(
            output.stage(LANDMARKS_FILE),
            csv_text(carried_rows(found, (left, right), placed)).encode(),
        )


def placed_landmarks(
    files: Mapping[str, Path], shapes: Sequence[Shape], landmarks: Sequence[Path]
) -> tuple[dict[str, Landmarks], tuple[Note, ...]]:
    """Return the landmarks that some files hold of two shapes, by shape and in its coordinates, and notes on them.

    Raises
    ------
    InputError
        If a file belongs to neither shape, or its landmarks do not lie on that.
    """
    given = read_templates(landmarks, [shape.name for shape in shapes])
    meshes = [(shape.name, shape.vertices, shape.faces) for shape in shapes]
    placed, notes, _ = place_templates(given, {name: files[name] for name in given}, meshes)
    return placed, notes


def carried_rows(
    found: NonrigidMatch, shapes: tuple[Shape, Shape], placed: Mapping[str, Landmarks]
) -> list[list[str]]:
    """Return where landmarks of either shape are on the other one: a header, and a row for each.

    A landmark goes with the vertex that is nearest to it; its confidence is that of the vertex of the source, and it
    has no place where that has no counterpart.
    """
    rows = [["name", "landmark", "x", "y", "z", "confidence"]]
    for name, marks in placed.items():
        is_target = name == shapes[0].name
        on, other = shapes if is_target else shapes[::-1]
        to_source = vertices_map(found.point_map_source_target, shapes[1], shapes[0])
        to_target = vertices_map(found.point_map_target_source, *shapes)
        confidence = at_vertices(np.append(found.vertex_confidence, np.nan), shapes[1])
        for label, point in zip(marks.labels, marks.points, strict=True):
            own = int(((on.vertices - point) ** 2).sum(axis=1).argmin())
            image = int((to_source if is_target else to_target)[own])
            trust = confidence[image if is_target else own]
            known = image >= 0 and bool(np.isfinite(point).all())
            place = [*other.vertices[image], trust] if known else [np.nan] * 4
            rows.append(
                [other.name, label, *("" if np.isnan(value) else f"{value:.6g}" for value in place)]
            )
    return rows


def _write_coloured(path: Path, shape: Shape, colours: FloatArray, **values: FloatArray) -> Path:
    """Write a PLY with colours, and with values as further properties of the vertices."""
    channels = zip(
        ("red", "green", "blue"), np.round(255 * colours).astype(np.uint8).T, strict=True
    )
    return write_ply(path, shape.vertices, shape.faces, **dict(channels), **values)
