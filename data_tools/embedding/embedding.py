"""From a shape, or its file, to what is matched: samples, normalised positions, spectral coordinates, invariants."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy

from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.embedding.chirality import NO_CHIRALITY, SurfaceChirality, surface_chirality
from data_tools.embedding.copies import shape_signature
from data_tools.embedding.invariants import (
    HKS_TIMES,
    NUM_SPECTRUM,
    heat_kernel_signature,
    standardised,
)
from data_tools.embedding.sampling import OwnPoints, check_determines_pose, farthest_points
from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.local_surface import LocalSurface
from data_tools.notes import Note
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions
from data_tools.surface.extra import ExtraSurface, without_extra
from data_tools.surface.laplacian import Spectrum
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Weight of the eigenfunctions divided by the square roots of their eigenvalues; .1 to .3 work, 3 hurts.
LB_WEIGHT = 0.3
#: Weight of the distance to the boundary; closed surfaces have none.
BOUNDARY_WEIGHT = 0.2
#: Factor of the invariants' weights on open surfaces and point clouds, chosen on teeth.
OPEN_FACTOR = 0.25
#: Distance of the points whose neighbourhoods are described, in root mean square radii.
CELL = 0.12


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A preprocessed shape: all that matching needs. Arrays are read-only.

    Attributes
    ----------
    name : str
        Of the shape.
    vertex_indices : ndarray of int, shape (k,)
        The samples, as vertices of the shape, in the order of farthest point sampling. Not always distinct: the
        nearest vertices where components were joined, or a mesh has few; points of a cloud that has few come again.
    positions : ndarray, shape (k, 3)
        ``(vertices[vertex_indices] - offset) / scale``; their mean is 0. Where components were joined, or a
        mesh has few vertices, they lie on triangles, between these vertices.
    coordinates : ndarray, shape (k, d)
        The positions, then the weighted Laplace-Beltrami block if there is one.
    block_sizes : tuple of int
        (3,) or (3, m): the diagonal blocks of R.
    invariants : ndarray, shape (k, m)
        Weighted; m may be 0. Their squared distance is what a match costs in addition to its position.
    offset : ndarray, shape (3,)
        Centroid of the samples, in units of the shape.
    scale : float
        Units of the shape per unit of ``positions``.
    dense_indices : ndarray of int, shape (l,)
        More samples, for refinement; l may be 0.
    dense_positions : ndarray, shape (l, 3)
        With the same offset and scale.
    dense_normals : ndarray, shape (l, 3) or (0, 3)
        Outward unit normals there; empty where the shape has no oriented surface.
    signature : ndarray, shape (18,)
        See :func:`data_tools.embedding.copies.shape_signature`.
    rim : str
        ``open`` or ``closed``, as surfaces are (small holes do not count), or ``unknown``, of point clouds.
    local : LocalSurface or None
        Points one cell apart with descriptors of their neighbourhoods, about the centroid of the surface and in its
        root mean square radii; None where there are too few, and of tables.
    notes : tuple of Note
        What a user should know: decimated, which operators.
    chirality : SurfaceChirality or None
        Which way the surface turns, where that was asked for.
    """

    name: str
    vertex_indices: Annotated[IntArray, Holds(shape="k")]
    positions: Annotated[FloatArray, Holds(shape="k 3")]
    coordinates: Annotated[FloatArray, Holds(shape="k d")]
    block_sizes: tuple[int, ...]
    invariants: Annotated[FloatArray, Holds(shape="k m")]
    offset: Annotated[FloatArray, Holds(shape="3")]
    scale: Annotated[float, Holds(positive=True)]
    dense_indices: Annotated[IntArray, Holds(shape="l")]
    dense_positions: Annotated[FloatArray, Holds(shape="l 3")]
    dense_normals: Annotated[FloatArray, Holds(shape="l? 3")]
    signature: Annotated[FloatArray, Holds(shape="18")]
    rim: str
    local: LocalSurface | None = None
    notes: tuple[Note, ...] = ()
    chirality: SurfaceChirality | None = None

    def __post_init__(self) -> None:
        blocks, dim = self.block_sizes, self.coordinates.shape[1]
        if blocks[:1] != (3,) or len(blocks) > 2 or min(blocks) < 1 or sum(blocks) != dim:
            raise InputError(
                f"block_sizes: expected (3,) or (3, m) of {dim} coordinates, got {blocks}"
            )

    @property
    def num_places(self) -> int:
        """Samples that lie apart: all of a mesh; a cloud of few points has some of them again."""
        return len(np.unique(self.vertex_indices)) if self.rim == "unknown" else len(self.positions)

    @property
    def is_table(self) -> bool:
        """Whether the shape is a cloud of too few points for a surface, such as a table of landmarks."""
        return self.rim == "unknown" and self.local is None

    @property
    def may_be_cut(self) -> bool:
        """Whether part of a surface may be missing: it is open, or a cloud of points that has a border somewhere."""
        return self.rim != "closed" and not self.is_table

    @property
    def is_poor(self) -> bool:
        """Whether the shape has less than half as many points as it is matched at: its pairs say little of others."""
        return 2 * self.num_places < len(self.positions)


@one_blas_thread()
def sample_shape(
    shape: Shape,
    sampling: SamplingOptions | None = None,
    embedding: EmbeddingOptions | None = None,
    *,
    surface: WorkingSurface | None = None,
    own: OwnPoints | None = None,
) -> Samples:
    """Choose samples on a shape, normalise them and compute their coordinates.

    Compare shapes sampled with the same options only: the unit of length depends on the number of samples.

    Parameters
    ----------
    shape : Shape
    sampling : SamplingOptions, optional
    embedding : EmbeddingOptions, optional
    surface : WorkingSurface, optional
        Of this shape and of sampling options with the same limits of size, if there is one already: it keeps what
        several samplings share.
    own : OwnPoints, optional
        Samples and invariants that are given, by the vertices of this shape.

    Returns
    -------
    Samples

    Raises
    ------
    InputError
        If the shape has fewer points than determine a pose, or no extent, or a surface too poor for the embedding.
    """
    sampling = SamplingOptions() if sampling is None else sampling
    embedding = EmbeddingOptions() if embedding is None else embedding
    check_determines_pose(shape)
    surface = WorkingSurface(shape, sampling, split=True) if surface is None else surface
    if own is None or own.samples is None:
        chosen = _choose_samples(surface, sampling)
        indices = _distinct(surface, chosen, shape)
        points = surface.places(chosen) if surface.lies_between else shape.vertices[indices]
    else:
        indices = own.samples
        points = shape.vertices[indices]
        chosen = scipy.spatial.cKDTree(surface.shape.vertices).query(points)[1]
    offset = points.mean(axis=0)
    scale = _unit_of_length(points - offset, surface, sampling)
    positions = (points - offset) / scale
    size = float(np.linalg.norm(positions))
    eigen = _spectrum(surface, embedding)
    coordinates, block_sizes = _coordinates(positions, size, eigen, chosen, embedding)
    if own is None or own.invariants is None:
        descriptors = _descriptors(surface, eigen, embedding)
    else:
        descriptors = [(own.weight, own.invariants[surface.to_original])]
    dense_indices, dense_points, dense_normals = _dense(surface, shape, sampling)
    return Samples(
        name=shape.name,
        vertex_indices=read_only(indices),
        positions=read_only(positions),
        coordinates=read_only(coordinates),
        block_sizes=block_sizes,
        invariants=read_only(_invariants(descriptors, chosen, positions)),
        offset=read_only(offset),
        scale=scale,
        dense_indices=read_only(dense_indices),
        dense_positions=read_only((dense_points - offset) / scale),
        dense_normals=read_only(dense_normals),
        signature=shape_signature(shape),
        rim=surface.rim,
        local=_local_surface(surface.shape if shape.is_mesh else shape),
        notes=shape.notes + surface.notes,
    )


def _local_surface(shape: Shape) -> LocalSurface | None:
    """Return the surface one cell apart about its centroid, in root mean square radii."""
    centre, radius = centre_and_radius(shape)
    found = surface_cells(shape, CELL * radius) if radius > 0 else None
    if found is None:
        return None
    return replace(found, points=read_only((found.points - centre) / radius), cell=CELL)


def _choose_samples(surface: WorkingSurface, options: SamplingOptions) -> IntArray:
    """Return the samples as vertices of the working surface; over several components they are spread by area.

    A cloud of few points has some of them again, the first ones first.
    """
    metric = options.metric
    if metric == "auto":
        metric = "geodesic" if surface.rim == "closed" and surface.is_connected else "euclidean"
    num, points = options.num_points, surface.shape.vertices
    if not surface.shape.is_mesh and len(points) < num:
        return np.resize(surface.farthest_points(len(points), metric, seeded=True), num)
    return surface.farthest_points(num, metric, seeded=True)


def _distinct(surface: WorkingSurface, chosen: IntArray, shape: Shape) -> IntArray:
    """Return the vertex nearest to each sample; where two share one, as across a thin wall, the nearest free one.

    Samples between vertices may share one, as may those of a cloud that has fewer points.
    """
    indices = surface.to_original[chosen]
    if surface.lies_between or len(chosen) > len(surface.shape.vertices):
        return indices
    again = np.setdiff1d(np.arange(len(chosen)), np.unique(indices, return_index=True)[1])
    if len(again):
        known = np.unique(surface.to_original)
        _, near = scipy.spatial.cKDTree(shape.vertices[known]).query(
            surface.shape.vertices[chosen[again]], k=len(chosen)
        )
        for at, options in zip(again, near, strict=True):
            free = np.setdiff1d(
                options[options < len(known)], np.searchsorted(known, indices), assume_unique=True
            )
            if not len(free):
                raise InputError(
                    f"{shape.file or shape.name}: too few distinct vertices for {len(chosen)} samples"
                )
            indices[at] = known[free[0]]
    return indices


def _unit_of_length(
    centred: FloatArray, surface: WorkingSurface, options: SamplingOptions
) -> float:
    size = float(np.linalg.norm(centred))
    if not size > 0:
        raise InputError(
            f"{surface.shape.file or surface.shape.name}: all samples lie in one point"
        )
    if options.normalisation == "centroid":
        return size
    return surface.area**0.5 if options.normalisation == "area" else 1.0


def _spectrum(surface: WorkingSurface, options: EmbeddingOptions) -> Spectrum | None:
    needs_signatures = (
        options.has_invariants and options.hks_weight > 0 and surface.has_enough_points
    )
    num = max(
        NUM_SPECTRUM if needs_signatures else 0,
        options.num_eigenfunctions if options.has_eigenfunctions else 0,
    )
    if options.has_eigenfunctions and options.num_eigenfunctions > len(surface.shape.vertices) - 2:
        raise InputError(
            f"{surface.shape.name}: too few vertices for {options.num_eigenfunctions} eigenfunctions"
        )
    return surface.eigenfunctions(num) if num else None


def _coordinates(
    positions: FloatArray,
    size: float,
    eigen: Spectrum | None,
    chosen: IntArray,
    options: EmbeddingOptions,
) -> tuple[FloatArray, tuple[int, ...]]:
    """Return positions and weighted eigenfunctions / sqrt(lambda) (Rustamov 2007), with the block sizes."""
    if eigen is None or not options.has_eigenfunctions:
        return positions.copy(), (3,)
    num = options.num_eigenfunctions
    block = eigen.functions[chosen, :num] / np.sqrt(np.maximum(eigen.values[:num], 1e-6))
    block *= size * LB_WEIGHT**0.5 / np.linalg.norm(block)
    return np.ascontiguousarray(np.hstack([positions, block])), (3, num)


def _descriptors(
    surface: WorkingSurface, eigen: Spectrum | None, options: EmbeddingOptions
) -> list[tuple[float, FloatArray]]:
    """Return weights and values on the working surface, shapes (w, m), of the invariants that are asked for.

    Signatures of a cloud of too few points for a surface are zero: they tell none of its points from another.
    """
    found: list[tuple[float, FloatArray]] = []
    if not options.has_invariants:
        return found
    if options.hks_weight > 0:
        if eigen is None:
            signatures = np.zeros((len(surface.shape.vertices), len(HKS_TIMES)))
        else:
            signatures = heat_kernel_signature(eigen)
        found.append((options.hks_weight, signatures))
    if options.agd_weight > 0:
        found.append((options.agd_weight, surface.agd[:, None]))
    found.append((BOUNDARY_WEIGHT, surface.boundary_distance[:, None]))
    factor = 1.0 if surface.rim == "closed" else OPEN_FACTOR
    return [(factor * weight, values) for weight, values in found]


def _invariants(
    descriptors: list[tuple[float, FloatArray]], chosen: IntArray, positions: FloatArray
) -> FloatArray:
    """Return the invariants at the chosen vertices, weighted relative to their positions, shape (k, m)."""
    if not len(chosen):
        return np.empty((0, sum(values.shape[1] for _, values in descriptors)))
    size = np.linalg.norm(positions - positions.mean(axis=0))
    blocks = [size * weight**0.5 * standardised(values, chosen) for weight, values in descriptors]
    return np.ascontiguousarray(np.hstack([np.empty((len(chosen), 0)), *blocks]))


def _dense(
    surface: WorkingSurface, shape: Shape, options: SamplingOptions
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the dense samples, no two at the same place of the shape.

    These are their nearest vertices (m,), their places (m, 3), and outward normals (m, 3), or (0, 3) where the shape
    has no sides.
    """
    num = min(options.num_dense_points, len(surface.shape.vertices))
    if surface.is_joined:
        return _dense_of_joined(surface, shape, num)
    chosen = np.empty(0, dtype=np.int64)
    if num:
        chosen = surface.farthest_points(num, "euclidean", seeded=False)
    if not surface.lies_between:
        first = np.unique(surface.to_original[chosen], return_index=True)[1]
        chosen = chosen[np.sort(first)]
    return surface.to_original[chosen], surface.places(chosen), surface.normals(chosen)


def _dense_of_joined(
    surface: WorkingSurface, shape: Shape, num: int
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return dense samples as :func:`_dense`, half of them vertices of the shape, if so many are not inside.

    Versions of one object have many vertices in common. Other points of the surfaces around them differ.
    """
    corners, beside = surface.corners(num // 2)
    every = np.arange(len(surface.shape.vertices))
    vertices = np.concatenate([corners, surface.to_original])
    places = np.concatenate([shape.vertices[corners], surface.places(every)])
    places, first = np.unique(places, axis=0, return_index=True)
    chosen = farthest_points(
        Shape.from_arrays(places, name=shape.name),
        min(num, len(places)),
        metric="euclidean",
        seeds=np.argsort(first)[: len(corners)],
    )
    at = np.concatenate([beside, every])[first[chosen]]
    return vertices[first[chosen]], places[chosen], surface.normals(at)


def sample_file(
    file: Origin,
    cleaning: CleaningOptions,
    sampling: SamplingOptions,
    embedding: EmbeddingOptions,
    *,
    name: str,
    digest: str | None = None,
    own: OwnPoints | None = None,
    extra: ExtraSurface | None = None,
    with_chirality: bool = False,
) -> Samples:
    """Read, clean, sample and embed one shape; ``vertex_indices`` count the vertices of the file.

    Parameters
    ----------
    file : Path or Source
    cleaning : CleaningOptions
    sampling : SamplingOptions
    embedding : EmbeddingOptions
    name : str
    digest : str, optional
        Of the content that is expected: a file that has changed since is refused.
    own : OwnPoints, optional
        What the caller gives of this shape.
    extra : ExtraSurface, optional
        Material that does not belong to the shape and is left out.
    with_chirality : bool
        Whether to find out which way the surface turns as well, which takes half as long as the rest.

    Raises
    ------
    InputError
        If the file cannot be read, has changed or holds no usable shape.
    """
    shape = read_shape(file, cleaning, name=name, digest=digest)
    if extra is not None:
        shape = without_extra(shape, extra, cleaning)
    surface = WorkingSurface(shape, sampling, joined=cleaning.components == "all", split=True)
    samples = sample_shape(
        shape,
        sampling,
        embedding,
        surface=surface,
        own=None if own is None else own.of_shape(shape),
    )
    return replace(
        samples,
        vertex_indices=read_only(shape.file_indices[samples.vertex_indices]),
        chirality=_chirality(shape, surface) if with_chirality else None,
    )


def _chirality(shape: Shape, surface: WorkingSurface) -> SurfaceChirality:
    """Return which way a surface turns; nothing of one that is too poor for eigenfunctions."""
    try:
        return surface_chirality(shape, None if surface.is_split else surface)
    except InputError:
        return NO_CHIRALITY
