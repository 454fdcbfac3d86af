"""Scalars of a surface point that no rotation changes: kernel signatures and distances.

Everything is for the surface scaled to unit area, so that shapes of any size compare.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.geodesics import GeodesicSolver
from data_tools.surface.laplacian import Spectrum, vertex_areas
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges, is_open_surface

#: Times of the heat kernel signature.
HKS_TIMES = (0.003, 0.01, 0.03, 0.1)
#: Eigenpairs used for signatures: at the shortest time the next one counts exp(-2.3).
NUM_SPECTRUM = 60


def heat_kernel_signature(eigen: Spectrum, times: tuple[float, ...] = HKS_TIMES) -> FloatArray:
    """Return log h_t(x), h_t(x) = 1 + sum_i exp(-lambda_i t) phi_i(x)^2, shape (v, len(times)).

    Sun, Ovsjanikov and Guibas 2009; the 1 is the constant eigenfunction.
    """
    decay = np.exp(-np.outer(eigen.values, times))
    return np.log1p(eigen.functions**2 @ decay)


def wave_kernel_signature(eigen: Spectrum, num_energies: int) -> FloatArray:
    """Return the logarithm of the wave kernel signature, shape (v, num_energies).

    Aubry, Schlickewei and Cremers 2011: sums of phi_i^2 over Gaussian windows in log lambda. The energies depend
    only on the number m of eigenpairs: log lambda from that of 4 pi to that of 4 pi m, the Weyl law's range for
    unit area; the windows are two steps wide.
    """
    energies = np.linspace(np.log(4 * np.pi), np.log(4 * np.pi * len(eigen.values)), num_energies)
    width = 2.0 * (energies[-1] - energies[0]) / max(num_energies - 1, 1)
    logs = np.log(np.maximum(eigen.values, 1e-12))
    windows = np.exp(-((energies - logs[:, None]) ** 2) / (2.0 * width**2))
    squares = eigen.functions**2 @ (windows / np.maximum(windows.sum(axis=0), 1e-300))
    return np.log(np.maximum(squares, 1e-12))


def boundary_distance(shape: Shape, solver: GeodesicSolver) -> FloatArray:
    """Return the geodesic distance to the rim, divided by the square root of the area, shape (v,).

    Zero everywhere on closed surfaces (small holes do not count) and point clouds.
    """
    if not is_open_surface(shape.vertices, shape.faces):
        return np.zeros(len(shape.vertices))
    rim = np.unique(boundary_edges(shape.faces))
    distances = solver.from_vertices(rim)
    reachable = np.isfinite(distances)
    return np.where(reachable, distances, distances.max(initial=0.0, where=reachable)) / np.sqrt(
        vertex_areas(shape).sum()
    )


def standardised(values: FloatArray, samples: IntArray) -> FloatArray:
    """Return columns at the samples with mean 0 and, together, Frobenius norm 1.

    Each column is divided by its own deviation; a column without variation becomes zero.

    Parameters
    ----------
    values : ndarray, shape (v, m)
    samples : ndarray of int, shape (k,)

    Returns
    -------
    ndarray, shape (k, m)
    """
    chosen = values[samples] - values[samples].mean(axis=0)
    deviation = np.sqrt((chosen**2).mean(axis=0))
    flat = deviation <= 1e-9 * np.maximum(np.abs(values[samples]).max(axis=0), 1e-300)
    scaled = np.where(flat, 0.0, chosen / np.where(flat, 1.0, deviation))
    return scaled / np.sqrt(scaled.size)
