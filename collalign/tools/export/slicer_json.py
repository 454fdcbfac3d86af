"""Markups of 3D Slicer (``.mrk.json``), as SlicerMorph reads them: one file per shape."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from collalign.tools.export.request import ExportRequest
from data_tools.arrays import FloatArray
from data_tools.io.coordinate_systems import CoordinateSystem
from data_tools.io.files import file_stems
from data_tools.landmarks.landmark_files import SemilandmarkRows

SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.mrk.json`` per shape: missing landmarks are ``undefined``, curves are markups of their own.

    Coordinates are the mesh's own numbers, declared as what its file declares or else LPS: Slicer takes PLY and OBJ
    files without a declaration as LPS too, so that landmarks and meshes coincide. No unit is declared: neither the
    formats that are read here nor the common frame say which one theirs is, and the schema does not ask for one.
    """
    labels, coordinates = request.landmarks()
    curves = tuple(one for one in request.semilandmarks if one.kind != "patch")
    files = zip(file_stems(request.collection.names), coordinates, request.landmark_systems(), strict=True)
    return tuple(
        request.write(f"{stem}.mrk.json", json.dumps(_markups(labels, points, curves, system), indent=1) + "\n")
        for stem, points, system in files
    )


def _markups(
    labels: tuple[str, ...], points: FloatArray, curves: tuple[SemilandmarkRows, ...], system: CoordinateSystem
) -> dict[str, Any]:
    on_curves = {row for curve in curves for row in curve.rows}
    alone = [row for row in range(len(labels)) if row not in on_curves]
    lists = [("Fiducial", alone)] if alone or not curves else []
    lists += [("ClosedCurve" if curve.kind == "closed curve" else "Curve", list(curve.rows)) for curve in curves]
    markups = [
        {
            "type": kind,
            "coordinateSystem": system,
            "controlPoints": [_control(at, labels[row], points[row]) for at, row in enumerate(rows, start=1)],
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
