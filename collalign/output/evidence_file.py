"""What is kept of a collection: ``evidence.npz`` with all that is shown, correspondences for others, and its run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from collalign.engine.records import to_arrays, to_record
from collalign.output.collection_data import CollectionData
from collalign.products.pair import AlignedPair, Pair
from collalign.products.run_record import RunRecord
from data_tools.arrays import FloatArray, IntArray
from data_tools.io.files import write_atomic
from data_tools.poses import AGREE_DEG, keep_apart, pose_angle_deg
from data_tools.rotations import rotation_angles

#: Cycles of three pairs looked at, spread evenly over all of them.
MOST_CYCLES_SEEN = 20_000
#: Poses kept per pair.
MOST_PAIR_POSES = 4
#: In place of the labels of a pair that uses the collection's own correspondence.
OWN_MAP = -2


def by_label(positions: FloatArray, labels: IntArray) -> FloatArray:
    """Return samples as files of a result have them: row b of every shape is label b, NaN where it is lacking.

    Parameters
    ----------
    positions : ndarray, shape (N, k, 3)
    labels : ndarray of int, shape (N, k)
        -1 for samples without a label, which are dropped.

    Returns
    -------
    ndarray, shape (N, num_labels, 3)
    """
    ordered = np.full((len(labels), int(labels.max(initial=-1)) + 1, 3), np.nan)
    shapes, samples = np.nonzero(labels >= 0)
    ordered[shapes, labels[shapes, samples]] = positions[shapes, samples]
    return ordered


def cycle_errors_deg(pairs: Sequence[Pair], num_shapes: int) -> FloatArray:
    """Return angles (c,) left by R_ij R_jk R_ki, each pair giving its own likeliest pose; 180 where a cycle mirrors.

    At most :data:`MOST_CYCLES_SEEN` cycles are looked at, evenly spaced in a fixed order.
    """
    found = {
        (pair.target, pair.source): pair.rotations[np.argmin(pair.doubts), :3, :3] for pair in pairs
    }
    found |= {(j, i): R.T for (i, j), R in found.items()}
    chosen = _some_triangles(found.keys(), num_shapes)
    if not chosen:
        return np.empty(0)
    cycles = np.array([found[i, j] @ found[j, k] @ found[k, i] for i, j, k in chosen])
    return np.degrees(rotation_angles(cycles, np.eye(3)))


def _some_triangles(
    pairs: Iterable[tuple[int, int]], num_shapes: int
) -> list[tuple[int, int, int]]:
    """Return evenly spaced triangles i < j < k of a graph given by its pairs."""
    edges = sorted({(min(pair), max(pair)) for pair in pairs})
    later: list[list[int]] = [[] for _ in range(num_shapes)]
    for i, j in edges:
        later[i].append(j)
    common = [np.intersect1d(later[i], later[j], assume_unique=True) for i, j in edges]
    ends = np.cumsum([len(shapes) for shapes in common])
    total = int(ends[-1]) if len(ends) else 0
    wanted = np.unique(
        np.linspace(0, max(total - 1, 0), min(total, MOST_CYCLES_SEEN)).astype(np.int64)
    )
    triangles = []
    for number in wanted:
        at = int(np.searchsorted(ends, number, side="right"))
        triangles.append((*edges[at], int(common[at][number - ends[at] + len(common[at])])))
    return triangles


def shown_pair(pair: AlignedPair) -> AlignedPair:
    """Return a pair with the poses that a person would tell apart, the likeliest first, without their maps."""
    kept, choice = distinct_poses(pair.rotations[:, :3, :3], pair.doubts, pair.choice)
    return AlignedPair(
        target=pair.target,
        source=pair.source,
        rotations=np.ascontiguousarray(pair.rotations[kept, :3, :3]),
        maps=np.zeros((len(kept), 0), dtype=np.int64),
        energies=pair.energies[kept],
        how=pair.how,
        lower_bound=pair.lower_bound,
        status=pair.status,
        chirality_proven=pair.chirality_proven,
        choice=choice,
        inlier=pair.inlier,
        disagreement_deg=pair.disagreement_deg,
        map_target_source=pair.map_target_source,
        energy=pair.energy,
    )


def distinct_poses(rotations: FloatArray, doubts: FloatArray, choice: int) -> tuple[list[int], int]:
    """Return the poses of a pair that a person would tell apart, and which of them stands for the chosen one.

    Parameters
    ----------
    rotations : ndarray, shape (m, 3, 3)
    doubts : ndarray, shape (m,)
        As :attr:`~collalign.products.pair.Pair.doubts`.
    choice : int
        Index of the pose that synchronization used, -1 for none.

    Returns
    -------
    kept : list of int
        Least doubt first, at least :data:`AGREE_DEG` apart, at most :data:`MOST_PAIR_POSES`, but always one
        near the chosen pose.
    choice : int
        Index into ``kept``, -1 for none.
    """
    order = np.argsort(doubts, kind="stable")
    kept = order[keep_apart(rotations[order], AGREE_DEG)].tolist()
    if choice < 0:
        return kept[:MOST_PAIR_POSES], -1
    near = next(at for at in kept if pose_angle_deg(rotations[at], rotations[choice]) <= AGREE_DEG)
    shown = kept[:MOST_PAIR_POSES]
    if near not in shown:
        shown[-1] = near
    return shown, shown.index(near)


def label_maps(pairs: Sequence[AlignedPair], labels: IntArray) -> IntArray:
    """Return the map of each pair in terms of labels (N, k).

    Returns
    -------
    ndarray of int, shape (E, num_labels)
        The label on the target of the sample with label b on the source, -1 where unmatched; all :data:`OWN_MAP`
        where equal labels match, as in the collection's own correspondence.
    """
    maps = np.full((len(pairs), int(labels.max(initial=-1)) + 1), OWN_MAP)
    for row, pair in zip(maps, pairs, strict=True):
        known = labels[pair.source] >= 0
        found = np.where(
            pair.map_target_source >= 0, labels[pair.target][pair.map_target_source], -1
        )[known]
        if not np.array_equal(found, labels[pair.source][known]):
            row[:] = -1
            row[labels[pair.source][known]] = found
    return maps


def part_numbers(parts: tuple[IntArray, ...], num_shapes: int) -> IntArray:
    """Return the number of the group of each shape, shape (N,), from the positions in each group (n,)."""
    numbers = np.zeros(num_shapes, dtype=np.int64)
    for number, members in enumerate(parts):
        numbers[members] = number
    return numbers


#: Name of the file inside a result's folder.
EVIDENCE_FILE = "evidence.npz"
CORRESPONDENCES_FILE = "correspondences.npz"
#: The only file of a result that differs between two runs with the same result.
RUN_FILE = "run.json"
#: Raised with every change that older readers cannot understand.
EVIDENCE_VERSION = 6
#: Fields of a collection that ``correspondences.npz`` has, and their names there.
CORRESPONDENCES = {"samples": "vertex_indices", "positions": "positions", "consensus": "consensus"}


def save_evidence(collection: CollectionData, folder: Path | str) -> Path:
    """Write ``evidence.npz`` into ``folder``; the same collection gives the same bytes.

    It holds the fields of :class:`collalign.Collection` by their names, all but those of ``correspondences.npz`` and
    how the run went, which is in ``run.json``.

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
    record = to_record(replace(collection, folder=None, fresh=None))
    arrays = to_arrays(
        {name: record[name] for name in record if name not in {"maps", "run", *CORRESPONDENCES}}
    )
    np.savez_compressed(path, version=np.array(EVIDENCE_VERSION), **arrays)  # type: ignore[arg-type]
    return path


def save_run(run: RunRecord, folder: Path) -> None:
    """Write ``run.json`` into a folder: date, command, times and versions."""
    write_atomic(folder / RUN_FILE, json.dumps(asdict(run), indent=1).encode())


def save_correspondences(collection: CollectionData, folder: Path) -> None:
    """Write ``correspondences.npz`` into a folder."""
    np.savez_compressed(
        folder / CORRESPONDENCES_FILE,
        names=np.array(collection.names),
        labels=collection.maps.labels,
        **{there: getattr(collection, name) for name, there in CORRESPONDENCES.items()},
    )
