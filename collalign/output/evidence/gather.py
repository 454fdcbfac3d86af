"""Makes the plain record that report, exports and viewer read out of an ``Collection``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from collalign.products.aligned_collection import Collection
from collalign.products.evidence import CollectionView
from collalign.products.pair import Pair
from data_tools.arrays import FloatArray, IntArray
from data_tools.io.source import location
from data_tools.poses import AGREE_DEG, keep_apart, turn_deg
from data_tools.rotations import rotation_angles
from data_tools.threads import one_blas_thread

#: Cycles of three pairs looked at, spread evenly over all of them.
MOST_CYCLES = 20_000
#: Poses kept per pair.
MOST_PAIR_POSES = 4


@one_blas_thread()
def view_collection(
    collection: Collection,
    meshes: Sequence[tuple[FloatArray, IntArray]],
    *,
    labels: Mapping[str, tuple[str, ...]] | None = None,
    places: Sequence[NDArray[np.uint8]] = (),
) -> CollectionView:
    """Gather what is shown and exported.

    Parameters
    ----------
    collection : Collection
    meshes : sequence of (vertices, faces)
        The display mesh of each shape, in file coordinates; see :mod:`collalign.output.evidence.display_mesh`.
    labels : mapping of str to tuple of str, optional
        Column name to one value per shape; see :meth:`collalign.analysis.label_table.Labels.columns_for`.
    places : sequence of ndarray of uint8, each (v, 3), optional
        Colours of the display meshes' vertices by their places on the reference of the maps of all vertices.

    Returns
    -------
    CollectionView
    """
    inverse = np.linalg.inv(collection.transforms)
    raw = collection.positions @ np.swapaxes(inverse[:, :3, :3], 1, 2) + inverse[:, None, :3, 3]
    sample_labels = collection.maps.labels
    return CollectionView(
        names=collection.names,
        files=tuple(location(file) for file in collection.files),
        transforms=collection.transforms,
        confidence=collection.confidence,
        samples=by_label(raw, sample_labels),
        vertices=tuple(vertices for vertices, _ in meshes),
        faces=tuple(faces for _, faces in meshes),
        pairs=tuple(_shown(pair, sample_labels) for pair in collection.pairs),
        alternatives=collection.alternatives,
        part_numbers=part_numbers(collection.parts, len(collection.names)),
        labels=dict(labels or {}),
        excluded=tuple((one.file, one.reason) for one in collection.excluded),
        options=asdict(collection.options) | {"decided": {"group": collection.group}},
        versions=collection.run.versions,
        timings_s=collection.run.times_s,
        cycle_errors_deg=cycle_errors_deg(collection.pairs, len(collection.names)),
        notes=collection.notes,
        incomplete=collection.incomplete,
        places=tuple(places),
    )


def by_label(positions: FloatArray, labels: IntArray) -> FloatArray:
    """Reorder samples so that row b of every shape is label b, NaN where a shape lacks it.

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


def cycle_errors_deg(pairs: tuple[Pair, ...], num_shapes: int) -> FloatArray:
    """Angles left by R_ij R_jk R_ki, each pair giving its own pose of lowest energy; 180 where a cycle mirrors.

    At most :data:`MOST_CYCLES` cycles are looked at, evenly spaced in a fixed order.
    """
    found = {(pair.target, pair.source): pair.rotations[0, :3, :3] for pair in pairs if len(pair.rotations)}
    found |= {(j, i): R.T for (i, j), R in found.items()}
    chosen = _some_triangles(found.keys(), num_shapes)
    if not chosen:
        return np.empty(0)
    turns = np.array([found[i, j] @ found[j, k] @ found[k, i] for i, j, k in chosen])
    return np.degrees(rotation_angles(turns, np.eye(3)))


def _some_triangles(pairs: Iterable[tuple[int, int]], num_shapes: int) -> list[tuple[int, int, int]]:
    """Evenly spaced triangles i < j < k of a graph given by its pairs."""
    edges = sorted({(min(pair), max(pair)) for pair in pairs})
    later: list[list[int]] = [[] for _ in range(num_shapes)]
    for i, j in edges:
        later[i].append(j)
    common = [np.intersect1d(later[i], later[j], assume_unique=True) for i, j in edges]
    ends = np.cumsum([len(shapes) for shapes in common])
    total = int(ends[-1]) if len(ends) else 0
    wanted = np.unique(np.linspace(0, max(total - 1, 0), min(total, MOST_CYCLES)).astype(np.int64))
    triangles = []
    for number in wanted:
        at = int(np.searchsorted(ends, number, side="right"))
        triangles.append((*edges[at], int(common[at][number - ends[at] + len(common[at])])))
    return triangles


def _shown(pair: Pair, labels: IntArray) -> Pair:
    """Return a pair with the poses that a person would tell apart, and with its map in terms of labels."""
    kept, choice = distinct_poses(pair.rotations[:, :3, :3], pair.energies, pair.choice)
    return replace(
        pair,
        rotations=np.ascontiguousarray(pair.rotations[kept, :3, :3]),
        maps=np.zeros((len(kept), 0), dtype=np.int64),
        energies=pair.energies[kept],
        choice=choice,
        map_target_source=_label_map(
            pair.map_target_source, labels[pair.target], labels[pair.source], int(labels.max(initial=-1)) + 1
        ),
    )


def distinct_poses(rotations: FloatArray, energies: FloatArray, choice: int) -> tuple[list[int], int]:
    """Return the poses of a pair that a person would tell apart, and which of them stands for the chosen one.

    Parameters
    ----------
    rotations : ndarray, shape (m, 3, 3)
    energies : ndarray, shape (m,)
    choice : int
        Index of the pose that synchronization used, -1 for none.

    Returns
    -------
    kept : list of int
        Lowest energy first, at least :data:`AGREE_DEG` apart, at most :data:`MOST_PAIR_POSES`, but always one
        near the chosen pose.
    choice : int
        Index into ``kept``, -1 for none.
    """
    order = np.argsort(energies, kind="stable")
    kept = order[keep_apart(rotations[order], AGREE_DEG)].tolist()
    if choice < 0:
        return kept[:MOST_PAIR_POSES], -1
    near = next(at for at in kept if turn_deg(rotations[at], rotations[choice]) <= AGREE_DEG)
    shown = kept[:MOST_PAIR_POSES]
    if near not in shown:
        shown[-1] = near
    return shown, shown.index(near)


def _label_map(map_i_j: IntArray, labels_i: IntArray, labels_j: IntArray, num_labels: int) -> IntArray:
    """Turn a map of samples into one of labels, shape (num_labels,); empty where equal labels match anyway."""
    known = labels_j >= 0
    found = np.where(map_i_j >= 0, labels_i[map_i_j], -1)[known]
    if np.array_equal(found, labels_j[known]):
        return np.zeros(0, dtype=np.int64)
    by_labels = np.full(num_labels, -1, dtype=np.int64)
    by_labels[labels_j[known]] = found
    return by_labels


def part_numbers(parts: tuple[IntArray, ...], num_shapes: int) -> IntArray:
    """Return the number of the group of each shape."""
    numbers = np.zeros(num_shapes, dtype=np.int64)
    for number, members in enumerate(parts):
        numbers[members] = number
    return numbers
