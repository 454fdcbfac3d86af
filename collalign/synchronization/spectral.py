"""The paper's synchronization (appendix B), and which shapes are mirrored: Z_2 synchronization of signs.

Frames are ``R_i_common``, so that ``R_i_j = frame_i @ frame_j.T``; the public result transposes them. Coordinates
that the pattern keeps apart are synchronized apart, as the paper does for mixed embeddings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from collalign.synchronization.graph import PairGraph, block_matrix, degrees
from data_tools.arrays import BoolArray, FloatArray, IntArray, as_points, as_rotations
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread
from pairwise.rotation_pattern import RotationPattern

#: A move that gains less than this part of a pair's evidence gains nothing.
_ROUNDING = 1e-9


@one_blas_thread()
def synchronize_signs(
    edges: IntArray, signs: FloatArray, weights: FloatArray, num_shapes: int
) -> BoolArray:
    """Return which shapes are mirrored, from signs of pairs that are partly wrong, shape (N,).

    Maximises ``sum_e w_e s_e x_i x_j`` over signs x: eigenvector of the signed adjacency (Cucuringu 2015), then the
    single moves that gain most. The first shape of every component counts as not mirrored.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    signs : ndarray, shape (E,)
        +1 or -1 each, for instance the determinants of the pairs' rotations.
    weights : ndarray, shape (E,)
        Log-odds that the pair's sign is right, divided by two.
    num_shapes : int

    Raises
    ------
    InputError
        If a sign is not 1 or -1, or the edges are not pairs of shapes.
    """
    graph = PairGraph.from_user(
        edges, signs[:, None, None], weights=weights, group="O", num_shapes=num_shapes
    )
    found = np.ones(graph.num_shapes)
    for members in graph.connected_components():
        part, kept = graph.subgraph(members)
        if part.num_edges:
            own = _signs_of_component(part, part.weights * signs[kept])
            found[members] = own * own[0]
    return found < 0


def _signs_of_component(graph: PairGraph, evidence: FloatArray) -> FloatArray:
    """Return the signs of a component."""
    left, right = graph.edges.T
    count = graph.num_shapes
    matrix = scipy.sparse.coo_matrix((evidence, (left, right)), shape=(count, count))
    size = np.bincount(graph.edges.ravel(), weights=np.repeat(np.abs(evidence), 2), minlength=count)
    scale = scipy.sparse.diags(1.0 / np.sqrt(np.maximum(size, 1e-300)))
    _, vector = leading_eigenvectors(
        (scale @ (matrix + matrix.T) @ scale + scipy.sparse.identity(count)).tocsr(), 1
    )
    signs = np.where(vector[:, 0] >= 0, 1.0, -1.0)
    both = (matrix + matrix.T).tocsr()
    agreed = signs * (both @ signs)
    while agreed.min() < -_ROUNDING * np.abs(evidence).max():
        signs[np.argmin(agreed)] *= -1.0
        agreed = signs * (both @ signs)
    return signs


#: Up to this many rows LAPACK finds the leading eigenvectors, beyond it Lanczos does; up to as many shapes the
#: Laplacian of least squares is factored densely.
DENSE_LIMIT = 400
#: Matrices with more than this share of entries are multiplied as dense ones.
DENSE_SHARE = 0.2
#: Lanczos vectors kept, at least and per eigenvector, and restarts at most.
LEAST_LANCZOS, LANCZOS_FACTOR, MAX_RESTARTS = 20, 4, 300
#: How far above the largest eigenvalue the factored matrix is shifted.
EIGENVALUE_SHIFT = 1e-6
#: Alternations of assignments and rotations, at most; they end when the energy falls by less than this share of it.
MAX_ALTERNATIONS, ALTERNATION_TOL = 100, 1e-6


def spectral_frames(graph: PairGraph, rotations: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the eigenprojection of the pairs, shape (N, d, d).

    The block matrix ``W`` has ``w_ij R_i_j`` off and, on a complete graph of equal weights, the identity on its
    diagonal: there the frames are the blocks of the top d eigenvectors times the square roots of their eigenvalues,
    projected onto the group (appendix B). Missing pairs are not zeros: on other graphs the eigenvectors are those of
    ``D^-1/2 W D^-1/2``, D the degrees (connection Laplacian; Singer and Wu 2012), divided by ``D^1/2``.

    Parameters
    ----------
    graph : PairGraph
        Connected.
    rotations : ndarray, shape (E, d, d)
        One rotation per pair.
    weights : ndarray, shape (E,)
        Not negative, positive on a connected set of pairs.
    """
    frames = np.zeros((graph.num_shapes, graph.dim, graph.dim))
    for index in graph.pattern.components:
        frames[:, index[:, None], index] = _component_blocks(graph, rotations, weights, index)
    return graph.pattern.project(_without_mirrored_gauge(frames, graph.pattern))


def _component_blocks(
    graph: PairGraph, rotations: FloatArray, weights: FloatArray, index: IntArray
) -> FloatArray:
    """Return the unprojected frames of one block of coordinates, shape (N, b, b)."""
    size = len(index)
    matrix = block_matrix(graph, rotations * weights[:, None, None], index)
    scale = np.ones(graph.num_shapes)
    if graph.is_complete and (not graph.num_edges or np.ptp(weights) == 0):
        matrix = matrix + (weights[0] if graph.num_edges else 1.0) * scipy.sparse.identity(
            matrix.shape[0], format="csr"
        )
    else:
        scale = 1.0 / np.sqrt(np.maximum(degrees(graph, weights), np.finfo(float).tiny))
        spread = scipy.sparse.diags(np.repeat(scale, size))
        matrix = spread @ matrix @ spread
    values, vectors = leading_eigenvectors(matrix, size)
    scaled = vectors * np.sqrt(np.maximum(values, 0.0)) * np.sqrt(graph.num_shapes)
    return scaled.reshape(graph.num_shapes, size, size) * (scale / scale.mean())[:, None, None]


def leading_eigenvectors(
    matrix: scipy.sparse.linalg.LinearOperator, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the largest eigenvalues, shape (count,), and their vectors (n, count), deterministically.

    Lanczos starts from a fixed vector. Where it does not converge (long chains have tiny gaps) the matrix is
    factored instead (shift and invert just above the spectrum of a normalised matrix).
    """
    total = matrix.shape[0]
    if total <= max(DENSE_LIMIT, count + 2):
        values, vectors = scipy.linalg.eigh(
            matrix.toarray(), subset_by_index=(total - count, total - 1)
        )
        return values, vectors
    operator = matrix.toarray() if matrix.nnz > DENSE_SHARE * total * total else matrix
    start = np.random.default_rng(0).standard_normal(total)
    try:
        size = max(LEAST_LANCZOS, LANCZOS_FACTOR * count)
        values, vectors = scipy.sparse.linalg.eigsh(
            operator, k=count, which="LA", v0=start, ncv=size, maxiter=MAX_RESTARTS
        )
    except scipy.sparse.linalg.ArpackNoConvergence:
        values, vectors = scipy.sparse.linalg.eigsh(
            matrix.tocsc(), k=count, sigma=1.0 + EIGENVALUE_SHIFT, which="LM", v0=start
        )
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]


def _without_mirrored_gauge(frames: FloatArray, pattern: RotationPattern) -> FloatArray:
    """Return the frames in the mirror image of their gauge where most blocks of determinant +1 came out as -1.

    Eigenvectors are known up to one orthogonal matrix; the projection onto rotations needs it to be a rotation.
    """
    fixed = frames.copy()
    for start, stop in pattern.special_blocks:
        if np.sum(np.linalg.slogdet(frames[:, start:stop, start:stop])[0]) < 0:
            fixed[:, :, start] *= -1.0
    return fixed


@one_blas_thread()
def alternate_assignments(
    samples: Sequence[FloatArray],
    rotations: FloatArray,
    *,
    pattern: RotationPattern | None = None,
) -> tuple[FloatArray, dict[tuple[int, int], IntArray], FloatArray]:
    """Alternate exact assignments of all pairs with closed-form rotations of all shapes (appendix B).

    Minimises ``sum_{i<j} |G_i x_i[map_i_j] - G_j x_j|^2`` over the rotations ``G_i = R_common_i`` and the maps.
    Each step is exact, so the energy never rises: assignments by :func:`scipy.optimize.linear_sum_assignment`, then
    one sweep of ``G_i = proj(sum_j G_j C_j_i)`` over the shapes, ``C_j_i`` the pair's cross-covariance.

    Parameters
    ----------
    samples : sequence of ndarray, shape (k_i, d)
        Centred samples of each shape.
    rotations : ndarray, shape (N, d, d)
        ``R_common_i`` to start from.
    pattern : RotationPattern, optional
        Full SO(d) by default.

    Returns
    -------
    rotations : ndarray, shape (N, d, d)
    maps : dict of (i, j) to ndarray of int
        ``map_i_j`` of every pair with ``k_i >= k_j``: the index on i of each sample of j.
    energies : ndarray
        After each round.

    Raises
    ------
    InputError
        If the shapes' numbers do not agree.
    """
    points = [as_points(x, f"samples[{i}]") for i, x in enumerate(samples)]
    frames = as_rotations(rotations, "rotations")
    if len(points) != len(frames) or {x.shape[1] for x in points} != {frames.shape[-1]}:
        raise InputError(
            f"samples: {len(points)} shapes for rotations of shape {frames.shape}, or another dimension"
        )
    kept = pattern or RotationPattern.from_user(None, frames.shape[-1], "SO")
    energies: list[float] = []
    maps: dict[tuple[int, int], IntArray] = {}
    for _ in range(MAX_ALTERNATIONS):
        maps, energy = assign_all_pairs(points, frames)
        energies.append(energy)
        if len(energies) > 1 and energies[-2] - energy <= ALTERNATION_TOL * energies[-2]:
            break
        frames = _rotations_from_maps(points, frames, maps, kept)
    return frames, maps, np.array(energies)


def assign_all_pairs(
    points: Sequence[FloatArray], frames: FloatArray
) -> tuple[dict[tuple[int, int], IntArray], float]:
    """Return the best map (k,) of every pair at the given ``R_common_i`` (N, d, d), and the energy of all."""
    posed = [x @ g.T for x, g in zip(points, frames, strict=True)]
    maps, energy = {}, 0.0
    for first in range(len(posed)):
        for second in range(first + 1, len(posed)):
            i, j = (first, second) if len(posed[first]) >= len(posed[second]) else (second, first)
            costs = (
                (posed[j] ** 2).sum(1)[:, None]
                + (posed[i] ** 2).sum(1)
                - 2.0 * posed[j] @ posed[i].T
            )
            rows, cols = scipy.optimize.linear_sum_assignment(costs)
            maps[i, j] = cols.astype(np.int64)
            energy += float(costs[rows, cols].sum())
    return maps, energy


def _rotations_from_maps(
    points: Sequence[FloatArray],
    frames: FloatArray,
    maps: dict[tuple[int, int], IntArray],
    pattern: RotationPattern,
) -> FloatArray:
    """Return ``R_common_i`` after one sweep: each is the best one for its maps, the others held."""
    covariances: list[list[tuple[int, FloatArray]]] = [[] for _ in points]
    for (i, j), found in maps.items():
        cross = points[i][found].T @ points[j]
        covariances[i].append((j, cross.T))
        covariances[j].append((i, cross))
    updated = frames.copy()
    for shape, terms in enumerate(covariances):
        if terms:
            updated[shape] = pattern.project(sum(updated[other] @ cross for other, cross in terms))
    return updated
