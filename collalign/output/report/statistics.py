"""The report's shape map, tree and cycle histogram, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from collalign.analysis.ordination import classical_mds, cophenetic_tree
from collalign.analysis.procrustes import (
    MIN_LABELS,
    common_labels,
    generalized_procrustes,
    principal_components,
    procrustes_distances,
)
from collalign.output.collection import Collection
from collalign.output.evidence.members import statistics_members

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
