"""A picture of a distance matrix: multidimensional scaling."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_floats
from data_tools.threads import one_blas_thread

#: Coordinates of multidimensional scaling.
NUM_DIMENSIONS = 2


@one_blas_thread()
def classical_mds(distances: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return principal coordinates (classical multidimensional scaling) of a complete distance matrix.

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
