"""Formats of exports that tools for scans read: poses, and one cloud of all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from collalign.tools.export.request import ExportRequest, words
from data_tools.io.files import file_stems
from data_tools.io.shapes import write_mesh
from data_tools.io.text_tables import csv_text


def write_open3d(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``poses.log``, ``poses.json`` and ``poses.csv``: poses in the order of the shapes.

    Read by Open3D (``read_pinhole_camera_trajectory`` of the first, ``read_pose_graph`` of the second, which has a
    node a shape and no edges) and by tools that know the trajectories of redwood-data.org. The table has the names.
    """
    lines, nodes = [], []
    for at, pose in enumerate(request.transforms()):
        lines += [f"{at} {at} {at + 1}", *(words(row) for row in pose)]
        nodes.append(
            {
                "class_name": "PoseGraphNode",
                "pose": pose.T.ravel().tolist(),  # column by column
                "version_major": 1,
                "version_minor": 0,
            }
        )
    graph = {
        "class_name": "PoseGraph",
        "edges": [],
        "nodes": nodes,
        "version_major": 1,
        "version_minor": 0,
    }
    return (
        request.write("poses.log", "\n".join(lines) + "\n"),
        request.write("poses.json", json.dumps(graph, indent=1) + "\n"),
        request.write("poses.csv", _table(request)),
    )


def write_meshlab(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``scans.aln`` and the shapes in their own coordinates in ``meshes/`` next to it.

    Read by MeshLab, which places the shapes by the poses.
    """
    lines, paths = [str(len(request.collection))], []
    files = zip(file_stems(request.collection.names), request.transforms(), strict=True)
    for at, (stem, pose) in enumerate(files):
        name = f"meshes/{stem}.ply"
        paths.append(write_mesh(request.path(name), request.source_shape(at)))
        lines += [name, "#", *(words(row) for row in pose), "#"]
    return request.write("scans.aln", "\n".join([*lines, "0"]) + "\n"), *paths


def write_merged(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``merged.ply``, all vertices as one cloud with a label of each, and ``merged.csv``: what labels mean.

    The property ``label`` counts the shapes from 0. CloudCompare and MeshLab read it as a scalar.
    """
    poses = request.transforms()
    kind = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("label", "<i4")])
    blocks = []
    for at, pose in enumerate(poses):
        points = request.source_shape(at).transformed(pose).vertices
        block = np.empty(len(points), dtype=kind)
        block["x"], block["y"], block["z"] = points.T
        block["label"] = at
        blocks.append(block)
    merged = np.concatenate(blocks)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(merged)}",
        *(f"property double {axis}" for axis in "xyz"),
        "property int label",
        "end_header",
    ]
    path = request.path("merged.ply")
    path.write_bytes("\n".join(header).encode("ascii") + b"\n" + merged.tobytes())
    return path, request.write("merged.csv", _table(request))


def _table(request: ExportRequest) -> str:
    """Return a table of the shapes: number, name, file, group and confidence."""
    collection = request.collection
    columns = {
        "label": list(range(len(collection))),
        "name": list(collection.names),
        "file": list(collection.files),
        "group": collection.part_numbers.tolist(),
        "confidence": collection.confidence.tolist(),
    }
    return csv_text([columns, *zip(*columns.values(), strict=True)])
