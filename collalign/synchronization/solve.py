"""The public entry of synchronization: many relative rotations in, one pose per shape and its doubts out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from collalign.synchronization.frames import angles_rad, fix_gauge, relative, transposed
from collalign.synchronization.graph import GraphArguments, PairGraph, check_pattern
from collalign.synchronization.robust import (
    SynchronizationResult,
    connectivity_warnings,
    robust_synchronization,
)
from collalign.synchronization.spectral import spectral_frames
from data_tools.arrays import FloatArray, as_rotations, read_only
from data_tools.checks import check_choice
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

METHODS = ("robust", "spectral")
#: The eigenprojection calls a pair an inlier within this angle of its answer.
SPECTRAL_INLIER_RAD = np.deg2rad(30.0)


@one_blas_thread()
def synchronize(
    edges: ArrayLike,
    rotations: ArrayLike,
    *,
    method: str = "robust",
    fixed: Mapping[int, ArrayLike] | None = None,
    reference: int = 0,
    **keywords: Unpack[GraphArguments],
) -> SynchronizationResult:
    """Find one pose per shape from the pairs' relative rotations, and say how far each can be trusted.

    Parameters
    ----------
    edges : array_like of int, shape (E, 2)
        Shapes i, j of each pair; each unordered pair at most once.
    rotations : array_like, shape (E, d, d) or (E, m, d, d)
        ``R_i_j``, taking j's coordinates to i's, or m candidates of it.
    method : {"robust", "spectral"}
        ``"robust"`` finds the most likely poses under a model whose noise, outliers and use of energies are estimated
        from the pairs. ``"spectral"`` is the eigenprojection of appendix B of Maron et al. (2016) of each pair's
        best candidate.
    fixed : mapping of int to array_like (d, d), optional
        ``R_common_i`` of shapes that a user has set by hand: they come out exactly so.
    reference : int
        Shape whose pose is the identity (in its component; the first member in others), where none is fixed.
    **keywords
        What else makes the graph, as in :meth:`collalign.synchronization.PairGraph.from_user`: ``energies`` of the
        candidates, ``weights`` of the pairs, ``group`` ("SO", or "O", where shapes may come out mirrored),
        ``num_shapes`` and ``rotation_pattern``.

    Returns
    -------
    SynchronizationResult
        ``R_i_j = rotations[i].T @ rotations[j]`` for a consistent pair.

    Raises
    ------
    InputError
        If an index is out of range, a pair is a loop or repeated, or a matrix is not finite or not in the group.
    OptionsError
        If the method or the group is unknown.

    Examples
    --------
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> found = collalign.synchronize([(0, 1), (1, 2), (0, 2)], [quarter, quarter, quarter @ quarter])
    >>> bool(np.allclose(found.rotations[2], quarter @ quarter))
    True
    """
    check_choice("method", method, METHODS)
    graph = PairGraph.from_user(edges, rotations, **keywords)
    if not 0 <= reference < graph.num_shapes:
        raise InputError(f"reference: shape {reference} of {graph.num_shapes}")
    return synchronize_graph(
        graph, method=method, fixed=_checked_fixed(fixed, graph), reference=reference
    )


@one_blas_thread()
def synchronize_graph(
    graph: PairGraph,
    *,
    method: str = "robust",
    fixed: Mapping[int, FloatArray] | None = None,
    reference: int = 0,
) -> SynchronizationResult:
    """Synchronize as :func:`synchronize` does, from a checked graph and checked fixed poses (d, d).

    Examples
    --------
    >>> graph = collalign.pair_graph(collalign.load("aligned").pairs, 3, "SO")
    >>> collalign.synchronization.synchronize_graph(graph).rotations.shape
    (3, 3, 3)
    """
    if method == "spectral":
        return _eigenprojection(graph, fixed or {}, reference)
    return robust_synchronization(graph, fixed or {}, reference)


def _eigenprojection(
    graph: PairGraph, fixed: Mapping[int, FloatArray], reference: int
) -> SynchronizationResult:
    """Return what the eigenprojection makes of the best candidates, one connected part after the other."""
    frames = np.tile(np.eye(graph.dim), (graph.num_shapes, 1, 1))
    components = graph.connected_components()
    chosen = graph.chosen(graph.best_choice)
    for members in components:
        part, kept = graph.subgraph(members)
        if part.num_edges:
            frames[members] = spectral_frames(part, chosen[kept], part.weights)
    poses = fix_gauge(
        transposed(frames), components, reference=reference, fixed=fixed, pattern=graph.pattern
    )
    misfit = angles_rad(transposed(chosen) @ relative(transposed(poses), graph.edges))
    return SynchronizationResult(
        rotations=read_only(poses),
        confidence=read_only(np.full(graph.num_shapes, np.nan)),
        edge_inlier=read_only(misfit <= SPECTRAL_INLIER_RAD),
        edge_choice=read_only(graph.best_choice),
        parts=components,
        components=components,
        alternatives=((),) * graph.num_shapes,
        warnings=connectivity_warnings(len(components)),
    )


def _checked_fixed(
    fixed: Mapping[int, ArrayLike] | None, graph: PairGraph
) -> dict[int, FloatArray]:
    """Return the fixed poses checked, by shape."""
    checked = {}
    for shape, pose in (fixed or {}).items():
        if not 0 <= int(shape) < graph.num_shapes:
            raise InputError(f"fixed: shape {shape} of {graph.num_shapes}")
        checked[int(shape)] = as_rotations(pose, f"fixed[{shape}]", dim=graph.dim)
        check_pattern(checked[int(shape)], f"fixed[{shape}]", graph.pattern)
    return checked
