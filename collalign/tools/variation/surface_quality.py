"""How well each specimen is represented: distances of its surface to the mean surface fitted to it, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.output.collection import Collection
from collalign.tools.correspond.result import DenseCorrespondence
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.io.shapes import read_shape
from data_tools.poses import moved_by
from data_tools.surface.closest import SurfaceLocator
from data_tools.threads import one_blas_thread

QUALITY_HEADING = (
    *("rank", "name", "percent_of_radius"),
    *(f"{way}_{what}" for way in ("specimen_to_mean", "mean_to_specimen") for what in ("median", "p95", "p99")),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceQuality:
    """How well each specimen is represented. Arrays are read-only; lengths are in the unit of each file.

    Attributes
    ----------
    names : tuple of str, length N
    to_mean, to_specimen : ndarray, shape (N, 3)
        Median, 95th and 99th percentile of the distances of a specimen's points to the mean surface fitted to it,
        and of the vertices of that to the specimen.
    radii : ndarray, shape (N,)
        Root mean square distance of each fitted surface from its centroid.
    distances : ndarray, shape (N, v)
        Of every vertex of the fitted surface to the specimen: where it does not fit.
    """

    names: tuple[str, ...]
    to_mean: FloatArray
    to_specimen: FloatArray
    radii: FloatArray
    distances: FloatArray

    @property
    def share(self) -> FloatArray:
        """The larger 95th percentile of both ways in radii, by which specimens are ranked, shape (N,)."""
        return np.asarray(np.maximum(self.to_mean[:, 1], self.to_specimen[:, 1]) / self.radii)

    @property
    def order(self) -> IntArray:
        """The specimens (N,), the worst represented first."""
        return np.argsort(-self.share, kind="stable")

    @property
    def rows(self) -> list[list[object]]:
        """The ranked table, below :data:`QUALITY_HEADING`."""
        table: list[list[object]] = []
        for rank, at in enumerate(self.order.tolist(), start=1):
            distances = [*self.to_mean[at].tolist(), *self.to_specimen[at].tolist()]
            table.append([rank, self.names[at], 100.0 * float(self.share[at]), *distances])
        return table


@one_blas_thread()
def surface_quality(
    collection: Collection, dense: DenseCorrespondence, *, max_points: int = 20_000
) -> SurfaceQuality:
    """Measure how far each specimen and the mean surface fitted to it are from each other.

    Parameters
    ----------
    collection : Collection
        Whose original files can be read.
    dense : DenseCorrespondence
        Of complete shapes.
    max_points : int
        Of a specimen whose distances are measured, evenly spaced in the order of its file.

    Raises
    ------
    InputError
        If a file is not there any more.
    """
    rows = [collection.index(name) for name in dense.names]
    scales = collection.scales[rows]
    to_mean, percentiles = [], (50.0, 95.0, 99.0)
    for at, fitted in zip(rows, dense.vertices, strict=True):
        shape = read_shape(collection.file(at), collection.options.cleaning, name=collection.names[at])
        points = moved_by(collection.transforms[at], shape.vertices[:: -(-len(shape.vertices) // max_points)])
        places = SurfaceLocator(fitted, dense.faces).closest(points).on(fitted)
        to_mean.append(np.percentile(np.linalg.norm(points - places, axis=1), percentiles))
    centred = dense.vertices - dense.vertices.mean(axis=1, keepdims=True)
    distances = dense.residual / scales[:, None]
    return SurfaceQuality(
        names=dense.names,
        to_mean=read_only(np.array(to_mean) / scales[:, None]),
        to_specimen=read_only(np.percentile(distances, percentiles, axis=1).T),
        radii=read_only(np.sqrt((centred**2).sum(axis=2).mean(axis=1)) / scales),
        distances=read_only(distances),
    )
