"""What tells shapes apart before any two are matched: no rotation, size or reflection changes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from collalign.stages.choose_pairs import shape_descriptor
from data_tools.arrays import BoolArray, FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.local_surface import LocalSurface

#: Shells around the centroid, of equally many points, in which neighbourhoods are averaged.
NUM_SHELLS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class KindDescriptors:
    """Two descriptors of each shape.

    Attributes
    ----------
    shells : ndarray, shape (N, 99)
        Mean features of the neighbourhoods in each shell, of the surface and its mirror image.
    descriptors : ndarray, shape (N, m)
        See :func:`collalign.stages.choose_pairs.shape_descriptor`.
    """

    shells: FloatArray
    descriptors: FloatArray

    def distances(self) -> tuple[FloatArray, FloatArray]:
        """Return the distances of all pairs by each descriptor, both of shape (N, N)."""
        return scipy.spatial.distance.cdist(self.shells, self.shells), scipy.spatial.distance.cdist(
            self.descriptors, self.descriptors
        )


def are_described(samples: Sequence[Samples]) -> BoolArray:
    """Return of which shapes neighbourhoods are known, shape (N,); of sets of few points they are not."""
    return np.array([one.local is not None and not one.is_poor for one in samples], dtype=np.bool_)


def kind_descriptors(samples: Sequence[Samples]) -> KindDescriptors:
    """Describe shapes, whose neighbourhoods are known."""
    surfaces = [one.local for one in samples if one.local is not None]
    return KindDescriptors(
        shells=np.stack([shell_means(surface) for surface in surfaces]),
        descriptors=np.stack([shape_descriptor(one) for one in samples]),
    )


def shell_means(surface: LocalSurface) -> FloatArray:
    """Return the mean features of neighbourhoods in shells around the centroid, shape (33 * NUM_SHELLS,)."""
    features = 0.5 * (surface.features + surface.mirrored.features)
    order = np.argsort(np.linalg.norm(surface.points, axis=1), kind="stable")
    shells = np.array_split(order, NUM_SHELLS)
    means = [features[of].mean(axis=0, dtype=np.float64) for of in shells]
    return np.concatenate(means) / NUM_SHELLS**0.5
