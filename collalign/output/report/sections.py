"""Parts of the report: poses to choose among, statistics, and what is shown of incomplete shapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from collalign.analysis.procrustes import classical_mds, common_labels, procrustes_distances
from collalign.output.collection_data import CollectionData
from collalign.output.members import statistics_members
from collalign.output.report.payload import pack_mesh
from collalign.products.pair import Alternative
from collalign.products.shapes import Incomplete
from collalign.wording import note_text, reason_text
from data_tools.arrays import BoolArray, FloatArray, IntArray, rms_length
from data_tools.embedding.surface_points import cloud_rim, plane_normals
from data_tools.poses import APART_DEG, keep_apart, moved_by
from data_tools.rotations import rotation_angle_deg
from data_tools.surface.closest import lies_beyond
from data_tools.surface.topology import boundary_edges

#: Poses offered per shape.
MOST_POSES = 6


def offered_poses(collection: CollectionData) -> tuple[tuple[Alternative, ...], ...]:
    """Return the alternatives of every shape, with half turns about the principal axes of the mean.

    Wrong poses are mostly half turns, and a shape whose pairs agree on a wrong pose has no alternative of its own.
    """
    half_turns = _half_turn_rotations(collection)
    offered = []
    for R, poses in zip(collection.rotations, collection.alternatives, strict=True):
        added = (
            Alternative(rotation=half_turn @ R, origin="half turn") for half_turn in half_turns
        )
        known = (*poses, *added)
        rotations = np.stack([R, *(one.rotation for one in known)])
        kept = keep_apart(rotations, APART_DEG, num=MOST_POSES + 1)
        offered.append(tuple(known[at - 1] for at in kept[1:]))
    return tuple(offered)


def own_disagreements_deg(collection: CollectionData) -> FloatArray:
    """Return the angle between each shown pair's own likeliest pose, its first, and the collection's, shape (E,).

    Infinite where they disagree on handedness.
    """
    frames = collection.rotations
    angles = [
        rotation_angle_deg(pair.rotations[0], frames[pair.target].T @ frames[pair.source])
        for pair in collection.pairs
    ]
    return np.nan_to_num(np.array(angles, dtype=np.float64), nan=np.inf)


def _half_turn_rotations(collection: CollectionData) -> FloatArray:
    """Return rotations by 180 degrees about the principal axes of all aligned samples, shape (3, 3, 3)."""
    points = collection.aligned_landmarks.reshape(-1, 3)
    points = points[~np.isnan(points).any(axis=1)]
    axes = np.eye(3)
    if len(points) > 2:
        axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    return 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)


_HISTOGRAM_BINS = 36


def shape_map(collection: CollectionData) -> dict[str, Any]:
    """Return principal coordinates and the cophenetic tree of the Procrustes distances."""
    who = statistics_members(collection)
    members = who.chosen
    if who.too_few(2):
        return {"problem": f"No map: {who.too_few(2)}."}
    samples = collection.aligned_landmarks[members]
    distances = procrustes_distances(samples)
    if np.isnan(distances).any():
        return {
            "problem": "No map: it needs shapes that have three or more sample points in common."
        }
    coordinates, shares = classical_mds(distances)
    condensed = scipy.spatial.distance.squareform(distances, checks=False)
    joined = scipy.cluster.hierarchy.linkage(condensed, method="average")
    heights = scipy.cluster.hierarchy.cophenet(joined)
    is_flat = min(np.ptp(condensed), np.ptp(heights)) <= 0
    return {
        "members": members.tolist(),
        "points": coordinates.tolist(),
        "axes": [
            f"principal coordinate {at + 1} ({100 * share:.0f} %)"
            for at, share in enumerate(shares)
        ],
        "words": f"Procrustes distances of {len(members)} shapes; "
        f"{common_labels(samples).sum()} sample points are common to all. "
        + " ".join(map(note_text, who.notes)),
        "tree": {
            "linkage": joined[:, :3].tolist(),
            "order": scipy.cluster.hierarchy.leaves_list(joined).tolist(),
            "correlation": None if is_flat else float(np.corrcoef(condensed, heights)[0, 1]),
        },
    }


def cycle_histogram(collection: CollectionData) -> dict[str, Any]:
    """Return counts of cycle errors in bins of equal width."""
    errors = collection.cycle_errors_deg[~np.isnan(collection.cycle_errors_deg)]
    if not len(errors):
        return {
            "edges": [],
            "counts": [],
            "words": "No three shapes were compared with each other, so there are no cycles.",
        }
    counts, edges = np.histogram(errors, bins=_HISTOGRAM_BINS, range=(0.0, 180.0))
    words = (
        f"Going around {len(errors)} cycles of three pairs, the rotations found pair by pair leave an error of "
        f"{np.median(errors):.1f}° in the median; {100 * np.mean(errors > 30):.1f} % of the cycles leave more "
        "than 30°, which takes at least one wrong pair. Cycles that mirror count as 180°."
    )
    return {"edges": edges.tolist(), "counts": counts.tolist(), "words": words}


#: Incomplete shapes that are drawn, those that cover least.
MOST_INCOMPLETE_DRAWN = 40
_NONE = np.empty((0, 3))

#: Packed meshes by name.
Meshes = dict[str, tuple[dict[str, Any], str]]


def counterparts_on(vertices: FloatArray, faces: IntArray) -> Callable[[FloatArray], BoolArray]:
    """Return a function that says which places (p, 3) have a counterpart on a mesh (v, 3), (f, 3)."""
    tree, on_rim = scipy.spatial.cKDTree(vertices), np.zeros(len(vertices), dtype=bool)
    if len(faces):
        on_rim[boundary_edges(faces).ravel()] = True
    else:
        on_rim = cloud_rim(vertices, plane_normals(vertices, vertices))
    radius = rms_length(vertices - vertices.mean(axis=0))
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
    drawn, vertices, faces = listed[:MOST_INCOMPLETE_DRAWN], collection.vertices, collection.faces
    partners = {i for one in drawn for i in one.partners.tolist()}
    aligned = {i: moved_by(collection.transforms[i], vertices[i]) for i in partners}
    has = {i: counterparts_on(aligned[i], faces[i]) for i in partners}
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
        "reason": reason_text(one.reason),
        "coverage": one.coverage,
        "partners": one.partners,
        "overlaps": one.overlaps,
        "points": [
            int(np.isfinite(collection.landmarks[one.shape]).all(axis=1).sum()),
            collection.landmarks.shape[1],
        ],
    }
