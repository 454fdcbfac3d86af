"""The report's shape map, tree, principal components and cycle histogram, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from collalign.analysis.ordination import classical_mds, cophenetic_tree
from collalign.analysis.procrustes import (
    MIN_LABELS,
    PrincipalComponents,
    common_labels,
    generalized_procrustes,
    principal_components,
    procrustes_distances,
)
from collalign.analysis.warp import thin_plate_warp
from collalign.output.collection import Collection
from collalign.output.evidence.members import statistics_members
from collalign.output.report.payload import pack_mesh
from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError

#: Components drawn, and how far from the mean.
NUM_COMPONENTS = 3
DEVIATIONS = 2.0
_MIN_WARP_LABELS = 5
_HISTOGRAM_BINS = 36


def shape_map(collection: Collection) -> dict[str, Any]:
    """Coordinates by principal components and by multidimensional scaling, and the cophenetic tree."""
    who = statistics_members(collection)
    members = who.chosen
    if who.too_few(2):
        return {"problem": f"No map: {who.too_few(2)}."}
    samples = collection.aligned_landmarks[members]
    distances = procrustes_distances(samples)
    if np.isnan(distances).any():
        return {"problem": "No map: it needs shapes that have three or more sample points in common."}
    coordinates, shares = classical_mds(distances)
    points = {"MDS": coordinates.tolist()}
    axes = {"MDS": [f"principal coordinate {at + 1} ({100 * share:.0f} %)" for at, share in enumerate(shares)]}
    labels = common_labels(samples)
    if labels.sum() >= MIN_LABELS and len(members) >= MIN_LABELS:
        components = principal_components(generalized_procrustes(samples[:, labels]).aligned)
        points = {"PCA": components.scores[:, :2].tolist()} | points
        words = [f"principal component {at + 1} ({100 * components.shares[at]:.0f} %)" for at in range(2)]
        axes = {"PCA": words} | axes
    tree = cophenetic_tree(distances)
    return {
        "members": members.tolist(),
        "points": points,
        "axes": axes,
        "words": f"Procrustes distances of {len(members)} shapes; {labels.sum()} sample points are common to all. "
        + who.sentence,
        "tree": {
            "linkage": tree.linkage[:, :3].tolist(),
            "order": tree.order.tolist(),
            "correlation": tree.correlation,
        },
    }


def variation(collection: Collection) -> tuple[dict[str, Any], dict[str, tuple[dict[str, Any], str]]]:
    """Surfaces of the mean and of the mean +-2 standard deviations along the first principal components.

    Returns
    -------
    content : dict
        Which mesh to draw where, or ``problem`` in words.
    meshes : dict of str to (info, text)
        Packed by :func:`collalign.output.report.payload.pack_mesh`.
    """
    who = statistics_members(collection)
    members = who.chosen
    if who.too_few(MIN_LABELS):
        return {"problem": f"Not drawn: {who.too_few(MIN_LABELS)}."}, {}
    samples = collection.aligned_landmarks[members]
    labels = common_labels(samples)
    if labels.sum() < _MIN_WARP_LABELS:
        return {"problem": "Not drawn: it needs shapes with five or more sample points in common."}, {}
    superimposed = generalized_procrustes(samples[:, labels])
    components = principal_components(superimposed.aligned, num_components=min(NUM_COMPONENTS, len(members) - 1))
    typical = members[np.linalg.norm(superimposed.aligned - superimposed.mean, axis=(1, 2)).argmin()]
    try:
        content, meshes = _surfaces(
            collection.vertices[typical], collection.faces[typical], collection.landmarks[typical][labels], components
        )
    except InputError as error:
        return {"problem": f"Not drawn: {error}."}, {}
    content["words"] = (
        f"The surface of {collection.names[typical]}, the shape nearest the mean, carried along by a smoothing "
        f"thin-plate spline to the mean and to {DEVIATIONS:g} standard deviations on either side. "
        f"Brighter: moved further. {who.sentence}"
    )
    return content, meshes


def _surfaces(
    vertices: FloatArray, faces: IntArray, landmarks: FloatArray, components: PrincipalComponents
) -> tuple[dict[str, Any], dict[str, tuple[dict[str, Any], str]]]:
    """Warp one display mesh to the mean and to both sides of it along every component.

    The spline is smoothed by the spacing of the landmarks, so that one misplaced landmark draws no spike.
    """
    smoothing = float(np.median(cKDTree(landmarks).query(landmarks, k=2)[0][:, 1]))
    mean = thin_plate_warp(vertices, landmarks, components.mean, smoothing=smoothing)
    centre = mean.mean(axis=0)
    radius = float(np.linalg.norm(mean - centre, axis=1).max())
    none = np.empty((0, 3))
    meshes = {"mean": pack_mesh((mean - centre) / radius, faces, none)}
    listed = []
    for at, share in enumerate(components.shares):
        entry: dict[str, Any] = {"share": float(share)}
        for side, deviations in (("low", -DEVIATIONS), ("high", DEVIATIONS)):
            moved = thin_plate_warp(vertices, landmarks, components.shape_at(at, deviations), smoothing=smoothing)
            distance = np.linalg.norm(moved - mean, axis=1)
            entry[side] = f"component-{at}-{side}"
            scalars = distance / max(float(distance.max()), np.finfo(float).tiny)
            meshes[entry[side]] = pack_mesh((moved - centre) / radius, faces, none, scalars)
        listed.append(entry)
    return {"components": listed, "mean": "mean"}, meshes


def cycle_histogram(collection: Collection) -> dict[str, Any]:
    """Counts of cycle errors in bins of equal width."""
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
