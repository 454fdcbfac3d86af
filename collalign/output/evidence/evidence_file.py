"""What the report and the exports are made of, in one ``evidence.npz``, and the correspondences of a result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.output.collection_data import CollectionData
from collalign.output.evidence.gather import json_types, label_maps, options_record

#: Name of the file inside a result's folder.
EVIDENCE_FILE = "evidence.npz"
CORRESPONDENCES_FILE = "correspondences.npz"
#: Raised with every change that older readers cannot understand.
EVIDENCE_VERSION = 3

PAIR_NUMBERS = ("energy", "lower_bound", "disagreement_deg")
PAIR_FLAGS = ("inlier", "chirality_proven")


def save_evidence(collection: CollectionData, folder: Path | str) -> Path:
    """Write ``evidence.npz`` into ``folder``; the same collection gives the same bytes.

    Parameters
    ----------
    collection : CollectionData
        With its display meshes, and its pairs as they are shown.
    folder : path
        Created if it does not exist.

    Returns
    -------
    Path
        The file written.
    """
    path = Path(folder) / EVIDENCE_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    options = options_record(collection)
    text = {
        "names": collection.names,
        "files": collection.files,
        "labels": collection.labels,
        "excluded": [(one.file, one.reason) for one in collection.excluded],
        "copies": [(one.names, one.kind) for one in collection.copies],
        "options": options,
        "versions": collection.run.versions,
        "timings_s": collection.run.times_s,
        "command": collection.run.command,
        "date": collection.run.date,
        "notes": [note.record() for note in collection.notes],
        "by_hand": collection.by_hand,
    }
    arrays: dict[str, NDArray[Any]] = {
        "version": np.array(EVIDENCE_VERSION),
        "text": _text(json_types(text) | {"options": options}),  # which may be infinite
        "transforms": collection.transforms,
        "confidence": collection.confidence,
        "samples": collection.landmarks,
        "groups": collection.part_numbers,
        "cycle_errors_deg": collection.cycle_errors_deg,
    }
    arrays |= _join("vertices", collection.vertices, 3, np.float64) | _join("faces", collection.faces, 3, np.int64)
    arrays |= _pair_arrays(collection) | _alternative_arrays(collection) | _incomplete_arrays(collection)
    if collection.places:
        arrays |= _join("places", collection.places, collection.places[0].shape[1], np.uint8)
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]  # the stubs see only the flag
    return path


def save_correspondences(collection: CollectionData, folder: Path) -> None:
    """Write ``correspondences.npz`` into a folder."""
    np.savez_compressed(
        folder / CORRESPONDENCES_FILE,
        names=np.array(collection.names),
        vertex_indices=collection.samples,
        labels=collection.maps.labels,
        positions=collection.positions,
        consensus=collection.consensus,
    )


def _text(value: Any) -> NDArray[np.uint8]:
    return np.frombuffer(json.dumps(value).encode(), dtype=np.uint8)


def _join(name: str, parts: tuple[NDArray[Any], ...], width: int, dtype: type) -> dict[str, NDArray[Any]]:
    """Concatenate arrays of different lengths and keep where each begins."""
    starts = np.cumsum([0, *(len(part) for part in parts)])
    joined: NDArray[Any] = np.concatenate([*parts, np.empty((0, width))]).astype(dtype)
    return {name: joined, f"{name}_starts": starts.astype(np.int64)}


def _pair_arrays(collection: CollectionData) -> dict[str, NDArray[Any]]:
    """Return one array per property of the pairs; maps in terms of labels."""
    pairs = collection.pairs
    ends = np.array([(pair.target, pair.source) for pair in pairs], dtype=np.int64)
    arrays: dict[str, NDArray[Any]] = {
        "pair_indices": ends.reshape(-1, 2),
        "pair_maps": label_maps(pairs, collection.maps.labels).astype(np.int32),
        "pair_choice": np.array([pair.choice for pair in pairs], dtype=np.int64),
        "pair_status": _text([pair.status for pair in pairs]),
        "pose_starts": np.cumsum([0, *(len(pair.energies) for pair in pairs)]).astype(np.int64),
        "pose_rotation": np.concatenate([np.empty((0, 3, 3)), *(pair.rotations for pair in pairs)]),
        "pose_energy": np.concatenate([np.empty(0), *(pair.energies for pair in pairs)]),
    }
    for name in (*PAIR_NUMBERS, *PAIR_FLAGS):
        dtype = np.float64 if name in PAIR_NUMBERS else np.bool_
        arrays[f"pair_{name}"] = np.array([getattr(pair, name) for pair in pairs], dtype=dtype)
    return arrays


def _alternative_arrays(collection: CollectionData) -> dict[str, NDArray[Any]]:
    poses = [pose for shape in collection.alternatives for pose in shape]
    counts = [len(shape) for shape in collection.alternatives]
    whole = [np.full((4, 4), np.nan) if pose.transform is None else pose.transform for pose in poses]
    return {
        **({"alternative_transform": np.array(whole).reshape(-1, 4, 4)} if collection.incomplete else {}),
        "alternative_starts": np.cumsum([0, *counts]).astype(np.int64),
        "alternative_rotation": np.array([pose.rotation for pose in poses], dtype=np.float64).reshape(-1, 3, 3),
        "alternative_log_odds": np.array([pose.log_odds for pose in poses], dtype=np.float64),
        "alternative_origin": _text([pose.origin for pose in poses]),
    }


def _incomplete_arrays(collection: CollectionData) -> dict[str, NDArray[Any]]:
    """Return the incomplete shapes; nothing where all are complete."""
    if not collection.incomplete:
        return {}
    return {
        "incomplete_shape": np.array([one.shape for one in collection.incomplete], dtype=np.int64),
        "incomplete_reason": _text([one.reason for one in collection.incomplete]),
        "partner_starts": np.cumsum([0, *(len(one.partners) for one in collection.incomplete)]).astype(np.int64),
        "partner_shape": np.concatenate([one.partners for one in collection.incomplete]).astype(np.int64),
        "partner_overlaps": np.concatenate([one.overlaps for one in collection.incomplete]),
    }
