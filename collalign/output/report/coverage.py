"""What the page shows of incomplete shapes: what of each has a counterpart, and what it covers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from collalign.output.collection import Collection
from collalign.output.report.payload import pack_mesh
from collalign.products.incomplete import Incomplete
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


@dataclass(frozen=True, eq=False)
class _Posed:
    """A display mesh in the common frame."""

    vertices: FloatArray
    faces: IntArray

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.vertices)

    @cached_property
    def on_rim(self) -> BoolArray:
        """Which vertices lie on the rim."""
        if not len(self.faces):
            return cloud_rim(self.vertices, plane_normals(self.vertices, self.vertices))
        found = np.zeros(len(self.vertices), dtype=bool)
        found[boundary_edges(self.faces).ravel()] = True
        return found

    @cached_property
    def radius(self) -> float:
        return float(np.sqrt(((self.vertices - self.vertices.mean(axis=0)) ** 2).sum(axis=1).mean()))

    @cached_property
    def spacing(self) -> float:
        """How far its vertices lie apart: so much nearer is its surface than its nearest vertex, at most."""
        return float(np.median(self.tree.query(self.vertices, k=2)[0][:, 1]))

    def has(self, places: FloatArray) -> BoolArray:
        """Return which places have a counterpart on this surface."""
        distances, nearest = self.tree.query(places)
        return ~lies_beyond(np.maximum(distances - self.spacing, 0.0), self.on_rim[nearest], self.radius)


def incomplete_content(collection: Collection) -> tuple[dict[str, Any], Meshes]:
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
    posed = {i: _posed(collection, i) for one in listed for i in (one.shape, *one.partners.tolist())}
    meshes: Meshes = {}
    content: dict[str, Any] = {
        "shapes": [_entry(collection, one) for one in listed],
        "drawn": min(len(listed), MOST_DRAWN),
    }
    for entry, one in zip(content["shapes"], listed[:MOST_DRAWN], strict=False):
        others = [posed[i] for i in one.partners.tolist()]
        own = posed[one.shape]
        shares = np.mean([other.has(own.vertices) for other in others], axis=0)
        entry["own"] = name = f"coverage-{one.shape}"
        meshes[name] = pack_mesh(collection.vertices[one.shape], own.faces, _NONE, shares)
    return content, meshes


def _entry(collection: Collection, one: Incomplete) -> dict[str, Any]:
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


def _posed(collection: Collection, at: int) -> _Posed:
    T = collection.transforms[at]
    return _Posed(moved_by(T, collection.vertices[at]), collection.faces[at])
