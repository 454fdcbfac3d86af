"""A cheap descriptor of a preprocessed shape that no rotation, reflection or order of the samples changes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist

from collalign.products.shapes import Shapes
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples

_LEVELS = (np.arange(16) + 0.5) / 16
_INVARIANT_LEVELS = np.array([0.1, 0.3, 0.5, 0.7, 0.9])


def shape_descriptor(samples: Samples) -> FloatArray:
    """Describe a shape, so that similar shapes have similar descriptors (Euclidean distance).

    Quantiles of the samples' distances from the centroid, quantiles of the distances between samples (the D2 shape
    distribution of Osada et al. 2002), extents along the principal axes, and quantiles of the samples' invariants,
    all relative to the size of the shape.

    Parameters
    ----------
    samples : Samples
        Shapes are comparable if they were sampled with the same options.

    Returns
    -------
    ndarray, shape (35 + 5 m,)
        m is the number of invariants. It depends on this shape alone, so adding shapes changes no descriptor.
    """
    size = float(np.linalg.norm(samples.positions)) or 1.0
    points = samples.positions * (len(samples.positions) ** 0.5 / size)
    radii = np.quantile(np.linalg.norm(points, axis=1), _LEVELS)
    distances = np.quantile(pdist(points), _LEVELS) if len(points) > 1 else np.zeros(len(_LEVELS))
    extents = np.linalg.svd(points, compute_uv=False) / len(points) ** 0.5
    parts = [radii / 4.0, distances / 4.0, np.pad(extents, (0, 3 - len(extents)))]
    if samples.invariants.shape[1]:
        scaled = samples.invariants * (len(points) ** 0.5 / size)
        parts.append(
            np.quantile(scaled, _INVARIANT_LEVELS, axis=0).ravel() / scaled.shape[1] ** 0.5
        )
    return np.concatenate(parts)


def describe_shapes(shapes: Shapes) -> FloatArray:
    """Return a descriptor of each shape, shape (N, m): similar shapes have similar ones, mirror images the same."""
    return np.stack([shape_descriptor(item) for item in shapes.samples])
