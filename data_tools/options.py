"""How shapes are cleaned, sampled and embedded: every option, its default and why."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal, TypedDict

import numpy as np
from cyclopts import Parameter

from data_tools.checks import check_count, check_kinds, check_number
from data_tools.errors import OptionsError

#: How distances between samples are measured.
Metric = Literal["auto", "geodesic", "euclidean"]
Components = Literal["auto", "largest", "all"]
#: What becomes of surface that cannot be seen from outside.
Inner = Literal["auto", "keep", "drop"]
#: What one unit of length is after preprocessing.
Normalisation = Literal["centroid", "area", "none"]
#: Which evidence is matched.
EmbeddingKind = Literal["xyz", "xyz+lb", "xyz+invariants", "all"]
#: Numbers that say what a piece of a mesh looks like.
NUM_QUANTILES = 16
#: Fewer points than this do not determine a pose.
MIN_POINTS = 4


@dataclass(frozen=True, kw_only=True)
class CleaningOptions:
    """How a file is read, and what is repaired then; every change is noted in ``Shape.notes``.

    Parameters
    ----------
    merge_vertices : bool
        Merge vertices at exactly the same place (STL files repeat each vertex in every triangle).
    components : {"auto", "largest", "all"}
        largest keeps only the connected part of the largest area, with those within 20 % of it, and without the few
        vertices far from all others; fragments otherwise attract samples, and outliers change poses. all keeps
        everything, as objects need that are assembled of parts, and matches the surface around all of them. auto
        keeps the largest, but of a shape that loses more than a twentieth of its area so all of them. A collection
        takes those by which the pairs of a shape tell poses apart better.
    columns : str
        Names of the columns of text tables, in their order and separated by commas, among them x, y and z:
        class,x,y,z. Further columns need no name. It is needed where a table has no heading and columns that are not
        those of a documented format.
    inner : {"auto", "keep", "drop"}
        Surface that cannot be seen from outside: sealed cavities, inner walls behind an opening, struts within. auto
        leaves it out of all shapes where some have a tenth or more of it and others have none, as of scans of bones
        beside computed tomographies.
    like : tuple of float
        What the object looks like, where some files hold larger pieces: 16 quantiles of the distances of its surface
        from its centroid, in root mean square radii. A run finds them in the pieces that files share.
    """

    merge_vertices: bool = True
    components: Components = "auto"
    columns: Annotated[str, Parameter(alias="--columns")] = ""
    inner: Inner = "auto"
    like: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_kinds(self)
        if not isinstance(self.columns, str):
            raise OptionsError(f"columns: expected text, got {self.columns!r}")
        named = [word.strip().lower() for word in self.columns.split(",")]
        if self.columns and any(named.count(axis) != 1 for axis in "xyz"):
            raise OptionsError(
                f"columns: expected names separated by commas, with x, y and z once each, such as class,x,y,z; got "
                f"{self.columns!r}"
            )
        object.__setattr__(self, "like", tuple(self.like))
        if len(self.like) not in (0, NUM_QUANTILES) or not np.isfinite(self.like).all():
            raise OptionsError(
                f"like: expected {NUM_QUANTILES} numbers, or none, got {len(self.like)}"
            )

    @property
    def as_stored(self) -> CleaningOptions:
        """Options under which files are read as stored: vertex indices are those of the file."""
        return replace(self, merge_vertices=False, components="all", inner="keep")

    @property
    def again(self) -> CleaningOptions:
        """Options that give the same surface without its notes: walls inside that stay are not looked for."""
        return replace(self, inner="keep") if self.inner == "auto" else self


class CleaningKeywords(TypedDict, total=False):
    """The fields of :class:`CleaningOptions` as keywords."""

    merge_vertices: bool
    components: Components
    columns: str
    inner: Inner
    like: tuple[float, ...]


#: Files are read as stored: vertex indices are those of the file.
AS_STORED = CleaningOptions().as_stored


@dataclass(frozen=True, kw_only=True)
class SamplingOptions:
    """Which points represent a shape.

    Parameters
    ----------
    num_points : int
        Samples per shape, matched exactly. 20 are quick, 64 are right more often. Point sets that all have fewer
        points are matched at as many as the largest has. A shape of fewer points than the others has some of them
        again.
    metric : {"auto", "geodesic", "euclidean"}
        Distance of farthest point sampling; "auto" is geodesic on closed surfaces (reaches the tips of limbs) and
        Euclidean on open surfaces and point clouds (geodesic samples crowd at their boundary).
    num_dense_points : int
        Samples for the final refinement (Euclidean farthest points); 0 leaves it out.
    normalisation : {"centroid", "area", "none"}
        Unit of length: the centroid size of the samples, the square root of the surface area, or the file's own.
    max_faces : int
        Larger meshes are decimated to this many triangles for preprocessing; samples stay vertices of the original.
        Poses at 4000 are as right as at 40 000 on teeth, skulls and six classes of SHREC07.
    """

    num_points: int = 64
    metric: Metric = "auto"
    num_dense_points: int = 400
    normalisation: Normalisation = "centroid"
    max_faces: int = 4_000

    def __post_init__(self) -> None:
        check_kinds(self)
        check_count("num_points", self.num_points, lower=MIN_POINTS)
        check_count("num_dense_points", self.num_dense_points, lower=0)
        check_count("max_faces", self.max_faces, lower=1000)


class SamplingKeywords(TypedDict, total=False):
    """The fields of :class:`SamplingOptions` as keywords."""

    num_points: int
    metric: Metric
    num_dense_points: int
    normalisation: Normalisation
    max_faces: int


@dataclass(frozen=True, kw_only=True)
class EmbeddingOptions:
    """Which coordinates each sample has in addition to its position.

    A weight is the squared norm of a block over all samples, relative to that of the positions. So 1 says that an
    entirely wrong match costs as much by this block as by its position.

    One rule serves all data: columns are standardised over the samples of each shape, a column without information
    (the distance to a boundary that does not exist) is zero, and blocks of invariants weigh a fifth on closed
    surfaces. Descriptors of open surfaces depend on where the surface was cut, and those of point clouds on noise, so
    there they weigh a quarter of that. Where surfaces were cut at random places even that misleads: choose positions.

    Parameters
    ----------
    kind : {"xyz", "xyz+lb", "xyz+invariants", "all"}
        xyz: positions; lb: Laplace-Beltrami eigenfunctions, rotated among themselves; invariants: descriptors that no
        rotation changes; all: the three together.
    num_eigenfunctions : int
        Size of the Laplace-Beltrami block (the paper's 7-dimensional embedding has 4).
    hks_weight : float
        Weight of the log heat kernel signature at times .003, .01, .03, .1 of the surface scaled to unit area.
    agd_weight : float
        Weight of the average geodesic distance.
    """

    kind: EmbeddingKind = "xyz+invariants"
    num_eigenfunctions: int = 4
    hks_weight: float = 0.2
    agd_weight: float = 0.2

    def __post_init__(self) -> None:
        check_kinds(self)
        check_count("num_eigenfunctions", self.num_eigenfunctions, lower=1)
        for name in ("hks_weight", "agd_weight"):
            check_number(name, getattr(self, name))

    @property
    def has_eigenfunctions(self) -> bool:
        """Whether the Laplace-Beltrami block is asked for."""
        return self.kind in ("xyz+lb", "all")

    @property
    def has_invariants(self) -> bool:
        """Whether invariants are asked for."""
        return self.kind in ("xyz+invariants", "all")


class EmbeddingKeywords(TypedDict, total=False):
    """The fields of :class:`EmbeddingOptions` as keywords."""

    kind: EmbeddingKind
    num_eigenfunctions: int
    hks_weight: float
    agd_weight: float
