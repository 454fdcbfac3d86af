"""Saves a :class:`~collalign.products.evidence.CollectionView` as one ``evidence.npz``; reads it without pickle."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.products.evidence import CollectionView, json_types
from collalign.products.incomplete import Incomplete
from collalign.products.pair import Alternative, Pair
from data_tools.arrays import (
    FloatArray,
    as_faces,
    as_floats,
    as_indices,
    as_points,
    as_rotations,
    read_only,
)
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.source import read_source

#: Name of the file inside a result's folder.
EVIDENCE_FILE = "evidence.npz"
#: Raised with every change that older readers cannot understand.
EVIDENCE_VERSION = 2

_TEXT_FIELDS = (
    "names",
    "files",
    "labels",
    "excluded",
    "options",
    "versions",
    "timings_s",
    "notes",
)
_PAIR_NUMBERS = ("energy", "lower_bound", "disagreement_deg")
_PAIR_FLAGS = ("inlier", "chirality_proven")


def save_view(view: CollectionView, folder: Path | str) -> Path:
    """Write ``evidence.npz`` into ``folder``; the same view gives the same bytes.

    Parameters
    ----------
    view : CollectionView
    folder : path
        Created if it does not exist.

    Returns
    -------
    Path
        The file written.
    """
    path = Path(folder) / EVIDENCE_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    text = {name: getattr(view, name) for name in _TEXT_FIELDS}
    arrays: dict[str, NDArray[Any]] = {
        "version": np.array(EVIDENCE_VERSION),
        "text": np.frombuffer(json.dumps(json_types(text)).encode(), dtype=np.uint8),
        "transforms": view.transforms,
        "confidence": view.confidence,
        "samples": view.samples,
        "groups": view.part_numbers,
        "cycle_errors_deg": view.cycle_errors_deg,
    }
    arrays |= _join("vertices", view.vertices, 3, np.float64) | _join("faces", view.faces, 3, np.int64)
    arrays |= _pair_arrays(view.pairs, view.samples.shape[1]) | _alternative_arrays(view) | _incomplete_arrays(view)
    if view.places:
        arrays |= _join("places", view.places, 3, np.uint8)
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]  # the stubs see only the flag
    return path


def load_view(folder: Path | str) -> CollectionView:
    """Read what :func:`save_view` wrote.

    Parameters
    ----------
    folder : path
        A result's folder, or the ``evidence.npz`` itself.

    Raises
    ------
    InputError
        If the folder holds no result, or one that is damaged or of another version.
    """
    path = Path(folder)
    path = path / EVIDENCE_FILE if path.is_dir() or not path.suffix else path
    if not path.is_file():
        raise InputError(
            f"{path}: there is no such file. Give the folder that `collalign align FOLDER --out OUT` wrote (its OUT)"
        )
    try:
        data = load_arrays(read_source(path).content, path.name)
        found = int(data["version"])
        view = _from_arrays(data) if found == EVIDENCE_VERSION else None
    except Exception as error:  # damaged archives fail in every way there is
        raise InputError(
            f"{path}: damaged or not written by collalign ({error}); run `collalign align` again"
        ) from error
    if view is None:
        raise InputError(
            f"{path}: written in format {found}, but this version reads {EVIDENCE_VERSION}; "
            "run `collalign align` again"
        )
    return view


def source_files(view: CollectionView) -> tuple[Path, ...]:
    """Return the files that the shapes of a result were read from.

    Raises
    ------
    InputError
        If a shape came from memory, or its file has vanished.
    """
    files = tuple(view.file(at) for at in range(view.num_shapes))
    for file in files:
        if not file.is_file():
            raise InputError(f"{file}: a shape of the collection is not there any more; put it back and try again")
    return files


def _from_arrays(data: dict[str, NDArray[Any]]) -> CollectionView:
    text = json.loads(data["text"].tobytes())
    num = len(text["names"])
    vertices = tuple(read_only(as_points(part, "vertices", dim=3)) for part in _split("vertices", data))
    return CollectionView(
        names=tuple(text["names"]),
        files=tuple(text["files"]),
        labels={column: tuple(values) for column, values in text["labels"].items()},
        excluded=tuple((file, reason) for file, reason in text["excluded"]),
        options=text["options"],
        versions=text["versions"],
        timings_s=text["timings_s"],
        notes=tuple(text["notes"]),
        transforms=read_only(as_floats(data["transforms"], "transforms", shape=(num, 4, 4))),
        confidence=read_only(data["confidence"].astype(np.float64)),
        samples=read_only(data["samples"].astype(np.float64)),
        part_numbers=read_only(as_indices(data["groups"], "groups", upper=num, shape=(num,))),
        cycle_errors_deg=read_only(data["cycle_errors_deg"].astype(np.float64)),
        vertices=vertices,
        faces=tuple(
            read_only(as_faces(part, "faces", num_vertices=len(points)))
            for part, points in zip(_split("faces", data), vertices, strict=True)
        ),
        pairs=_pairs(data),
        alternatives=_alternatives(data),
        incomplete=_incomplete(data),
        places=_places(data, vertices),
    )


def _places(data: dict[str, NDArray[Any]], vertices: tuple[FloatArray, ...]) -> tuple[NDArray[np.uint8], ...]:
    if "places" not in data:
        return ()
    places = _split("places", data)
    for colours, points in zip(places, vertices, strict=True):
        if colours.dtype != np.uint8 or len(colours) not in (0, len(points)):
            raise InputError(f"places: {colours.dtype} colours of {len(colours)} vertices, not of {len(points)}")
    return tuple(read_only(colours) for colours in places)


def _join(name: str, parts: tuple[NDArray[Any], ...], width: int, dtype: type) -> dict[str, NDArray[Any]]:
    """Concatenate arrays of different lengths and keep where each begins."""
    starts = np.cumsum([0, *(len(part) for part in parts)])
    joined: NDArray[Any] = np.concatenate([*parts, np.empty((0, width))]).astype(dtype)
    return {name: joined, f"{name}_starts": starts.astype(np.int64)}


def _split(name: str, data: dict[str, NDArray[Any]]) -> tuple[NDArray[Any], ...]:
    joined, starts = data[name], data[f"{name}_starts"]
    return tuple(joined[a:b] for a, b in itertools.pairwise(starts))


def _pair_arrays(pairs: tuple[Pair, ...], num_samples: int) -> dict[str, NDArray[Any]]:
    """One array per property of the pairs; maps as int32, all -2 where a pair uses the collection's own."""
    maps = np.full((len(pairs), num_samples), -2, dtype=np.int32)
    for row, pair in zip(maps, pairs, strict=True):
        if len(pair.map_target_source):
            row[:] = pair.map_target_source
    status = json.dumps([pair.status for pair in pairs])
    ends = np.array([(pair.target, pair.source) for pair in pairs], dtype=np.int64)
    arrays: dict[str, NDArray[Any]] = {
        "pair_indices": ends.reshape(-1, 2),
        "pair_maps": maps,
        "pair_choice": np.array([pair.choice for pair in pairs], dtype=np.int64),
        "pair_status": np.frombuffer(status.encode(), dtype=np.uint8),
        "pose_starts": np.cumsum([0, *(len(pair.energies) for pair in pairs)]).astype(np.int64),
        "pose_rotation": np.concatenate([np.empty((0, 3, 3)), *(pair.rotations for pair in pairs)]),
        "pose_energy": np.concatenate([np.empty(0), *(pair.energies for pair in pairs)]),
    }
    for name in (*_PAIR_NUMBERS, *_PAIR_FLAGS):
        dtype = np.float64 if name in _PAIR_NUMBERS else np.bool_
        arrays[f"pair_{name}"] = np.array([getattr(pair, name) for pair in pairs], dtype=dtype)
    return arrays


def _pairs(data: dict[str, NDArray[Any]]) -> tuple[Pair, ...]:
    rotations = as_rotations(data["pose_rotation"], "pair poses", dim=3)
    energies, maps = as_floats(data["pose_energy"], "pair energies", shape=(len(rotations),)), data["pair_maps"]
    status = json.loads(data["pair_status"].tobytes())
    pairs = []
    for row, ((target, source), (start, stop)) in enumerate(
        zip(data["pair_indices"].tolist(), itertools.pairwise(data["pose_starts"].tolist()), strict=True)
    ):
        is_own = bool((maps[row] == -2).all())
        pairs.append(
            Pair(
                target=target,
                source=source,
                rotations=read_only(rotations[start:stop]),
                maps=read_only(np.zeros((stop - start, 0), dtype=np.int64)),
                energies=read_only(energies[start:stop]),
                map_target_source=read_only(maps[row][: 0 if is_own else None].astype(np.int64)),
                status=status[row],
                choice=int(data["pair_choice"][row]),
                energy=float(data["pair_energy"][row]),
                lower_bound=float(data["pair_lower_bound"][row]),
                disagreement_deg=float(data["pair_disagreement_deg"][row]),
                inlier=bool(data["pair_inlier"][row]),
                chirality_proven=bool(data["pair_chirality_proven"][row]),
            )
        )
    return tuple(pairs)


def _alternative_arrays(view: CollectionView) -> dict[str, NDArray[Any]]:
    poses = [pose for shape in view.alternatives for pose in shape]
    counts = [len(shape) for shape in view.alternatives]
    origins = json.dumps([pose.origin for pose in poses])
    return {
        "alternative_starts": np.cumsum([0, *counts]).astype(np.int64),
        "alternative_rotation": np.array([pose.rotation for pose in poses], dtype=np.float64).reshape(-1, 3, 3),
        "alternative_log_odds": np.array([pose.log_odds for pose in poses], dtype=np.float64),
        "alternative_origin": np.frombuffer(origins.encode(), dtype=np.uint8),
    }


def _alternatives(data: dict[str, NDArray[Any]]) -> tuple[tuple[Alternative, ...], ...]:
    origins = json.loads(data["alternative_origin"].tobytes())
    rotations = as_rotations(data["alternative_rotation"], "alternatives", dim=3)
    poses = [
        Alternative(rotation=read_only(rotation), log_odds=float(log_odds), origin=origin)
        for rotation, log_odds, origin in zip(rotations, data["alternative_log_odds"], origins, strict=True)
    ]
    starts = data["alternative_starts"]
    return tuple(tuple(poses[a:b]) for a, b in itertools.pairwise(starts))


def _incomplete_arrays(view: CollectionView) -> dict[str, NDArray[Any]]:
    """Return the incomplete shapes; nothing where all are complete."""
    if not view.incomplete:
        return {}
    reasons = json.dumps([one.reason for one in view.incomplete])
    return {
        "incomplete_shape": np.array([one.shape for one in view.incomplete], dtype=np.int64),
        "incomplete_reason": np.frombuffer(reasons.encode(), dtype=np.uint8),
        "partner_starts": np.cumsum([0, *(len(one.partners) for one in view.incomplete)]).astype(np.int64),
        "partner_shape": np.concatenate([one.partners for one in view.incomplete]).astype(np.int64),
        "partner_overlaps": np.concatenate([one.overlaps for one in view.incomplete]),
    }


def _incomplete(data: dict[str, NDArray[Any]]) -> tuple[Incomplete, ...]:
    if "incomplete_shape" not in data:
        return ()
    partners = data["partner_shape"].astype(np.int64)
    overlaps = as_floats(data["partner_overlaps"], "overlaps", shape=(len(partners), 2))
    return tuple(
        Incomplete(
            shape=shape,
            reason=reason,
            partners=read_only(partners[start:stop]),
            overlaps=read_only(overlaps[start:stop]),
        )
        for shape, reason, (start, stop) in zip(
            data["incomplete_shape"].tolist(),
            json.loads(data["incomplete_reason"].tobytes()),
            itertools.pairwise(data["partner_starts"].tolist()),
            strict=True,
        )
    )
