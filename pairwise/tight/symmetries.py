"""All optimal rotations of symmetric shapes from the moment matrix of the tight relaxation.

Where the relaxation is exact, its moments are an average of ``z z^T`` over optimal rotations, z = (1, [R]), so that
every optimal rotation that it contains has z in their range, and their number is the rank as long as the z are
linearly independent. A rotation in the range need not be optimal (the range of four rotations about one axis holds
the circle), so each one found is minimised locally and kept only if its energy is optimal.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.errors import InputError
from data_tools.rotations import nearest_orthogonal, rotation_angles
from data_tools.threads import one_blas_thread
from pairwise.local.local_search import minimise
from pairwise.local.rotation_sets import rotation_set
from pairwise.problem.problem import Problem
from pairwise.tight.problem import chiralities, energy_scale, mirror

#: Rotations from which the range of the moments is searched.
_NUM_STARTS = {2: 90, 3: 600}
#: Projections of a rotation onto the range and back; they converge linearly.
_NUM_PROJECTIONS = 60
#: Rotations whose lifted vector (of length 2 for d = 3) is that near to the range are in it.
_CONTAINED = 0.05
#: Optimal rotations nearer than this are one, in radians.
_DISTINCT_RAD = 1e-3


@one_blas_thread()
def optimal_rotations(
    problem: Problem, moments: FloatArray, *, tol: float = 1e-6, rank_tol: float = 1e-3
) -> FloatArray:
    """Return the distinct optimal rotations that the moments of an exact relaxation contain.

    Parameters
    ----------
    problem : Problem
    moments : ndarray, shape (1 + d * d, 1 + d * d)
        Of :func:`pairwise.tight.solve.solve_tight`, form "tight"; of one chirality, as that function gives them.
    tol : float
        An energy is optimal if it exceeds the best one by at most this, relative to the problem's scale.
    rank_tol : float
        Eigenvalues of the moments below this times the largest count as zero.

    Returns
    -------
    ndarray, shape (m, d, d)
        In the order of their energies. Where the optimal rotations form a continuum, a sample of them.

    Raises
    ------
    InputError
        If the moments have another shape.

    Examples
    --------
    >>> square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    >>> relaxed = pairwise.solve_relaxation(square, square, relaxation="tight")
    >>> problem = pairwise.Problem.from_user(square, square)
    >>> len(pairwise.optimal_rotations(problem, relaxed.moments))
    4
    """
    size = 1 + problem.dim**2
    if moments.shape != (size, size):
        raise InputError(f"moments: expected shape ({size}, {size}), got {moments.shape}")
    values, vectors = np.linalg.eigh(moments)
    span = vectors[:, values > rank_tol * values[-1]]
    rotations, energies = [], []
    for reflected, part in chiralities(problem):
        signs = mirror(problem.dim) if reflected else np.ones(problem.dim)
        found = minimise(part, _rotations_in(span, problem.dim, signs))
        rotations.append(found.rotations * signs)
        energies.append(found.energies)
    energy, candidates = np.concatenate(energies), np.concatenate(rotations)
    is_optimal = energy <= energy.min() + tol * energy_scale(problem)
    is_contained = _distance(candidates, span) <= _CONTAINED
    kept = np.flatnonzero(is_optimal & is_contained)
    optimal = candidates[kept[np.argsort(energy[kept], kind="stable")]]
    distinct: list[FloatArray] = []
    for rotation in optimal:
        if not distinct or rotation_angles(np.array(distinct), rotation).min() > _DISTINCT_RAD:
            distinct.append(rotation)
    return read_only(np.array(distinct).reshape(-1, problem.dim, problem.dim))


def _rotations_in(span: FloatArray, dim: int, signs: FloatArray) -> FloatArray:
    """Alternate between the range (columns of ``span``) and the rotations times ``signs``, from an even set.

    Returned without the signs, and only where the distance to the range is among the smallest reached.
    """
    rotations = rotation_set(dim, _NUM_STARTS[dim])
    for _ in range(_NUM_PROJECTIONS):
        z = _lifted(rotations * signs)
        projected = (z @ span) @ span.T
        matrices = np.swapaxes(projected[:, 1:].reshape(-1, dim, dim), 1, 2) * signs
        rotations = nearest_orthogonal(matrices, determinant=1.0)
    distance = _distance(rotations * signs, span)
    return rotations[distance <= distance.min() + _CONTAINED]


def _distance(rotations: FloatArray, span: FloatArray) -> FloatArray:
    z = _lifted(rotations)
    return np.asarray(np.linalg.norm(z - (z @ span) @ span.T, axis=1))


def _lifted(matrices: FloatArray) -> FloatArray:
    columns = np.swapaxes(matrices, 1, 2).reshape(len(matrices), -1)
    return np.concatenate([np.ones((len(matrices), 1)), columns], axis=1)
