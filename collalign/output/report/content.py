"""Everything that the page shows, as one JSON document and a few packed blobs."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.engine.command_line import json_types
from collalign.output.collection_data import CollectionData
from collalign.output.evidence_file import OWN_MAP, label_maps
from collalign.output.members import main_part, statistics_members
from collalign.output.methods.paragraph import methods_paragraph
from collalign.output.report.payload import Fields, pack, pack_mesh, quaternions, sample_colors
from collalign.output.report.sections import (
    cycle_histogram,
    incomplete_content,
    offered_poses,
    own_disagreements_deg,
    shape_map,
)
from collalign.output.views import camera
from collalign.products.named_frame import NamedFrame
from collalign.products.trust import DOUBT
from collalign.wording import reason_text
from data_tools.arrays import FloatArray
from data_tools.errors import printable
from data_tools.poses import moved_by
from pairwise.results import Status

#: Columns of more different labels than this are shown per shape, but not as colours.
MOST_CATEGORIES = 40
#: Pairs' own maps are embedded while they have fewer entries than this; afterwards equal labels are shown as matched.
MOST_MAP_ENTRIES = 3_000_000
#: Red, green and blue of extra material, and of the rest of its shape.
_EXTRA_COLOUR, _REST_COLOUR = (0.84, 0.37, 0.0), (0.88, 0.84, 0.76)
#: A shape this many times larger than the median may leave its tile, so that one huge shape does not shrink the rest.
_LARGEST_SHOWN = 1.5


def build_content(collection: CollectionData) -> tuple[dict[str, Any], dict[str, str]]:
    """Collect the page's content.

    Returns
    -------
    document : dict
        JSON types only; NaN became None.
    blobs : dict of str to str
        Base64 text by the element's id.
    """
    document, blobs = shapes_content(collection)
    incomplete, parts = incomplete_content(collection)
    places = place_meshes(collection)
    for name, (info, text) in (parts | places | extra_meshes(collection)).items():
        document["meshes"][name], blobs[f"mesh-{name}"] = info, text
    for one in collection.extra:
        side = one.side(collection.transforms[one.shape])
        entry = {"share": one.share, "side": side, "mesh": f"extra-{one.shape}"}
        document["shapes"][one.shape]["extra"] = entry
    pair_fields, blobs["pairs"], statuses = _pairs(collection)
    shape_statistics = shape_map(collection)
    decided = {"group": collection.group, "own": collection.own}
    document |= {
        "numSamples": collection.landmarks.shape[1],
        "numParts": len(np.unique(collection.part_numbers)),
        "mainPart": int(collection.part_numbers[main_part(collection)[0]]),
        "labelColors": np.round(sample_colors(collection.aligned_landmarks), 3),
        "doubtThreshold": DOUBT,
        "labels": collection.labels,
        "categories": categories(collection),
        "pairFields": pair_fields,
        "statuses": statuses,
        "orders": _orders(collection, shape_statistics),
        "map": shape_statistics,
        "incomplete": incomplete,
        "places": [_place(at, colours) for at, colours in enumerate(collection.places)]
        if places
        else [],
        "cycles": cycle_histogram(collection),
        "excluded": [(one.file, one.reason) for one in collection.excluded],
        "options": asdict(collection.options) | {"decided": decided},
        "versions": collection.run.versions,
        "methods": methods_paragraph(collection),
    }
    return json_types(document), blobs


def shapes_content(collection: CollectionData) -> tuple[dict[str, Any], dict[str, str]]:
    """Collect what every page of shapes holds: shapes, camera, run and meshes; and the packed arrays by name."""
    meshes: dict[str, Any] = {}
    blobs: dict[str, str] = {}
    for at, parts in enumerate(
        zip(collection.vertices, collection.faces, collection.landmarks, strict=True)
    ):
        meshes[str(at)], blobs[f"mesh-{at}"] = pack_mesh(*parts)
    shapes = _shapes(collection)
    view = _camera(collection, shapes)
    return {"shapes": shapes, "camera": view, "run": _run_key(collection), "meshes": meshes}, blobs


def place_meshes(collection: CollectionData) -> dict[str, tuple[dict[str, Any], str]]:
    """Return the display meshes of the shapes whose vertices have maps, coloured by place, packed, by name."""
    none = np.empty((0, 3))
    return {
        f"place-{at}": pack_mesh(
            collection.vertices[at], collection.faces[at], none, colours / 255.0
        )
        for at, colours in enumerate(collection.places)
        if len(colours)
    }


def extra_meshes(collection: CollectionData) -> dict[str, tuple[dict[str, Any], str]]:
    """Return the display meshes of the shapes with extra material, in another colour there, packed, by name."""
    found = {}
    for one in collection.extra:
        vertices, faces = collection.vertices[one.shape], collection.faces[one.shape]
        colours = np.where(one.surface.holds(vertices)[:, None], _EXTRA_COLOUR, _REST_COLOUR)
        found[f"extra-{one.shape}"] = pack_mesh(
            vertices, faces, collection.landmarks[one.shape], colours
        )
    return found


def _place(at: int, colours: NDArray[np.uint8]) -> dict[str, Any] | None:
    """Return the mesh in the colours of a shape's places, and the share of these that is expected to be right."""
    if not len(colours):
        return None
    return {"mesh": f"place-{at}", "sure": colours[:, 3].mean() / 255.0}


def _run_key(collection: CollectionData) -> str:
    """Return a digest of names, poses and what was set by hand: a browser keeps decisions for one result."""
    names = "\0".join([*collection.names, *collection.by_hand]).encode("utf-8", "surrogatepass")
    return hashlib.sha256(names + np.round(collection.transforms, 9).tobytes()).hexdigest()[:32]


def categories(collection: CollectionData) -> list[str]:
    """Label columns worth colouring by: at least two values, and few enough that shapes share them."""
    most = max(2, min(MOST_CATEGORIES, len(collection) // 2))
    counts = {column: len(set(values) - {""}) for column, values in collection.labels.items()}
    return [column for column, count in counts.items() if 2 <= count <= most]


def _shapes(collection: CollectionData) -> list[dict[str, Any]]:
    """Return the pose of each shape in the display, whose unit is the collection's typical radius."""
    linear, shift = collection.transforms[:, :3, :3], collection.transforms[:, :3, 3]
    centroids = np.stack(
        [
            _centroid(samples, points)
            for samples, points in zip(collection.landmarks, collection.vertices, strict=True)
        ]
    )
    placed = np.einsum("nij,nj->ni", linear, centroids) + shift
    radii = [
        scale * np.linalg.norm(points - centroid, axis=1).max()
        for scale, points, centroid in zip(
            collection.scales, collection.vertices, centroids, strict=True
        )
    ]
    unit = float(min(np.max(radii), _LARGEST_SHOWN * np.median(radii))) or 1.0
    middle = placed[main_part(collection)].mean(axis=0)
    return [
        {
            "name": name,
            "file": printable(collection.files[at]),
            "confidence": float(np.clip(np.nan_to_num(collection.confidence[at]), 0.0, 1.0)),
            "alone": bool(collection.is_alone[at]),
            "byHand": {"evidence": collection.by_hand[name]}
            if name in collection.by_hand
            else None,
            "limitedBy": reason_text(collection.limited_by[name])
            if name in collection.limited_by
            else None,
            "reflected": bool(collection.reflected[at]),
            "part": int(collection.part_numbers[at]),
            "coverage": collection.coverage[at],
            "mesh": str(at),
            "centroid": centroids[at],
            "scale": collection.scales[at] / unit,
            "offset": (placed[at] - middle) / unit,
            "R": collection.rotations[at],
            "transform": collection.transforms[at],
            "alternatives": [
                {
                    "R": one.rotation,
                    "transform": one.transform,
                    "score": -one.log_odds,
                    "origin": one.origin,
                }
                for one in poses
            ],
        }
        for at, (name, poses) in enumerate(
            zip(collection.names, offered_poses(collection), strict=True)
        )
    ]


def _camera(collection: CollectionData, shapes: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the view of the sure shapes, and how far they reach to the side, upwards and to the viewer."""
    chosen = statistics_members(collection).chosen.tolist() or range(len(collection))
    posed = (
        (moved_by(collection.transforms[at], collection.vertices[at]), collection.faces[at])
        for at in chosen
    )
    axes = camera(posed, NamedFrame.of(collection.options))
    reach = []
    for at in chosen:
        shape, pose = shapes[at], np.eye(4)
        pose[:3, :3] = shape["scale"] * shape["R"]
        pose[:3, 3] = shape["offset"] - pose[:3, :3] @ shape["centroid"]
        reach.append(np.abs(moved_by(pose, collection.vertices[at]) @ axes.T).max(axis=0))
    extent = np.minimum(np.max(reach, axis=0), _LARGEST_SHOWN * np.median(reach, axis=0))
    return {"R": axes, "extent": extent}


def _centroid(samples: FloatArray, points: FloatArray) -> FloatArray:
    known = samples[~np.isnan(samples).any(axis=1)]
    return np.asarray((known if len(known) else points).mean(axis=0))


def _pairs(collection: CollectionData) -> tuple[Fields, str, list[str]]:
    """Pack the pairs as arrays of equal length, their poses one after the other."""
    pairs = collection.pairs
    values = {name: status.value for name, status in Status.__members__.items()}
    advice = [values.get(pair.status, pair.status) for pair in pairs]
    statuses = sorted(set(advice))
    own = own_disagreements_deg(collection)
    energies = np.concatenate([np.empty(0), *(pair.energies for pair in pairs)])
    rotations = np.concatenate([np.empty((0, 3, 3)), *(pair.rotations for pair in pairs)])
    packed, mirrored = quaternions(rotations)

    def column(name: str, dtype: type) -> NDArray[Any]:
        return np.array([getattr(pair, name) for pair in pairs], dtype=dtype)

    fields, text = pack(
        {
            "i": column("target", np.uint16),
            "j": column("source", np.uint16),
            "energy": np.array([pair.energies[0] for pair in pairs], dtype=np.float32),
            "bound": column("lower_bound", np.float32),
            "disagreement": np.minimum(own, 180.0).astype(np.float32),
            "inlier": column("inlier", np.uint8),
            "mirrored": np.isinf(own).astype(np.uint8),
            "chiralityProven": column("chirality_proven", np.uint8),
            "choice": column("choice", np.int16),
            "status": np.array([statuses.index(words) for words in advice], dtype=np.uint16),
            "poseCount": np.array([len(pair.energies) for pair in pairs], dtype=np.uint8),
            "poseEnergy": energies.astype(np.float32),
            "poseRotation": np.round(32767 * packed).astype(np.int16),
            "poseMirrored": mirrored,
            "map": _pair_maps(collection),
        }
    )
    return fields, text, statuses


def _pair_maps(collection: CollectionData) -> NDArray[np.int16]:
    num_samples = collection.landmarks.shape[1]
    if len(collection.pairs) * num_samples > MOST_MAP_ENTRIES:
        return np.empty(0, dtype=np.int16)
    maps = label_maps(collection.pairs, collection.maps.labels)
    return maps.astype(np.int16) if (maps != OWN_MAP).any() else np.empty(0, dtype=np.int16)


def _orders(collection: CollectionData, shape_statistics: dict[str, Any]) -> dict[str, list[int]]:
    """Return orders of rows for the matrix of pairs."""
    every = list(range(len(collection)))
    orders: dict[str, list[int]] = {}
    if "tree" in shape_statistics:
        members = shape_statistics["members"]
        similar = [members[leaf] for leaf in shape_statistics["tree"]["order"]]
        orders["similarity"] = similar + [at for at in every if at not in set(similar)]
    orders["name"] = sorted(every, key=lambda at: collection.names[at])
    orders["confidence"] = np.argsort(np.nan_to_num(collection.confidence), kind="stable").tolist()
    for column in categories(collection):
        orders[column] = [
            at for _, at in sorted(zip(collection.labels[column], every, strict=True))
        ]
    return orders
