"""The tips of limbs: where the average geodesic distance has its local maxima."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.working_surface import WorkingSurface

#: Tips of a shape, at most.
NUM_TIPS = 10
#: Distance that stands for none, between tips of different components.
UNREACHABLE = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Tips:
    """Tips of a shape and distances from them along the surface, in units of sqrt(area).

    Attributes
    ----------
    between : ndarray, shape (t, t)
        Distances between tips, the most remote tip first.
    remoteness : ndarray, shape (t,)
        Logarithm of the average geodesic distance over its mean.
    distances : ndarray, shape (n, t)
        From the dense samples to each tip.
    """

    between: FloatArray
    remoteness: FloatArray
    distances: FloatArray

    def __len__(self) -> int:
        return len(self.remoteness)

    @classmethod
    def of(cls, surface: WorkingSurface, dense: IntArray) -> Tips:
        """Find the tips of a surface with these dense samples."""
        tips = surface.seeds(NUM_TIPS)
        distances = np.stack([surface.geodesics.from_vertex(int(tip)) for tip in tips], axis=1) / surface.area**0.5
        distances = np.where(np.isfinite(distances), distances, UNREACHABLE)
        return cls(
            between=read_only(distances[tips]),
            remoteness=read_only(np.log(surface.agd[tips] / surface.agd.mean())),
            distances=read_only(distances[dense]),
        )

    @classmethod
    def none(cls, num_dense: int) -> Tips:
        """Return no tips, for a surface of so many dense samples."""
        return cls(
            between=np.empty((0, 0)),
            remoteness=np.empty(0),
            distances=np.empty((num_dense, 0)),
        )

    def at_first(self, num_dense: int) -> Tips:
        """Return the tips with distances from the first dense samples alone."""
        return Tips(
            between=self.between,
            remoteness=self.remoteness,
            distances=self.distances[:num_dense],
        )
