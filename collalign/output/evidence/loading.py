"""Reads a result from its folder, without pickle, and checks every number of it."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.output.evidence.evidence_file import CORRESPONDENCES_FILE, EVIDENCE_FILE, EVIDENCE_VERSION
from collalign.output.evidence.gather import OWN_MAP
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.pair import Alternative, SettledPair
from collalign.products.run_record import RunRecord
from collalign.products.shapes import Excluded, Incomplete
from data_tools.arrays import (
    FloatArray,
    IntArray,
    as_faces,
    as_floats,
    as_indices,
    as_points,
    as_rotations,
    read_only,
)
from data_tools.checks import as_options
from data_tools.embedding.copies import Copies
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.source import read_source
from data_tools.notes import Note
from data_tools.threads import one_blas_thread


@one_blas_thread()
def load(result: Collection | Path | str, *, sources: Path | str | None = None) -> Collection:
    """Read the result that ``collalign align`` or :meth:`Collection.save` wrote.

    Parameters
    ----------
    result : str, Path or Collection
        The folder. A collection is returned as it is, so that whatever takes a result takes it in either form.
    sources : str or Path, optional
        Folder that holds the original files now, where they have moved.

    Returns
    -------
    Collection

    Raises
    ------
    InputError
        If the folder holds no result, or one that is damaged or of another version, or ``sources`` none of its files.

    Examples
    --------
    >>> import tempfile
    >>> points = np.random.default_rng(0).random((40, 3))
    >>> aligned = collalign.align_collection([points, points[::-1]], progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = aligned.save(folder)
    ...     collalign.load(folder)["shape2"].reflected
    False
    """
    found = result if isinstance(result, Collection) else _read(Path(result))
    return found if sources is None else found.with_sources(sources)


def _read(folder: Path) -> Collection:
    """Read the result of a folder."""
    path, beside = (folder / name for name in (EVIDENCE_FILE, CORRESPONDENCES_FILE))
    if not path.is_file():
        raise InputError(
            f"{path}: there is no such file. Give the folder that `collalign align FOLDER --out OUT` wrote (its OUT)"
        )
    with _readable(path):
        data = load_arrays(read_source(path).content, path.name)
        format = int(data["version"])
    if format != EVIDENCE_VERSION:
        raise InputError(
            f"{path}: written in format {format}, but this version reads {EVIDENCE_VERSION}; "
            "run `collalign align` again"
        )
    with _readable(beside):
        content = load_arrays(read_source(beside).content, beside.name)
        correspondences = _correspondences(content, tuple(json.loads(data["text"].tobytes())["names"]))
    with _readable(path):
        return _collection(data, correspondences, folder)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Name the file in any error of this block: damaged archives fail in every way there is."""
    try:
        yield
    except Exception as error:
        raise InputError(
            f"{path}: damaged or not written by collalign ({error}); run `collalign align` again"
        ) from error


def _correspondences(data: dict[str, NDArray[Any]], names: tuple[str, ...]) -> dict[str, Any]:
    """Return what ``correspondences.npz`` holds of the collection, checked."""
    num, size = len(names), data["labels"].shape[-1]
    labels = as_indices(data["labels"], "labels", lower=-1, upper=len(data["consensus"]), shape=(num, size))
    samples = as_indices(data["vertex_indices"], "vertex_indices", upper=2**31, shape=(num, size))
    return {
        "samples": read_only(samples),
        "positions": read_only(as_floats(data["positions"], "positions", shape=(num, size, 3))),
        "maps": ConsistentMaps(names=names, labels=read_only(labels)),
        "consensus": read_only(as_floats(data["consensus"], "consensus", shape=(None, 3))),
    }


def _collection(data: dict[str, NDArray[Any]], correspondences: dict[str, Any], folder: Path) -> Collection:
    text = json.loads(data["text"].tobytes())
    decided = text["options"].pop("decided")
    names = tuple(text["names"])
    num = len(names)
    columns = {column: tuple(values) for column, values in text["labels"].items()}
    if any(len(values) != num for values in (text["files"], *columns.values())) or len(set(names)) != num:
        raise InputError(f"names: files and columns of labels for {num} shapes of different names")
    transforms = as_floats(data["transforms"], "transforms", shape=(num, 4, 4))
    if not np.linalg.det(transforms[:, :3, :3]).all():
        raise InputError("transforms: singular")
    vertices = tuple(read_only(as_points(part, "vertices", dim=3)) for part in _split("vertices", data, num))
    return Collection(
        names=names,
        files=tuple(text["files"]),
        labels=columns,
        excluded=tuple(Excluded(file=file, reason=reason) for file, reason in text["excluded"]),
        copies=tuple(Copies(names=tuple(of), kind=kind) for of, kind in text.get("copies", ())),
        group=decided["group"],
        own=tuple(decided.get("own", ())),
        options=as_options("options", text["options"], AlignOptions),
        run=RunRecord(
            versions=text["versions"],
            times_s=text["timings_s"],
            command=text.get("command", ""),
            date=text.get("date", ""),
        ),
        notes=tuple(map(Note.from_record, text["notes"])),
        by_hand={name: np.nan if value is None else float(value) for name, value in text.get("by_hand", {}).items()},
        transforms=read_only(transforms),
        confidence=read_only(_known(data["confidence"], "confidence", (num,))),
        landmarks=read_only(_known(data["samples"], "samples", (num, None, 3))),
        part_numbers=read_only(as_indices(data["groups"], "groups", upper=num, shape=(num,))),
        cycle_errors_deg=read_only(_known(data["cycle_errors_deg"], "cycle_errors_deg", (None,))),
        vertices=vertices,
        faces=tuple(
            read_only(as_faces(part, "faces", num_vertices=len(points)))
            for part, points in zip(_split("faces", data, num), vertices, strict=True)
        ),
        pairs=_pairs(data, correspondences["maps"]),
        alternatives=_alternatives(data, num),
        incomplete=_incomplete(data, num),
        places=_places(data, vertices),
        folder=folder,
        **correspondences,
    )


def _known(values: NDArray[Any], name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Check and return numbers, NaN where they are not known."""
    missing = np.isnan(values)
    return np.where(missing, np.nan, as_floats(np.where(missing, 0.0, values), name, shape=shape))


def _places(data: dict[str, NDArray[Any]], vertices: tuple[FloatArray, ...]) -> tuple[NDArray[np.uint8], ...]:
    if "places" not in data:
        return ()
    places = _split("places", data, len(vertices))
    for colours, points in zip(places, vertices, strict=True):
        if colours.dtype != np.uint8 or len(colours) not in (0, len(points)):
            raise InputError(f"places: {colours.dtype} colours of {len(colours)} vertices, not of {len(points)}")
    return tuple(read_only(colours) for colours in places)


def _split(name: str, data: dict[str, NDArray[Any]], num: int) -> tuple[NDArray[Any], ...]:
    joined = data[name]
    starts = as_indices(data[f"{name}_starts"], f"{name}_starts", upper=len(joined) + 1, shape=(num + 1,))
    return tuple(joined[a:b] for a, b in itertools.pairwise(starts))


def _pairs(data: dict[str, NDArray[Any]], common: ConsistentMaps) -> tuple[SettledPair, ...]:
    rotations = as_rotations(data["pose_rotation"], "pair poses", dim=3)
    energies = as_floats(data["pose_energy"], "pair energies", shape=(len(rotations),))
    ends = as_indices(data["pair_indices"], "pairs", upper=len(common.names), shape=(None, 2))
    if (ends[:, 0] == ends[:, 1]).any():
        raise InputError("pairs: a shape with itself")
    num_labels = int(common.labels.max(initial=-1)) + 1
    maps = as_indices(data["pair_maps"], "pair maps", lower=OWN_MAP, upper=num_labels, shape=(len(ends), num_labels))
    status = json.loads(data["pair_status"].tobytes())
    pairs = []
    for row, ((target, source), (start, stop)) in enumerate(
        zip(ends.tolist(), itertools.pairwise(data["pose_starts"].tolist()), strict=True)
    ):
        pairs.append(
            SettledPair(
                target=target,
                source=source,
                rotations=read_only(rotations[start:stop]),
                maps=read_only(np.zeros((stop - start, 0), dtype=np.int64)),
                energies=read_only(energies[start:stop]),
                map_target_source=read_only(_sample_map(maps[row], common, target, source)),
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


def _sample_map(of_labels: IntArray, common: ConsistentMaps, target: int, source: int) -> IntArray:
    """Return the sample of the target for each of the source's, from a map of labels."""
    if (of_labels == OWN_MAP).all():
        return common[target, source]
    at = np.append(np.full(len(of_labels), -1), -1)
    known = np.flatnonzero(common.labels[target] >= 0)
    at[common.labels[target][known]] = known
    return at[np.append(of_labels, -1)[common.labels[source]]]


def _alternatives(data: dict[str, NDArray[Any]], num: int) -> tuple[tuple[Alternative, ...], ...]:
    origins = json.loads(data["alternative_origin"].tobytes())
    rotations = as_rotations(data["alternative_rotation"], "alternatives", dim=3)
    none = np.full((len(rotations), 4, 4), np.nan)
    transforms = _known(data.get("alternative_transform", none), "alternatives", none.shape)
    whole = [None if np.isnan(one).any() else read_only(one) for one in transforms]
    poses = [
        Alternative(rotation=read_only(rotation), log_odds=float(log_odds), origin=origin, transform=transform)
        for rotation, log_odds, origin, transform in zip(
            rotations, data["alternative_log_odds"], origins, whole, strict=True
        )
    ]
    starts = as_indices(data["alternative_starts"], "alternatives", upper=len(poses) + 1, shape=(num + 1,))
    return tuple(tuple(poses[a:b]) for a, b in itertools.pairwise(starts))


def _incomplete(data: dict[str, NDArray[Any]], num: int) -> tuple[Incomplete, ...]:
    if "incomplete_shape" not in data:
        return ()
    partners = as_indices(data["partner_shape"], "partners", upper=num, shape=(None,))
    shapes = as_indices(data["incomplete_shape"], "incomplete shapes", upper=num, shape=(None,))
    overlaps = as_floats(data["partner_overlaps"], "overlaps", shape=(len(partners), 2))
    return tuple(
        Incomplete(
            shape=shape,
            reason=reason,
            partners=read_only(partners[start:stop]),
            overlaps=read_only(overlaps[start:stop]),
        )
        for shape, reason, (start, stop) in zip(
            shapes.tolist(),
            json.loads(data["incomplete_reason"].tobytes()),
            itertools.pairwise(data["partner_starts"].tolist()),
            strict=True,
        )
    )
