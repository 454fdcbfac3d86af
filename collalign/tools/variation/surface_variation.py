"""How surfaces vary: the mean surface and its modes, how well it lies on the shapes, and its symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.analysis.procrustes import (
    PrincipalComponents,
    centroid_sizes,
    generalized_procrustes,
    principal_components,
)
from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED
from collalign.analysis.symmetry import ObjectSymmetry, object_symmetry
from collalign.output.collection import Collection
from collalign.tools.correspond import DenseCorrespondence
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only, rms_length
from data_tools.io.shapes import read_shape
from data_tools.notes import Note
from data_tools.poses import moved_by
from data_tools.surface.closest import SurfaceLocator, SurfacePoints
from data_tools.surface.shape import vertex_normals
from data_tools.threads import one_blas_thread

QUALITY_HEADING = (
    *("rank", "name", "percent_of_radius"),
    *(
        f"{way}_{what}"
        for way in ("specimen_to_mean", "mean_to_specimen")
        for what in ("median", "p95", "p99")
    ),
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
        shape = read_shape(
            collection.file(at), collection.cleaning_of(at), name=collection.names[at]
        )
        points = moved_by(
            collection.transforms[at], shape.vertices[:: -(-len(shape.vertices) // max_points)]
        )
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


#: Components that are shown and written.
NUM_COMPONENTS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceVariation:
    """Surfaces of one triangulation, superimposed. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
    faces : ndarray of int, shape (f, 3)
    mean : ndarray, shape (v, 3)
        Lengths are in the root mean square radius of a shape.
    shapes : ndarray, shape (N, v, 3)
        Of unit size, rotated and shifted to fit the mean best.
    centroid_sizes : ndarray, shape (N,)
        Square root of the summed squared distances of all vertices from their centroid, in the unit of the vertices
        given.
    components : PrincipalComponents
        Of the shapes.
    quality : SurfaceQuality or None
        How well each specimen is represented; None where only surfaces in correspondence were given.
    notes : tuple of Note
        What a reader must know of who counts and what was tested.
    """

    names: tuple[str, ...]
    faces: IntArray
    mean: FloatArray
    shapes: FloatArray
    centroid_sizes: FloatArray
    components: PrincipalComponents
    quality: SurfaceQuality | None = None
    notes: tuple[Note, ...] = ()


@one_blas_thread()
def surface_variation(
    names: Sequence[str], faces: IntArray, vertices: FloatArray
) -> SurfaceVariation:
    """Superimpose surfaces and find their principal components.

    Parameters
    ----------
    names : sequence of str, length N
    faces : ndarray of int, shape (f, 3)
    vertices : ndarray, shape (N, v, 3)
        At least two surfaces, complete: row ``b`` of each is the same place.

    Raises
    ------
    InputError
        If there are fewer than two surfaces, or vertices are missing.
    """
    shapes = float(np.sqrt(vertices.shape[1])) * generalized_procrustes(vertices)
    components = principal_components(shapes)
    return SurfaceVariation(
        names=tuple(names),
        faces=faces,
        mean=components.mean,
        shapes=read_only(shapes),
        centroid_sizes=read_only(centroid_sizes(vertices)),
        components=components,
    )


def signed_offsets(surface: FloatArray, faces: IntArray, other: FloatArray) -> FloatArray:
    """Return how far another surface lies outside of one at every vertex, negative inside, shape (v,).

    Parameters
    ----------
    surface, other : ndarray, shape (v, 3)
        In correspondence.
    faces : ndarray of int, shape (f, 3)
        Oriented so that normals point outwards; without faces, distances are returned.
    """
    moved = other - surface
    if not len(faces):
        return np.asarray(np.linalg.norm(moved, axis=1))
    return np.asarray((moved * vertex_normals(surface, faces)).sum(axis=1))


def group_means(shapes: FloatArray, labels: Sequence[str]) -> dict[str, FloatArray]:
    """Return the mean surface of every label that is not empty, in alphabetical order, each (v, 3)."""
    kinds = sorted(set(labels) - {""})
    return {kind: shapes[[label == kind for label in labels]].mean(axis=0) for kind in kinds}


def mirror_error(mean: FloatArray, counterparts: SurfacePoints) -> float:
    """Return how far the counterpart of a counterpart is from where it should be, root mean square over vertices.

    Every specimen has this error at the same places, so it looks like directional asymmetry.

    Parameters
    ----------
    mean : ndarray, shape (v, 3)
        Lengths in root mean square radii.
    counterparts : SurfacePoints
        Of every vertex.
    """
    back = counterparts.on(counterparts.on(mean))
    return rms_length(back - mean)


def shared_error_notes(found: ObjectSymmetry, error: float) -> tuple[Note, ...]:
    """Return the warning that the directional asymmetry may be an error of registration; none where it is larger."""
    directional = rms_length(found.directional)
    if directional > error:
        return ()
    return (Note("asymmetry-uncertain", values={"directional": directional, "error": error}),)


@one_blas_thread()
def surface_symmetry(
    vertices: FloatArray,
    counterparts: SurfacePoints,
    *,
    mirrored: BoolArray | None = None,
    individuals: Sequence[str] | None = None,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> ObjectSymmetry:
    """Split surfaces into symmetric and asymmetric components, lengths in root mean square radii.

    Every vertex and its counterpart are a pair, so that the pairing is exact whatever the triangulation is.

    Parameters
    ----------
    vertices : ndarray, shape (N, v, 3)
    counterparts : SurfacePoints
        Of every vertex, on the triangulation; see :func:`collalign.tools.variation.mirror.mirror_map`.
    mirrored : ndarray of bool, shape (N,), optional
        Surfaces that were mirrored to fit the others: their sides are exchanged back.
    individuals : sequence of str, length N, optional
        Whom each surface belongs to, where some are replicates.
    permutations, seed : int
        As in :func:`collalign.analysis.symmetry.object_symmetry`.

    Raises
    ------
    InputError
        As :func:`collalign.analysis.symmetry.object_symmetry`.
    """
    num = vertices.shape[1]
    partner = np.concatenate([np.arange(num, 2 * num), np.arange(num)])
    both = np.concatenate([vertices, np.stack([counterparts.on(one) for one in vertices])], axis=1)
    if mirrored is not None:
        both[mirrored] = both[mirrored][:, partner] * np.array([-1.0, 1.0, 1.0])
    found = object_symmetry(
        both, partner, individuals=individuals, permutations=permutations, seed=seed
    )
    unit = float(np.sqrt(2 * num))
    return replace(
        found,
        mean=read_only(unit * found.mean[:num]),
        symmetric=read_only(unit * found.symmetric[:, :num]),
        asymmetric=read_only(unit * found.asymmetric[:, :num]),
        directional=read_only(unit * found.directional[:num]),
    )
