"""What the page shows of incomplete shapes: what of each has a counterpart, and what it covers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from collalign.output.collection_data import CollectionData
from collalign.output.report.payload import pack_mesh
from collalign.products.shapes import Incomplete
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.embedding.surface_points import cloud_rim, plane_normals
from data_tools.poses import moved_by
from data_tools.surface.closest import lies_beyond
from data_tools.surface.topology import boundary_edges

#: Incomplete shapes that are drawn, those that cover least.
MOST_DRAWN = 40
_NONE = np.empty((0, 3))

#: Packed meshes by name.
Meshes = dict[str, tuple[dict[str, Any], str]]


def counterparts_on(vertices: FloatArray, faces: IntArray) -> Callable[[FloatArray], BoolArray]:
    """Return a function that says which places (p, 3) have a counterpart on a mesh (v, 3), (f, 3)."""
    tree, on_rim = cKDTree(vertices), np.zeros(len(vertices), dtype=bool)
    if len(faces):
        on_rim[boundary_edges(faces).ravel()] = True
    else:
        on_rim = cloud_rim(vertices, plane_normals(vertices, vertices))
    radius = float(np.sqrt(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1).mean()))
    # So much nearer than its nearest vertex is its surface, at most.
    spacing = float(np.median(tree.query(vertices, k=2)[0][:, 1]))

    def has(places: FloatArray) -> BoolArray:
        distances, nearest = tree.query(places)
        return ~lies_beyond(np.maximum(distances - spacing, 0.0), on_rim[nearest], radius)

    return has


def incomplete_content(collection: CollectionData) -> tuple[dict[str, Any], Meshes]:
    """Return what is drawn and listed of the incomplete shapes; nothing where all are complete.

    Returns
    -------
    content : dict
        ``shapes``, and how many of them are ``drawn``.
    meshes : dict of str to (info, text)
        In file coordinates of the shape that each is drawn with. Values are shares in [0, 1].
    """
    if not collection.incomplete:
        return {}, {}
    listed = sorted(collection.incomplete, key=lambda one: (one.coverage, one.shape))
    drawn, vertices, faces = listed[:MOST_DRAWN], collection.vertices, collection.faces
    partners = {i for one in drawn for i in one.partners.tolist()}
    has = {i: counterparts_on(moved_by(collection.transforms[i], vertices[i]), faces[i]) for i in partners}
    meshes: Meshes = {}
    content: dict[str, Any] = {
        "shapes": [_entry(collection, one) for one in listed],
        "drawn": len(drawn),
    }
    for entry, one in zip(content["shapes"], drawn, strict=False):
        own = moved_by(collection.transforms[one.shape], vertices[one.shape])
        found = [has[i](own) for i in one.partners.tolist()]
        shares = np.mean(found, axis=0) if found else np.zeros(len(own))
        entry["own"] = name = f"coverage-{one.shape}"
        meshes[name] = pack_mesh(vertices[one.shape], faces[one.shape], _NONE, shares)
    return content, meshes


def _entry(collection: CollectionData, one: Incomplete) -> dict[str, Any]:
    """Return what is known of one shape without pictures."""
    return {
        "shape": one.shape,
        "reason": one.reason,
        "coverage": one.coverage,
        "partners": one.partners,
        "overlaps": one.overlaps,
        "points": [
            int(np.isfinite(collection.landmarks[one.shape]).all(axis=1).sum()),
            collection.landmarks.shape[1],
        ],
    }
