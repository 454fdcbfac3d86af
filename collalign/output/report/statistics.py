"""The report's shape map, tree and cycle histogram, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.cluster.hierarchy import cophenet, leaves_list, linkage
from scipy.spatial.distance import squareform

from collalign.analysis.procrustes import classical_mds, common_labels, procrustes_distances
from collalign.output.collection_data import CollectionData
from collalign.output.evidence.members import statistics_members
from collalign.wording import note_text

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
        return {"problem": "No map: it needs shapes that have three or more sample points in common."}
    coordinates, shares = classical_mds(distances)
    condensed = squareform(distances, checks=False)
    joined = linkage(condensed, method="average")
    heights = cophenet(joined)
    is_flat = min(np.ptp(condensed), np.ptp(heights)) <= 0
    return {
        "members": members.tolist(),
        "points": coordinates.tolist(),
        "axes": [f"principal coordinate {at + 1} ({100 * share:.0f} %)" for at, share in enumerate(shares)],
        "words": f"Procrustes distances of {len(members)} shapes; "
        f"{common_labels(samples).sum()} sample points are common to all. " + " ".join(map(note_text, who.notes)),
        "tree": {
            "linkage": joined[:, :3].tolist(),
            "order": leaves_list(joined).tolist(),
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
