"""The Laplace-Beltrami operator from geodesics between samples: the paper's choice for FAUST, free of any mesh."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.surface.geodesics import GeodesicSolver
from data_tools.surface.laplacian import Spectrum, vertex_areas
from data_tools.surface.shape import Shape

#: Neighbours of each sample, and the width of the Gaussian relative to sqrt(area) (Maron et al. 2016, section 6.1).
NUM_NEIGHBOURS, GAUSSIAN_WIDTH = 20, 0.1


def graph_spectrum_of(surface: WorkingSurface, samples: IntArray, num: int) -> Spectrum:
    """Return the spectrum of a surface's graph of dense samples."""
    return graph_spectrum(surface.shape, surface.geodesics, samples, num)


def graph_spectrum(shape: Shape, geodesics: GeodesicSolver, samples: IntArray, num: int) -> Spectrum:
    """Return the lowest eigenpairs of the graph Laplacian of samples, extended to all vertices.

    Weights are ``exp(-g^2 / 0.1^2)`` between each sample and its 20 nearest ones, g the geodesic distance over
    sqrt(area); the eigenproblem is ``L phi = lambda M phi`` with M the samples' shares of the area. Eigenfunctions
    are extended by ``phi(x) = sum_s w(x, s) phi(s) / sum_s w(x, s)`` over the nearest samples. Eigenvalues are scaled
    such that the last agrees with Weyl's law at unit area, 4 pi m, because the Gaussian sets their unit otherwise.

    Parameters
    ----------
    shape : Shape
        Mesh or point cloud.
    geodesics : GeodesicSolver
        Of the shape.
    samples : ndarray of int, shape (s,)
        Well spread vertices; costs one geodesic solve each.
    num : int
        Eigenpairs, without the constant one.
    """
    if num > len(samples) - 2:
        raise InputError(f"{shape.name}: {len(samples)} samples are too few for {num} eigenfunctions of their graph")
    areas = vertex_areas(shape)
    to_samples = np.stack([geodesics.from_vertex(int(s)) for s in samples]) / np.sqrt(areas.sum())
    nearest = to_samples.argmin(axis=0)
    mass = np.bincount(nearest, weights=areas, minlength=len(samples)) / areas.sum()
    mass = np.maximum(mass, 1e-3 / len(samples))
    weights = _weights(to_samples[:, samples])
    weights = np.maximum(weights, weights.T)
    laplacian = np.diag(weights.sum(axis=1)) - weights
    values, functions = eigh(laplacian, np.diag(mass), subset_by_index=[0, num])
    values, functions = values[1:], functions[:, 1:]
    extension = _weights(to_samples.T)
    extended = (extension @ functions) / extension.sum(axis=1, keepdims=True)
    vertex_mass = areas / areas.sum()
    extended = _orthonormal(extended - vertex_mass @ extended, vertex_mass)
    scale = 4.0 * np.pi * num / max(float(values[-1]), 1e-300)
    return Spectrum(read_only(values * scale), read_only(extended), read_only(vertex_mass), "graph")


def _weights(distances: FloatArray) -> FloatArray:
    """Return Gaussian weights of each row's nearest entries, zero elsewhere; shape of the distances."""
    num = min(NUM_NEIGHBOURS + 1, distances.shape[1])
    nearest = np.argpartition(distances, num - 1, axis=1)[:, :num]
    rows = np.arange(len(distances))[:, None]
    close = distances[rows, nearest]
    kept = np.exp(-((close - close.min(axis=1, keepdims=True)) ** 2) / GAUSSIAN_WIDTH**2)
    weights = np.zeros(distances.shape)
    weights[rows, nearest] = kept
    return weights


def _orthonormal(functions: FloatArray, mass: FloatArray) -> FloatArray:
    """Orthonormalise columns in the mass, in order, keeping their signs (Cholesky of the Gram matrix)."""
    gram = functions.T @ (mass[:, None] * functions)
    factor = np.linalg.cholesky(gram)
    return np.ascontiguousarray(np.linalg.solve(factor, functions.T).T)
