"""What a result holds: poses, maps and evidence of every shape, and what its poses and files say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self, overload

import numpy as np
from numpy.typing import NDArray

from collalign.analysis.procrustes import centroid_sizes
from collalign.options import AlignOptions
from collalign.output.moved_files import find_files, is_there
from collalign.output.vertex_maps import VERTEX_MAPS_FILE, load_vertex_maps
from collalign.output.views import display_mesh, faces_per_shape
from collalign.products.consistent_maps import ConsistentMaps, VertexMaps, position_of
from collalign.products.kinds import Kind
from collalign.products.pair import AlignedPair, Alternative, Pairs
from collalign.products.run_record import Made, RunRecord
from collalign.products.shapes import Excluded, ExtraMaterial, Incomplete, PosedFile
from collalign.products.trust import DOUBT
from data_tools.arrays import BoolArray, FloatArray, Holds, IntArray, one_line
from data_tools.embedding.copies import Copies
from data_tools.errors import InputError, UnavailableError
from data_tools.io.files import composed, file_stems
from data_tools.io.listing import hash_shape, relative_path
from data_tools.io.shapes import read_shape
from data_tools.io.source import inputs_of
from data_tools.notes import Note
from data_tools.options import AS_STORED, CleaningOptions
from data_tools.poses import each_moved_by, scales_of
from data_tools.surface.shape import Shape

#: Fields of a result with an entry for each shape, in order.
PER_SHAPE = (
    *("names", "files", "digests", "transforms", "confidence", "samples", "positions"),
    *("landmarks", "alternatives", "part_numbers", "vertices", "faces", "places"),
)
#: The folder of a result in which the aligned shapes lie.
MESH_FOLDER = "meshes"


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedShape:
    """One shape of a result.

    Attributes
    ----------
    name, file : str
        The file is empty where the shape came from memory.
    relative_path : str
        Of the file, below the place that was aligned; empty where the shape came from memory.
    digest : str
        Of the content: the same whatever the file is called and wherever it lies.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    reflected : bool
    confidence : float
        NaN where it is not known.
    centroid_size : float
        Of its corresponding points, in the unit of its file.
    part : int
        Shapes of different parts are not aligned with each other.
    kind : str
        The name of its kind; empty where all shapes are of one.
    is_alone : bool
        Whether it is the only one of its kind, so that its pose compares with no other.
    alternatives : tuple of Alternative
        Other poses, the likeliest first.
    """

    name: str
    file: str
    relative_path: str
    digest: str
    transform: FloatArray
    reflected: bool
    confidence: float
    centroid_size: float
    part: int
    kind: str
    is_alone: bool
    alternatives: tuple[Alternative, ...]

    __repr__ = one_line


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CollectionData:
    """What a :class:`collalign.Collection` holds, which documents it; what writes and shows results takes this."""

    names: tuple[str, ...]
    files: tuple[str, ...]
    digests: tuple[str, ...]
    transforms: Annotated[FloatArray, Holds(shape="n 4 4")]
    confidence: Annotated[FloatArray, Holds(shape="n", nan=True)]
    samples: Annotated[IntArray, Holds(shape="n k")]
    positions: Annotated[FloatArray, Holds(shape="n k 3")]
    maps: ConsistentMaps
    consensus: Annotated[FloatArray, Holds(shape="_ 3")]
    landmarks: Annotated[FloatArray, Holds(shape="n _ 3", nan=True)]
    landmark_names: tuple[str, ...] = ()
    pairs: Sequence[AlignedPair]
    alternatives: tuple[tuple[Alternative, ...], ...]
    part_numbers: Annotated[IntArray, Holds(shape="n")]
    kinds: tuple[Kind, ...] = ()
    excluded: tuple[Excluded, ...] = ()
    notes: tuple[Note, ...] = ()
    copies: tuple[Copies, ...] = ()
    incomplete: tuple[Incomplete, ...] = ()
    extra: tuple[ExtraMaterial, ...] = ()
    assembled: tuple[str, ...] = ()
    limited_by: Mapping[str, str] = field(default_factory=dict)
    by_hand: Mapping[str, Annotated[float, Holds(nan=True)]] = field(default_factory=dict)
    options: AlignOptions
    group: str
    own: tuple[str, ...] = ()
    run: RunRecord
    cycle_errors_deg: Annotated[FloatArray, Holds(shape="_", nan=True)]
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    vertices: tuple[Annotated[FloatArray, Holds(shape="_ 3")], ...] = ()
    faces: tuple[Annotated[IntArray, Holds(shape="_ 3")], ...] = ()
    places: tuple[Annotated[NDArray[np.uint8], Holds(shape="_ _")], ...] = ()
    folder: Path | None = None
    fresh: Made | None = None

    def __post_init__(self) -> None:
        if not self.landmark_names:
            names = tuple(f"L{at + 1}" for at in range(self.landmarks.shape[1]))
            object.__setattr__(self, "landmark_names", names)
        object.__setattr__(self, "pairs", Pairs.of(self.pairs, self.names))

    def __repr__(self) -> str:
        known = ~np.isnan(self.confidence)
        doubtful, reflected = int((self.is_doubtful & known).sum()), int(self.reflected.sum())
        found = f"{len(self)} shapes, {len(self.pairs)} pairs, {doubtful} doubtful, {reflected} reflected"
        return f"<{type(self).__name__}: {found}>"

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[AlignedShape]:
        return (self[at] for at in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        """Return the transforms, shape (N, 4, 4), for ``np.asarray``; read-only where they are not copied.

        Raises
        ------
        ValueError
            If no copy may be made (``copy=False``) and the type asked for needs one.
        """
        wanted = np.dtype(np.float64 if dtype is None else dtype)
        if copy is False and wanted != self.transforms.dtype:
            raise ValueError(f"the transforms are float64 and cannot be {wanted} without a copy")
        return self.transforms.astype(wanted, copy=bool(copy))

    def __contains__(self, shape: object) -> bool:
        """Return whether there is a shape of this name."""
        name = shape.name if isinstance(shape, AlignedShape) else shape
        return (composed(name) if isinstance(name, str) else name) in self.names

    @overload
    def __getitem__(self, shape: str | int) -> AlignedShape: ...
    @overload
    def __getitem__(self, shape: slice) -> tuple[AlignedShape, ...]: ...
    def __getitem__(self, shape: str | int | slice) -> AlignedShape | tuple[AlignedShape, ...]:
        """Return one shape by name or position, or the shapes of a slice.

        Raises
        ------
        UnknownName
            If no shape has the name: a ``KeyError`` and an ``InputError``.
        """
        if isinstance(shape, slice):
            return tuple(self[at] for at in range(len(self))[shape])
        at = self.index(shape)
        return AlignedShape(
            name=self.names[at],
            file=self.files[at],
            relative_path=self.relative_paths[at],
            digest=self.digests[at],
            transform=self.transforms[at],
            reflected=bool(self.reflected[at]),
            confidence=float(self.confidence[at]),
            centroid_size=float(self.centroid_sizes[at]),
            part=int(self.part_numbers[at]),
            kind=self.kind_names[at],
            is_alone=bool(self.is_alone[at]),
            alternatives=self.alternatives[at],
        )

    def index(self, shape: str | int) -> int:
        """Return the position of a shape; an unknown name is an ``UnknownName``."""
        return position_of(self.names, shape)

    @property
    def relative_paths(self) -> tuple[str, ...]:
        """The path of each file below the place that was aligned, length N; empty where a shape came from memory."""
        return tuple(map(relative_path, self.names, self.files))

    @property
    def kind_names(self) -> tuple[str, ...]:
        """The kind of each shape, length N; empty where all are of one."""
        found = dict.fromkeys(range(len(self)), "")
        for kind in self.kinds:
            found |= dict.fromkeys(kind.shapes.tolist(), kind.called)
        return tuple(found.values())

    @property
    def is_alone(self) -> BoolArray:
        """Whether each shape is the only one of its kind, shape (N,)."""
        alone = [int(kind.shapes[0]) for kind in self.kinds if kind.is_alone]
        return np.isin(np.arange(len(self)), alone)

    @property
    def is_doubtful(self) -> BoolArray:
        """Whether each pose is in doubt, shape (N,): not sure, of a shape that is not the only one of its kind."""
        return ~(self.confidence >= DOUBT) & ~self.is_alone

    @property
    def scales(self) -> FloatArray:
        """Factor of each transform, shape (N,): common-frame length per unit of the file."""
        return scales_of(self.transforms)

    @property
    def centroid_sizes(self) -> FloatArray:
        """Centroid size of each shape's landmarks, in the unit of its file, shape (N,); as exports and R have it."""
        return centroid_sizes(self.landmarks)

    @property
    def rotations(self) -> FloatArray:
        """``R_common_shape``, the orthogonal part of each transform, shape (N, 3, 3)."""
        return self.transforms[:, :3, :3] / self.scales[:, None, None]

    @property
    def reflected(self) -> BoolArray:
        """Whether each shape is reflected, shape (N,)."""
        return np.linalg.det(self.transforms[:, :3, :3]) < 0

    @property
    def aligned_landmarks(self) -> FloatArray:
        """The landmarks in the common frame, shape (N, L, 3); NaN where missing."""
        return each_moved_by(self.transforms, self.landmarks)

    @property
    def is_incomplete(self) -> BoolArray:
        """Whether parts of each shape are missing, shape (N,)."""
        return np.isin(np.arange(len(self)), [one.shape for one in self.incomplete])

    @property
    def coverage(self) -> FloatArray:
        """Share of its partners' surfaces that each incomplete shape covers, NaN for complete ones, shape (N,)."""
        found = np.full(len(self), np.nan)
        for one in self.incomplete:
            found[one.shape] = one.coverage
        return found

    def file(self, at: int) -> Path:
        """Return the file of one shape.

        Raises
        ------
        InputError
            If the shape came from memory, or its file is not there any more.
        """
        if not self.files[at]:
            raise InputError(
                f"{self.names[at]}: came from memory, not from a file; save the shapes as files and align these"
            )
        if not is_there(self.files[at]):
            raise UnavailableError(
                f"{self.files[at]}: a shape of the collection is not there any more. If the files have moved, say "
                "where they are now (--sources FOLDER)"
            )
        return Path(self.files[at])

    @property
    def inputs(self) -> set[Path]:
        """Files and their folders, in none of which results may lie, nor they in the results' folder."""
        return inputs_of(Path(file) for file in self.files if file)

    def source_files(self) -> tuple[Path, ...]:
        """Return the files that the shapes were read from.

        Raises
        ------
        InputError
            If a shape came from memory, its file has vanished, or samples or invariants were the caller's own.
        """
        if given := {*self.own} & {"invariants", "samples"}:
            raise InputError(
                f"{self.folder or 'the result'}: was aligned with {' and '.join(sorted(given))} of the caller's own, "
                "which a result does not keep; align all shapes again, with them"
            )
        return tuple(self.file(at) for at in range(len(self)))

    def with_sources(self, folder: str | Path) -> Self:
        """Return the same result with the original files in another folder.

        They are looked for by name, and renamed ones by their content.

        Raises
        ------
        InputError
            If the folder holds none of them, or one file would stand for two shapes.
        """
        return replace(self, files=find_files(self.names, self.files, self.digests, folder))

    @cached_property
    def surfaces(self) -> tuple[tuple[FloatArray, IntArray], ...]:
        """Display meshes in file coordinates, vertices (v, 3) and faces (f, 3): those saved, or made of the files."""
        if self.vertices:
            return tuple(zip(self.vertices, self.faces, strict=True))
        shapes = [self.shape_at(at) for at in range(len(self))]
        num = faces_per_shape(len(shapes))
        return tuple(display_mesh(shape.vertices, shape.faces, max_faces=num) for shape in shapes)

    @property
    def has_vertex_maps(self) -> bool:
        """Whether all vertices of the shapes have maps, which ``deformable`` asks for."""
        if self.folder is not None:
            return (self.folder / VERTEX_MAPS_FILE).is_file()
        return self.made.vertices is not None

    @cached_property
    def vertex_maps(self) -> VertexMaps:
        """Maps of all vertices between the shapes, as their files count them; of a folder read when first asked for.

        Raises
        ------
        InputError
            If the result has none: it was aligned without ``deformable``.
        """
        if self.folder is not None:
            return load_vertex_maps(self.folder)
        if self.made.vertices is None:
            raise InputError(
                "there are no maps of all vertices; align with deformable=True (--deformable)"
            )
        return self.made.vertices

    def some(self, chosen: IntArray) -> Self:
        """Return the collection as if there were only some of its shapes, given by position (n,), ascending."""
        position = {shape: at for at, shape in enumerate(chosen.tolist())}

        def of(values: Any) -> Any:
            if isinstance(values, np.ndarray):
                return values[chosen]
            return tuple(values[at] for at in position) if values else ()

        names = of(self.names)
        return replace(
            self,
            **{name: of(getattr(self, name)) for name in PER_SHAPE},
            maps=ConsistentMaps(names=names, labels=self.maps.labels[chosen]),
            pairs=[
                replace(pair, target=position[pair.target], source=position[pair.source])
                for pair in self.pairs
                if {pair.target, pair.source} <= position.keys()
            ],
            kinds=tuple(
                kind.among(position) for kind in self.kinds if {*kind.shapes.tolist()} & {*position}
            ),
            incomplete=tuple(
                one.among(position) for one in self.incomplete if one.shape in position
            ),
            extra=tuple(
                replace(one, shape=position[one.shape])
                for one in self.extra
                if one.shape in position
            ),
            assembled=tuple(name for name in self.assembled if name in names),
            limited_by={name: code for name, code in self.limited_by.items() if name in names},
            labels={column: of(values) for column, values in self.labels.items()},
        )

    @property
    def made(self) -> Made:
        """What only the run that made the result knows.

        Raises
        ------
        InputError
            If the result was loaded.
        """
        if self.fresh is None:
            raise InputError(
                f"{self.folder}: the result was loaded from there and is saved; copy this folder instead"
            )
        return self.fresh

    def cleaning_of(self, at: int) -> CleaningOptions:
        """Return how the file of a shape is read again; this may differ between kinds, and by its components."""
        of_kind = (kind.cleaning for kind in self.kinds if at in kind.shapes)
        cleaning = next(of_kind, self.options.cleaning).again
        return replace(cleaning, components="all") if self.names[at] in self.assembled else cleaning

    def posed_file(self, at: int) -> PosedFile:
        """Return what a worker needs to read a shape."""
        path = self.file(at) if self.fresh is None else self.fresh.files[at]
        return PosedFile(
            name=self.names[at],
            path=path,
            digest=hash_shape(path) if self.fresh is None else self.digests[at],
            transform=self.transforms[at],
            cleaning=self.cleaning_of(at),
            incomplete=bool(self.is_incomplete[at]),
        )

    def shape_at(self, at: int, *, aligned: bool = False) -> Shape:
        """Return a shape in file coordinates, maybe decimated, or aligned at full resolution."""
        if self.folder is None:
            file = self.posed_file(at)
            return file.read().transformed(file.transform) if aligned else file.read()
        if aligned:
            mesh = self.folder / MESH_FOLDER / f"{file_stems(self.names)[at]}.ply"
            return read_shape(mesh, AS_STORED, name=self.names[at])
        return Shape(name=self.names[at], vertices=self.vertices[at], faces=self.faces[at])
