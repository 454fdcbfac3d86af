"""Markups of 3D Slicer (``.mrk.json``), as SlicerMorph reads them: one file per shape."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from collalign.output.exports.request import ExportRequest
from data_tools.arrays import FloatArray
from data_tools.io.output_folder import file_stems

SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.mrk.json`` per shape; missing landmarks have the status ``undefined``.

    Coordinates are the mesh's own numbers, declared LPS: Slicer takes PLY and OBJ files without a declaration as LPS
    too, so that landmarks and meshes coincide. No unit is declared: neither the formats that are read here nor the
    common frame say which one theirs is, and the schema does not ask for one.
    """
    labels, coordinates = request.landmarks()
    files = zip(file_stems(request.view.names), coordinates, strict=True)
    return tuple(
        request.write(f"{stem}.mrk.json", json.dumps(_markups(labels, points), indent=1) + "\n")
        for stem, points in files
    )


def _markups(labels: tuple[str, ...], points: FloatArray) -> dict[str, Any]:
    controls = []
    for number, (label, point) in enumerate(zip(labels, points, strict=True), start=1):
        known = bool(np.isfinite(point).all())
        control: dict[str, Any] = {"id": str(number), "label": label}
        if known:
            control["position"] = point.tolist()
        control |= {
            "orientation": [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
            "positionStatus": "defined" if known else "undefined",
        }
        controls.append(control)
    markup = {
        "type": "Fiducial",
        "coordinateSystem": "LPS",
        "controlPoints": controls,
    }
    return {"@schema": SCHEMA, "markups": [markup]}
