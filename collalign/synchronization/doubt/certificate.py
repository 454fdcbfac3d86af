"""The dual certificate of least-squares rotation synchronization (SE-Sync, Rosen et al. 2019; Shonan, Dellaert 2020).

It speaks of the optimisation only: it passes as well for a wrong answer whose pairs are consistently wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, identity

from collalign.synchronization.problem.graph import PairGraph, block_matrix
from collalign.synchronization.solvers.spectral import leading_eigenvectors
from data_tools.arrays import FloatArray, IntArray

#: A minimum eigenvalue above ``-CERTIFIED_TOL`` times the largest degree counts as zero.
CERTIFIED_TOL = 1e-6


@dataclass(frozen=True, kw_only=True)
class SynchronizationCertificate:
    """What is proven about the least-squares objective at its final weights.

    Attributes
    ----------
    objective : float
        ``sum_pairs w |R_i_j - G_i^T G_j|_F^2`` at the answer.
    min_eigenvalue : float
        Of the certificate matrix ``Lambda - W``, residual of the Lanczos iteration subtracted; the smallest over
        blocks of coordinates and components.
    suboptimality : float
        No rotations have an objective below ``objective - suboptimality``.
    optimal : bool
        Whether the minimum eigenvalue is zero to working accuracy: the answer is a global minimum of this
        objective.
    """

    objective: float
    min_eigenvalue: float
    suboptimality: float
    optimal: bool


def certify_frames(
    graph: PairGraph, rotations: FloatArray, weights: FloatArray, frames: FloatArray
) -> SynchronizationCertificate:
    """Compute the dual certificate of the given frames.

    With ``S`` the stacked frames ``R_i_common``, ``W`` the block matrix of ``w_ij R_i_j`` and ``Lambda`` the block
    diagonal of the symmetric parts of ``sum_j W_ij S_j S_i^T``, every feasible ``S'`` has ``tr S'^T W S' <=
    tr Lambda - lambda_min(Lambda - W) |S'|_F^2`` (Rosen et al. 2019, section 5.3).

    Parameters
    ----------
    graph : PairGraph
    rotations : ndarray, shape (E, d, d)
    weights : ndarray, shape (E,)
    frames : ndarray, shape (N, d, d)
    """
    left, right = graph.edges.T
    misfit = rotations - frames[left] @ np.swapaxes(frames[right], 1, 2)
    objective = float(weights @ (misfit**2).sum(axis=(1, 2)))
    smallest, gap, scale = 0.0, 0.0, 0.0
    for index in graph.pattern.components:
        eigenvalue, size = _min_eigenvalue(graph, rotations * weights[:, None, None], frames, index)
        smallest, scale = min(smallest, eigenvalue), max(scale, size)
        gap += max(0.0, -eigenvalue) * graph.num_shapes * len(index)
    return SynchronizationCertificate(
        objective=objective,
        min_eigenvalue=smallest,
        suboptimality=min(gap, objective),
        optimal=smallest >= -CERTIFIED_TOL * scale,
    )


def combine_certificates(parts: list[SynchronizationCertificate]) -> SynchronizationCertificate:
    """Return the certificate of several components together: objectives and gaps add."""
    return SynchronizationCertificate(
        objective=sum(part.objective for part in parts),
        min_eigenvalue=min((part.min_eigenvalue for part in parts), default=0.0),
        suboptimality=sum(part.suboptimality for part in parts),
        optimal=all(part.optimal for part in parts),
    )


def _min_eigenvalue(graph: PairGraph, blocks: FloatArray, frames: FloatArray, index: IntArray) -> tuple[float, float]:
    """Return the smallest eigenvalue of ``Lambda - W`` on one block of coordinates, and the scale of Lambda."""
    size = len(index)
    stacked = frames[:, index[:, None], index]
    matrix = block_matrix(graph, blocks, index)
    product = (matrix @ stacked.reshape(-1, size)).reshape(stacked.shape)
    multipliers = product @ np.swapaxes(stacked, 1, 2)
    multipliers = (multipliers + np.swapaxes(multipliers, 1, 2)) / 2.0
    scale = float(np.abs(multipliers).max(initial=0.0))
    if scale == 0.0:
        return 0.0, 1.0
    shifted = matrix - block_diag(list(multipliers), format="csr")
    total = shifted.shape[0]
    values, vectors = leading_eigenvectors(shifted / scale + identity(total, format="csr"), size)
    top = vectors[:, -1]
    residual = float(np.linalg.norm(shifted @ top / scale + (1.0 - values[-1]) * top))
    return scale * float(1.0 - values[-1] - residual), scale
