"""Formats of exports: landmarks and meshes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collalign.tools.export.request import (
    ExportRequest,
    complete_labels,
    label_columns,
    member_columns,
    specimen_comment,
    words,
)
from data_tools.arrays import FloatArray
from data_tools.io.files import distinct_forms, file_stems
from data_tools.io.shapes import LPS_RAS, CoordinateSystem, write_mesh
from data_tools.io.text_tables import csv_text
from data_tools.landmark_files import SemilandmarkRows

#: Section names of morphologika files. Readers search for them anywhere in a line, so no specimen may contain one.
_SECTIONS = (
    "individuals",
    "landmarks",
    "dimensions",
    "names",
    "labels",
    "labelvalues",
    "rawpoints",
    "wireframe",
    "groups",
)


def without_blanks(name: str) -> str:
    """Return a name as an export writes it, with an underscore for each run of blanks, quotes and brackets."""
    return re.sub(r"[\s'\"\[\]]+", "_", name)


def for_morphologika(name: str) -> str:
    """Return a name without blanks in which no section's name occurs: ``names_1`` becomes ``n-ames_1``."""
    safe = without_blanks(name)
    for section in _SECTIONS:
        safe = re.sub(
            section, lambda found: f"{found[0][0]}-{found[0][1:]}", safe, flags=re.IGNORECASE
        )
    return safe


def specimen_table(request: ExportRequest, written: list[str]) -> Path:
    """Write ``specimens.csv``: shape, size, confidence, whether it counts, and labels of every specimen of a file."""
    collection = request.collection
    columns: dict[str, list[Any]] = {
        "name": list(collection.names),
        "id": written,
        "file": list(collection.files),
        "centroid_size_landmarks": collection.centroid_sizes.tolist(),
        "confidence": collection.confidence.tolist(),
        "reflected": collection.reflected.astype(int).tolist(),
        "coordinates": [
            specimen_comment(space=request.space, reflected=side)
            for side in collection.reflected.tolist()
        ],
        "group": collection.part_numbers.tolist(),
        **member_columns(request),
    }
    columns |= label_columns(collection, columns)
    return request.write("specimens.csv", csv_text([columns, *zip(*columns.values(), strict=True)]))


def write_tps(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``landmarks.tps`` and ``specimens.csv``.

    Read by tpsDig, geomorph (``readland.tps``), Morpho (``readallTPS``) and MorphoJ.

    Three-dimensional blocks begin with ``LM3=``; missing landmarks are NaN; there is no SCALE line, because readers
    would multiply by it.
    """
    _, coordinates = request.landmarks()
    names = distinct_forms(request.collection.names, without_blanks)
    comments = [
        specimen_comment(space=request.space, reflected=side)
        for side in request.collection.reflected.tolist()
    ]
    return request.write("landmarks.tps", tps_text(names, coordinates, comments)), specimen_table(
        request, names
    )


def tps_text(names: Sequence[str], coordinates: FloatArray, comments: Sequence[str]) -> str:
    """Return a TPS file of configurations, shape (N, k, 3); names are single words, comments free of "="."""
    lines = []
    for name, points, comment in zip(names, coordinates, comments, strict=True):
        lines += [
            f"LM3={len(points)}",
            *(words(point) for point in points),
            f"ID={name}",
            f"COMMENT={comment}",
        ]
    return "\n".join(lines) + "\n"


def write_morphologika(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``landmarks.morphologika.txt`` and ``specimens.csv``; missing landmarks are NaN.

    Read by morphologika, geomorph (``read.morphologika``), MorphoJ and EVAN Toolbox.
    Labels become the sections ``[labels]`` and ``[labelvalues]``, blanks in them underscores, unknown ones NA.
    """
    landmarks, coordinates = request.landmarks()
    names = distinct_forms(request.collection.names, for_morphologika)
    lines = [
        "[individuals]",
        str(len(names)),
        "[landmarks]",
        str(len(landmarks)),
        "[dimensions]",
        "3",
    ]
    lines += ["[names]", *names]
    columns = request.collection.labels
    if columns:
        lines += [
            "[labels]",
            " ".join(without_blanks(column) for column in columns),
            "[labelvalues]",
        ]
        for values in zip(*columns.values(), strict=True):
            lines.append(" ".join(for_morphologika(value) if value else "NA" for value in values))
    lines.append("[rawpoints]")
    for name, points in zip(names, coordinates, strict=True):
        lines += [f"'{name}", *(words(point) for point in points)]
    path = request.write("landmarks.morphologika.txt", "\n".join(lines) + "\n")
    return path, specimen_table(request, names)


SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)


def write_markups(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.mrk.json`` per shape: missing landmarks are ``undefined``, curves are markups of their own.

    Coordinates are the mesh's own numbers, declared as what its file declares or else LPS: Slicer takes PLY and OBJ
    files without a declaration as LPS too, so that landmarks and meshes coincide. No unit is declared: neither the
    formats that are read here nor the common frame say which one theirs is, and the schema does not ask for one.
    """
    labels, coordinates = request.landmarks()
    curves = tuple(one for one in request.semilandmarks if one.kind != "patch")
    files = zip(
        file_stems(request.collection.names), coordinates, request.landmark_systems(), strict=True
    )
    return tuple(
        request.write(
            f"{stem}.mrk.json",
            json.dumps(_markups(labels, points, curves, system), indent=1) + "\n",
        )
        for stem, points, system in files
    )


def _markups(
    labels: tuple[str, ...],
    points: FloatArray,
    curves: tuple[SemilandmarkRows, ...],
    system: CoordinateSystem,
) -> dict[str, Any]:
    on_curves = {row for curve in curves for row in curve.rows}
    alone = [row for row in range(len(labels)) if row not in on_curves]
    lists = [("Fiducial", alone)] if alone or not curves else []
    lists += [
        ("ClosedCurve" if curve.kind == "closed curve" else "Curve", list(curve.rows))
        for curve in curves
    ]
    markups = [
        {
            "type": kind,
            "coordinateSystem": system,
            "controlPoints": [
                _control(at, labels[row], points[row]) for at, row in enumerate(rows, start=1)
            ],
        }
        for kind, rows in lists
    ]
    return {"@schema": SCHEMA, "markups": markups}


def _control(number: int, label: str, point: FloatArray) -> dict[str, Any]:
    known = bool(np.isfinite(point).all())
    control: dict[str, Any] = {"id": str(number), "label": label}
    if known:
        control["position"] = point.tolist()
    return control | {
        "orientation": [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
        "positionStatus": "defined" if known else "undefined",
    }


def mesh_writer(ending: str) -> Callable[[ExportRequest], tuple[Path, ...]]:
    """Return the export of aligned meshes in one format: ``ply``, ``obj`` or ``stl``.

    Meshes are written at full resolution, with normals outwards where the pose mirrors, and without colours, texture
    coordinates and materials.
    """

    def write(request: ExportRequest) -> tuple[Path, ...]:
        """Write ``NAME.<ending>`` per shape, and ``NAME/PART.<ending>`` of its parts, one shape at a time."""
        transforms, written = request.transforms(), list[Path]()
        for at, stem in enumerate(file_stems(request.collection.names)):
            shape = request.source_shape(at).transformed(transforms[at])
            pieces = {stem: shape} | {
                f"{stem}/{part}": piece for part, piece in shape.split().items()
            }
            written += [
                write_mesh(request.path(f"{name}.{ending}"), piece)
                for name, piece in pieces.items()
            ]
        return tuple(written)

    return write


def write_transforms(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.tfm`` per shape: the *inverse* of its pose, from the common frame to file coordinates.

    Read by 3D Slicer, SimpleITK, ANTs and ITK-SNAP.
    ITK's transforms take points of the fixed (common) space to the moving one, and 3D Slicer inverts them on loading:
    applied there to the original mesh, the file moves it onto the aligned one. In SimpleITK, ``GetInverse()`` is the
    pose. Coordinates are the mesh's own, read as LPS, as Slicer reads meshes, unless its file declares RAS.
    """
    paths = []
    files = zip(
        file_stems(request.collection.names),
        request.transforms(),
        request.file_systems(),
        strict=True,
    )
    for stem, transform, system in files:
        inverse = np.linalg.inv(transform)
        if system == "RAS":
            inverse[:3] *= LPS_RAS[:, None]
        numbers = [*inverse[:3, :3].ravel(), *inverse[:3, 3]]
        lines = [
            "#Insight Transform File V1.0",
            "#Transform 0",
            "Transform: AffineTransform_double_3_3",
            f"Parameters: {words(numbers)}",
            "FixedParameters: 0 0 0",
        ]
        paths.append(request.write(f"{stem}.tfm", "\n".join(lines) + "\n"))
    return tuple(paths)


def write_shapeworks(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``project.swproj`` with ``meshes/`` and ``particles/`` next to it; all paths in it are relative.

    Local particles are samples in file coordinates, world particles the same in the common frame, and the alignment
    is the pose (16 numbers, row-major). Only labels that every shape has become particles; a particle file ends in a
    line end, without which its last point would be lost. ShapeWorks reads every section as maps from text to
    text (``JsonProjectReader``), so that numbers are written as text too.
    """
    collection = request.collection
    common = complete_labels(collection)
    local, world = collection.landmarks[:, common], collection.aligned_landmarks[:, common]
    paths, entries = [], []
    for at, stem in enumerate(file_stems(collection.names)):
        files = {
            "mesh": f"meshes/{stem}.ply",
            "local": f"particles/{stem}_local.particles",
            "world": f"particles/{stem}_world.particles",
        }
        paths.append(write_mesh(request.path(files["mesh"]), request.source_shape(at)))
        paths.append(request.write(files["local"], _particles(local[at])))
        paths.append(request.write(files["world"], _particles(world[at])))
        entries.append(
            {
                "name": collection.names[at],
                "shape_1": files["mesh"],
                "groomed_1": files["mesh"],
                "alignment_1": words(collection.transforms[at].ravel()),
                "local_particles_1": files["local"],
                "world_particles_1": files["world"],
                **{f"group_{column}": values[at] for column, values in collection.labels.items()},
            }
        )
    project = {"data": entries, "optimize": {"number_of_particles": str(int(np.sum(common)))}}
    return request.write("project.swproj", json.dumps(project, indent=1) + "\n"), *paths


def _particles(points: FloatArray) -> str:
    return "".join(words(point) + "\n" for point in points)
