"""Pictures of a distance matrix: multidimensional scaling and the cophenetic tree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.cluster.hierarchy import cophenet, leaves_list, linkage
from scipy.spatial.distance import squareform

from data_tools.arrays import FloatArray, IntArray, as_floats, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Coordinates of multidimensional scaling.
NUM_DIMENSIONS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Tree:
    """A hierarchical clustering of shapes.

    Attributes
    ----------
    linkage : ndarray, shape (N - 1, 4)
        In SciPy's form: the two clusters joined, their distance, the number of shapes.
    order : ndarray of int, shape (N,)
        Leaves as drawn from top to bottom.
    correlation : float
        Between cophenetic and given distances: how much of them a tree can show; NaN for fewer than three shapes.
    """

    linkage: FloatArray
    order: IntArray
    correlation: float


@one_blas_thread()
def classical_mds(distances: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Classical multidimensional scaling (principal coordinates) of a complete distance matrix.

    Parameters
    ----------
    distances : array_like, shape (N, N)

    Returns
    -------
    coordinates : ndarray, shape (N, NUM_DIMENSIONS)
        The largest entry of each column is positive.
    shares : ndarray, shape (NUM_DIMENSIONS,)
        Part of the sum of positive eigenvalues that each axis shows.

    References
    ----------
    Torgerson, Multidimensional scaling: I. Theory and method, Psychometrika 17 (1952).
    """
    squared = as_floats(distances, "distances") ** 2
    centring = np.eye(len(squared)) - 1.0 / len(squared)
    values, vectors = np.linalg.eigh(-0.5 * centring @ squared @ centring)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    coordinates = np.zeros((len(squared), NUM_DIMENSIONS))
    count = min(NUM_DIMENSIONS, len(squared))
    coordinates[:, :count] = (vectors * np.sqrt(values))[:, :count]
    largest = np.abs(coordinates).argmax(axis=0)
    coordinates *= np.where(coordinates[largest, np.arange(NUM_DIMENSIONS)] < 0, -1.0, 1.0)
    shares = np.zeros(NUM_DIMENSIONS)
    shares[:count] = values[:count] / max(float(values.sum()), np.finfo(float).tiny)
    return coordinates, shares


def cophenetic_tree(distances: ArrayLike) -> Tree:
    """Cluster shapes hierarchically by a complete distance matrix, by average linkage (UPGMA).

    Raises
    ------
    InputError
        If there are fewer than two shapes, or distances are missing.
    """
    matrix = as_floats(distances, "distances")
    if len(matrix) < 2:
        raise InputError(f"distances: a tree needs at least two shapes, got {len(matrix)}")
    condensed = squareform(matrix, checks=False)
    joined = linkage(condensed, method="average")
    heights = cophenet(joined)
    spread = min(float(np.ptp(condensed)), float(np.ptp(heights)))
    return Tree(
        linkage=read_only(joined),
        order=read_only(leaves_list(joined).astype(np.int64)),
        correlation=float(np.corrcoef(condensed, heights)[0, 1]) if spread > 0 else float("nan"),
    )
