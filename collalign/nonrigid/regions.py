"""Regions of a whole surface that a cut one may be, and maps of them as maps of the whole.

**Why.**
The eigenfunctions of half a body and of a whole one differ too much for a map to start from them. Those of the half
and of the right half of the whole do not. So regions of the whole are proposed, compared with the cut surface by what
needs no map, and the likeliest ones are matched as surfaces of their own.

**Which.**
A cut takes whole ends of limbs away: a region is what is left without everything near some of the tips. How near is
relative to the length of each limb, so that long and short ones end at the same place.

**How they are compared.**
By the eigenvalues at unit area, by how far points are from the rim, and by the length of the rim.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
import scipy

from collalign.nonrigid.functional_map import SMOOTHNESS, FunctionalMap, fitted_map
from collalign.nonrigid.map_options import TUNED, SurfaceOptions
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from collalign.nonrigid.tips import edge_net
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.surface.cleaning import clean, decimate
from data_tools.surface.laplacian import spectrum, surface_operators
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges, mesh_components, vertex_components

#: A surface is cut if one of its boundaries is longer than this, in units of sqrt(area): that of a forearm is .16.
CUT_RIM = 0.1
#: How near to a tip a surface is taken away, in parts of the distance from that tip to the middle of the surface.
DEPTHS = (0.3, 0.45, 0.6, 0.75, 0.9, 1.05)
#: A region is at least this share of the whole's area.
LEAST_SHARE = 0.15
#: Triangles of the copies on which regions are compared with the cut surface, and eigenvalues that are.
NUM_FACES, NUM_VALUES = 2500, 20
#: Shares of the area at which distances to the rim are compared.
RIM_SHARES = np.linspace(0.025, 0.975, 20)
#: Weight of the logarithm of the length of rims, relative to the root mean square of logarithms of eigenvalues and to
#: distances to the rim in units of sqrt(area).
LENGTH_WEIGHT = 0.1
#: Regions that share this much of what both cover are compared once; of those that share so much one is matched.
EQUAL_SHARE, SAME_SHARE = 0.97, 0.8
#: Regions that are compared at few samples, and their triangles there.
NUM_REGIONS, MAX_FACES = 8, 6000


@dataclass(frozen=True, kw_only=True, eq=False)
class Region:
    """A region of a surface.

    Attributes
    ----------
    surface : SpectralShape
        The region as a surface of its own.
    at : ndarray of int, shape (w,)
        The working vertex of the whole for each working vertex of the region.
    """

    surface: SpectralShape
    at: IntArray

    def on_whole(
        self, found: FunctionalMap, whole: SpectralShape, other: SpectralShape, *, is_target: bool
    ) -> FunctionalMap:
        """Return a map between the region and another surface as a map of the whole's dense samples.

        Samples of the whole outside the region go where the nearest ones of the region do.

        Parameters
        ----------
        found : FunctionalMap
        whole, other : SpectralShape
        is_target : bool
            Whether the region is the target.
        """
        own = self.surface
        of_other, of_own = found.map_target_source, found.map_source_target
        if not is_target:
            of_other, of_own = of_own, of_other
        images = whole.nearest_dense[self.at[own.dense]][of_other]
        nearest = scipy.spatial.cKDTree(own.vertices[own.dense]).query(whole.vertices[whole.dense])[
            1
        ]
        back = of_own[nearest]
        unknown = np.full(len(back), -1)
        carried = fitted_map(
            whole.basis[whole.dense], other.basis[other.dense], images, unknown, SMOOTHNESS
        )
        return FunctionalMap(
            C_source_target=carried if is_target else carried.T,
            map_target_source=images if is_target else back,
            map_source_target=back if is_target else images,
        )


def is_cut(spectral: SpectralShape) -> bool:
    """Return whether one of a surface's boundaries is longer than that of a small hole."""
    return bool(
        _loops(spectral.vertices, spectral.faces).max(initial=0.0) > CUT_RIM * spectral.area**0.5
    )


def _loops(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the lengths of a mesh's boundaries."""
    edges = boundary_edges(faces)
    if not len(edges):
        return np.empty(0)
    lengths = np.linalg.norm(np.subtract(*vertices[edges.T]), axis=1)
    used, ends = np.unique(edges, return_inverse=True)
    _, loop = vertex_components(len(used), [ends.reshape(-1, 2)])
    return np.asarray(np.bincount(loop[ends.reshape(-1, 2)[:, 0]], lengths), dtype=np.float64)


def likely_regions(whole: SpectralShape, cut: SpectralShape) -> list[BoolArray]:
    """Return regions of a surface that another one, which is cut, may be, as working vertices (w,); likeliest first.

    A surface without ends of limbs, such as a point cloud, has none.
    """
    if not len(whole.tips.vertices):
        return []
    small = _small(whole)
    try:
        own = _Signature.of(*_small(cut))
    except InputError:  # what a cut leaves may be too poor a surface
        return []
    copied = scipy.spatial.cKDTree(whole.vertices / whole.area**0.5).query(small[0])[1]
    covered: list[BoolArray] = []
    gaps: list[float] = []
    chosen: list[BoolArray] = []
    for kept in _proposed(whole):
        used, faces = _largest_piece(small[1], kept[copied])
        if len(used) < 2 * NUM_VALUES or len(faces) == len(small[1]):
            continue
        inside = np.zeros(len(copied), dtype=bool)
        inside[used] = True
        if any(_common_share(inside, other) > EQUAL_SHARE for other in covered):
            continue
        try:
            gaps.append(own.gap(_Signature.of(small[0][used], faces)))
        except InputError:
            continue
        covered.append(inside)
        chosen.append(kept)
    distinct: list[int] = []
    for number in np.argsort(gaps, kind="stable").tolist():
        if all(_common_share(covered[number], covered[other]) <= SAME_SHARE for other in distinct):
            distinct.append(number)
    return [chosen[number] for number in distinct[:NUM_REGIONS]]


def _proposed(whole: SpectralShape) -> Iterator[BoolArray]:
    """Yield which working vertices, (w,), are left without what is near to each choice of tips."""
    distances = whole.tips.distances
    middle = whole.agd.argmin()
    for tips in chain.from_iterable(
        combinations(range(len(distances)), num) for num in range(1, len(distances) + 1)
    ):
        nearness = (distances[list(tips)] / distances[tips, middle][:, None]).min(axis=0)
        for depth in DEPTHS:
            kept = nearness > depth
            if whole.mass[kept].sum() >= LEAST_SHARE:
                yield kept


def _small(spectral: SpectralShape) -> tuple[FloatArray, IntArray]:
    """Return a surface of unit area with few triangles: vertices and faces."""
    vertices, faces = decimate(spectral.vertices, spectral.faces, NUM_FACES)
    shape = clean(Shape.from_arrays(vertices, faces))
    return shape.vertices / spectral.area**0.5, shape.faces


def _common_share(first: BoolArray, second: BoolArray) -> float:
    return float((first & second).sum() / (first | second).sum())


def _largest_piece(faces: IntArray, kept: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the vertices (m,) of the largest piece that is kept, and its faces among these."""
    faces = faces[kept[faces].all(axis=1)]
    used, corners = np.unique(faces, return_inverse=True)
    if not len(used):
        return used, faces
    corners = corners.reshape(-1, 3)
    _, piece = mesh_components(len(used), corners)
    largest = piece == np.bincount(piece).argmax()
    place = np.cumsum(largest) - 1
    return used[largest], place[corners[largest[corners[:, 0]]]]


def region_of(whole: SpectralShape, kept: BoolArray, options: SurfaceOptions) -> Region | None:
    """Return the largest piece of a region as a surface, None if no map can be made of that.

    Parameters
    ----------
    whole : SpectralShape
    kept : ndarray of bool, shape (w,)
        Working vertices of the whole.
    options : SurfaceOptions
        Of the region.
    """
    used, faces = _largest_piece(whole.faces, kept)
    if len(used) < 2 * options.num_functions:
        return None
    crop = Shape.from_arrays(whole.vertices[used], faces, name=whole.name)
    try:
        surface = prepare_surface(crop, options)
    except InputError:  # too few vertices, or too poor a surface
        return None
    return Region(surface=surface, at=used[surface.to_original])


def region_options(whole: SpectralShape, *, is_screened: bool) -> SurfaceOptions:
    """Return how regions of a surface are prepared: like itself, or with little for a first look."""
    num = len(whole.eigenvalues)
    if is_screened:
        num = min(num, TUNED.screen_last)
    dense = TUNED.num_screen_samples if is_screened else len(whole.dense)
    return SurfaceOptions(
        num_functions=num,
        num_samples=len(whole.samples),
        num_dense=max(dense, 2 * num),
        max_faces=MAX_FACES if is_screened else max(len(whole.faces), MAX_FACES),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Signature:
    """What tells cut surfaces apart without a map: logarithms of eigenvalues and of the rim's length, and depths."""

    values: FloatArray
    depths: FloatArray
    length: float

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray) -> _Signature:
        """Return that of a mesh with a rim."""
        operators = surface_operators(Shape.from_arrays(vertices, faces))
        size = float(operators.mass.sum()) ** 0.5
        rim = np.unique(boundary_edges(faces))
        depths = scipy.sparse.csgraph.dijkstra(
            edge_net(vertices / size, faces), directed=False, indices=rim, min_only=True
        )
        order = np.argsort(depths, kind="stable")
        shares = np.cumsum(operators.mass[order]) / size**2
        return cls(
            values=np.log(spectrum(operators, NUM_VALUES).values),
            depths=np.interp(RIM_SHARES, shares, depths[order]),
            length=float(np.log(_loops(vertices, faces).sum() / size)),
        )

    def gap(self, other: _Signature) -> float:
        """Return how much two surfaces differ."""
        return float(
            np.sqrt(((self.values - other.values) ** 2).mean())
            + np.abs(self.depths - other.depths).mean()
            + LENGTH_WEIGHT * abs(self.length - other.length)
        )
