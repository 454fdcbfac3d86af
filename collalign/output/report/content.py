"""Everything that the page shows, as one JSON document and a few packed blobs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.output.report.payload import Fields, pack, pack_mesh, quaternions
from collalign.output.report.poses import offered_poses
from collalign.output.report.statistics import cycle_histogram, main_group, shape_map, variation
from collalign.products.evidence import CollectionView, json_types
from data_tools.arrays import FloatArray

#: Columns of more different labels than this are shown per shape, but not as colours.
MOST_CATEGORIES = 40
#: Pairs' own maps are embedded while they have fewer entries than this; afterwards equal labels are shown as matched.
MOST_MAP_ENTRIES = 3_000_000
#: ``pair_map`` of a pair that uses the collection's own correspondence.
_OWN_MAP = -2
#: A shape this many times larger than the median may leave its tile, so that one huge shape does not shrink the rest.
_LARGEST_SHOWN = 1.5


def build_content(view: CollectionView) -> tuple[dict[str, Any], dict[str, str]]:
    """Collect the page's content.

    Returns
    -------
    document : dict
        JSON types only; NaN became None.
    blobs : dict of str to str
        Base64 text by the element's id.
    """
    meshes: dict[str, Any] = {}
    blobs: dict[str, str] = {}
    varied, extra = variation(view)
    packed = {
        str(at): pack_mesh(*parts)
        for at, parts in enumerate(zip(view.vertices, view.faces, view.samples, strict=True))
    }
    for name, (info, text) in (packed | extra).items():
        meshes[name], blobs[f"mesh-{name}"] = info, text
    pair_fields, blobs["pairs"], statuses = _pairs(view)
    shape_statistics = shape_map(view)
    document = {
        "shapes": _shapes(view),
        "numSamples": view.samples.shape[1],
        "numGroups": len(np.unique(view.groups)),
        "doubtThreshold": view.doubt_threshold,
        "labels": view.labels,
        "categories": categories(view),
        "meshes": meshes,
        "pairFields": pair_fields,
        "statuses": statuses,
        "orders": _orders(view, shape_statistics),
        "map": shape_statistics,
        "variation": varied,
        "cycles": cycle_histogram(view),
        "excluded": view.excluded,
        "options": view.options,
        "versions": view.versions,
        "timings": view.timings_s,
    }
    return json_types(document), blobs


def categories(view: CollectionView) -> list[str]:
    """Label columns worth colouring by: at least two values, and few enough that shapes share them."""
    most = max(2, min(MOST_CATEGORIES, view.num_shapes // 2))
    return [column for column, values in view.labels.items() if 2 <= len(set(values) - {""}) <= most]


def _shapes(view: CollectionView) -> list[dict[str, Any]]:
    """Per shape its pose in the display, whose unit is the collection's typical radius."""
    linear, shift = view.transforms[:, :3, :3], view.transforms[:, :3, 3]
    centroids = np.stack(
        [_centroid(samples, points) for samples, points in zip(view.samples, view.vertices, strict=True)]
    )
    placed = np.einsum("nij,nj->ni", linear, centroids) + shift
    radii = [
        scale * np.linalg.norm(points - centroid, axis=1).max()
        for scale, points, centroid in zip(view.scales, view.vertices, centroids, strict=True)
    ]
    unit = float(min(np.max(radii), _LARGEST_SHOWN * np.median(radii))) or 1.0
    middle = placed[main_group(view)].mean(axis=0)
    return [
        {
            "name": name,
            "file": view.files[at],
            "confidence": float(np.clip(np.nan_to_num(view.confidence[at]), 0.0, 1.0)),
            "reflected": bool(view.reflected[at]),
            "group": int(view.groups[at]),
            "mesh": str(at),
            "centroid": centroids[at],
            "scale": view.scales[at] / unit,
            "offset": (placed[at] - middle) / unit,
            "R": view.rotations[at],
            "alternatives": [{"R": pose.R, "score": pose.score, "origin": pose.origin} for pose in poses],
        }
        for at, (name, poses) in enumerate(zip(view.names, offered_poses(view), strict=True))
    ]


def _centroid(samples: FloatArray, points: FloatArray) -> FloatArray:
    known = samples[~np.isnan(samples).any(axis=1)]
    return np.asarray((known if len(known) else points).mean(axis=0))


def _pairs(view: CollectionView) -> tuple[Fields, str, list[str]]:
    """Pack the pairs as arrays of equal length, their poses one after the other."""
    pairs = view.pairs
    statuses = sorted({pair.status for pair in pairs})
    number = {status: at for at, status in enumerate(statuses)}
    poses = [pose for pair in pairs for pose in pair.candidates]
    rotations = np.array([pose.R_i_j for pose in poses], dtype=np.float64).reshape(-1, 3, 3)
    turns, mirrored = quaternions(rotations)

    def column(name: str, dtype: type) -> NDArray[Any]:
        return np.array([getattr(pair, name) for pair in pairs], dtype=dtype)

    fields, text = pack(
        {
            "i": column("i", np.uint16),
            "j": column("j", np.uint16),
            "energy": column("energy", np.float32),
            "bound": column("lower_bound", np.float32),
            "disagreement": column("disagreement_deg", np.float32),
            "inlier": column("inlier", np.uint8),
            "mirrored": column("mirrored", np.uint8),
            "chiralityProven": column("chirality_proven", np.uint8),
            "choice": column("choice", np.int16),
            "status": np.array([number[pair.status] for pair in pairs], dtype=np.uint16),
            "poseCount": np.array([len(pair.candidates) for pair in pairs], dtype=np.uint8),
            "poseEnergy": np.array([pose.energy for pose in poses], dtype=np.float32),
            "poseRotation": np.round(32767 * turns).astype(np.int16),
            "poseMirrored": mirrored,
            "map": _pair_maps(view),
        }
    )
    return fields, text, statuses


def _pair_maps(view: CollectionView) -> NDArray[np.int16]:
    num_samples = view.samples.shape[1]
    if len(view.pairs) * num_samples > MOST_MAP_ENTRIES or all(pair.map_i_j is None for pair in view.pairs):
        return np.empty(0, dtype=np.int16)
    maps = np.full((len(view.pairs), num_samples), _OWN_MAP, dtype=np.int16)
    for row, pair in zip(maps, view.pairs, strict=True):
        if pair.map_i_j is not None:
            row[:] = pair.map_i_j
    return maps


def _orders(view: CollectionView, shape_statistics: dict[str, Any]) -> dict[str, list[int]]:
    """Orders of rows for the matrix of pairs."""
    every = list(range(view.num_shapes))
    orders: dict[str, list[int]] = {}
    if "tree" in shape_statistics:
        members = shape_statistics["members"]
        similar = [members[leaf] for leaf in shape_statistics["tree"]["order"]]
        orders["similarity"] = similar + [at for at in every if at not in set(similar)]
    orders["name"] = sorted(every, key=lambda at: view.names[at])
    orders["confidence"] = np.argsort(np.nan_to_num(view.confidence), kind="stable").tolist()
    for column in categories(view):
        orders[column] = sorted(every, key=lambda at, values=view.labels[column]: (values[at], at))  # type: ignore[misc]
    return orders
