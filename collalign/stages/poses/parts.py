"""Splits a mixed folder into parts whose pairs agree, aligns each on its own, and turns the parts to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from collalign.options import AlignOptions
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints
from collalign.stages.poses.placement import rotated_solution
from collalign.stages.poses.synchronize import pair_graph
from collalign.synchronization import SynchronizationResult, find_parts
from collalign.synchronization.clusters import part_rotations
from data_tools.arrays import IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.errors import CollectionError
from data_tools.notes import Note
from data_tools.poses import APART_DEG
from data_tools.rotations import rotation_angle_deg


def split_shapes(
    options: AlignOptions, samples: Sequence[Samples], pairs: Sequence[Pair]
) -> tuple[IntArray | None, list[Pair]]:
    """Split the shapes into parts whose pairs agree; ``options.clusters`` is their number, 0 to find it.

    Returns
    -------
    labels : ndarray of int, shape (N,), or None
        Part of each shape; None where all shapes are aligned together.
    linked : list of Pair
        The pairs within a part.

    Raises
    ------
    CollectionError
        If no pair is left within a part.
    """
    if options.clusters == 1:
        return None, list(pairs)
    labels = find_parts(
        pair_graph(pairs, len(samples), options.group), num_parts=options.clusters or None
    )
    linked = [pairs[e] for e in _within(labels, pairs)]
    if not linked:
        raise CollectionError(
            f"clusters: {labels.max() + 1} parts leave every shape alone; ask for fewer"
        )
    return labels, linked


def join_parts(
    options: AlignOptions,
    labels: IntArray | None,
    pairs: Sequence[Pair],
    linked: Sequence[Pair],
    solution: SynchronizationResult,
    constraints: Constraints,
) -> tuple[list[Pair], SynchronizationResult]:
    """Turn the parts to each other as most pairs between them ask for.

    The part of the reference and parts with fixed shapes stay.

    Parameters
    ----------
    options : AlignOptions
        With a decided group.
    labels : ndarray of int, shape (N,), or None
        From :func:`split_shapes`.
    pairs : sequence of Pair
        All pairs.
    linked : sequence of Pair
        Those within parts, as synchronized.
    solution : SynchronizationResult
        Of ``linked``.
    constraints : Constraints

    Returns
    -------
    pairs : list of Pair
        All pairs, in the order given.
    solution : SynchronizationResult
        Of all shapes and pairs; its ``parts`` are those of the split, or smaller.
    """
    if labels is None:
        return list(linked), solution
    within, merged = _within(labels, pairs), list(pairs)
    for e, pair in zip(within, linked, strict=True):
        merged[e] = pair
    stay = set(labels[[constraints.reference, *constraints.fixed]].tolist())
    graph = pair_graph(pairs, len(labels), options.group)
    solution = rotated_solution(solution, part_rotations(graph, labels, solution.rotations, stay))
    return merged, _with_all_pairs(solution, merged, np.array(within), labels)


def _within(labels: IntArray, pairs: Sequence[Pair]) -> list[int]:
    """Return the pairs within a part."""
    return [e for e, pair in enumerate(pairs) if labels[pair.target] == labels[pair.source]]


def _with_all_pairs(
    solution: SynchronizationResult,
    pairs: Sequence[Pair],
    within: IntArray,
    labels: IntArray,
) -> SynchronizationResult:
    """Return the solution with the pairs between parts beside those within, and with words about the split."""
    frames = solution.rotations
    choice = np.empty(len(pairs), dtype=np.int64)
    misfit_deg = np.empty(len(pairs))
    for e, pair in enumerate(pairs):
        common = frames[pair.target].T @ frames[pair.source]
        angles = rotation_angle_deg(pair.rotations[:, :3, :3], common)
        choice[e], misfit_deg[e] = np.argmin(angles), np.min(angles)
    inlier = misfit_deg <= APART_DEG
    choice[within], inlier[within] = solution.edge_choice, solution.edge_inlier
    counts = np.bincount(labels)
    split = Note("different-parts", values={"num": len(counts), "sizes": tuple(counts.tolist())})
    # The first note counts the parts as unconnected, unless one of them fell apart further.
    own = (
        solution.warnings[1:] if len(counts) == len(solution.components) > 1 else solution.warnings
    )
    return replace(
        solution,
        edge_choice=read_only(choice),
        edge_inlier=read_only(inlier),
        warnings=(split, *own) if len(counts) > 1 else own,
    )
