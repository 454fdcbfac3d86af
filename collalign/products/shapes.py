"""The shapes of a run, sampled and embedded, their files, what is incomplete or left out, and what is decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from data_tools.arrays import FloatArray, Holds, IntArray
from data_tools.embedding.chirality import SurfaceChirality
from data_tools.embedding.embedding import Samples
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.poses import moved_by
from data_tools.surface.cleaning import is_assembled
from data_tools.surface.extra import ExtraSurface
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedFile:
    """A file of a collection and where it stands.

    Attributes
    ----------
    name : str
    path : Origin
    digest : str
        Of the file's content, which is to be the same when it is read.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    cleaning : CleaningOptions
    incomplete : bool
        Whether parts of the shape are missing, which are looked for then.
    """

    name: str
    path: Origin
    digest: str
    transform: FloatArray
    cleaning: CleaningOptions
    incomplete: bool = False

    def read(self, cleaning: CleaningOptions | None = None) -> Shape:
        """Return the shape in its own coordinates, cleaned as for the alignment or otherwise."""
        return read_shape(self.path, cleaning or self.cleaning, name=self.name, digest=self.digest)


#: Code of the reason of a shape that was posed on others as if it were a part of such a shape, but resembles none.
STRANGER = "stranger"


@dataclass(frozen=True, kw_only=True, eq=False)
class Incomplete:
    """A shape that was posed on others by what has a counterpart on them.

    Attributes
    ----------
    shape : int
        Its position in the collection.
    reason : str
        Code of why it counts as incomplete; :func:`collalign.wording.reason_text` has the words.
    partners : ndarray of int, shape (n,)
        The shapes that it was posed on.
    overlaps : ndarray, shape (n, 2)
        Share of each partner's points with a counterpart on this shape, and of this shape's points on the partner.
    beyond : float
        Share of their points that lie beyond its rim.
    """

    shape: int
    reason: str
    partners: Annotated[IntArray, Holds(shape="n")]
    overlaps: Annotated[FloatArray, Holds(shape="n 2")]
    beyond: Annotated[float, Holds(nan=True)] = float("nan")

    @property
    def is_stranger(self) -> bool:
        """Whether it resembles none of its partners: nothing of them is known to be missing."""
        return self.reason == STRANGER

    @property
    def coverage(self) -> float:
        """The share of its partners' surfaces that it covers."""
        return float(self.overlaps[:, 0].mean()) if len(self.overlaps) else float("nan")

    def among(self, position: Mapping[int, int]) -> Incomplete:
        """Return what is known of it by the new positions of some shapes, with its partners that have one."""
        partners = self.partners.tolist()
        kept = np.array([at in position for at in partners], dtype=bool)
        there = np.array([position[at] for at in partners if at in position], dtype=np.int64)
        return replace(
            self, shape=position[self.shape], partners=there, overlaps=self.overlaps[kept]
        )


def free_rotation(scan: str, whole: str, axis: FloatArray) -> Note:
    """Return the note that a scan may be turned about an axis (2, 3), in coordinates of a whole, both by name."""
    values = {"axis": " ".join(f"{value:.3g}" for value in axis[1]), "whole": whole}
    return Note("free-rotation", (scan,), values)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExtraMaterial:
    """Material of a shape that no other shape has, such as a stand, plaster or a neighbour; poses ignore it.

    Attributes
    ----------
    shape : int
        Its position in the collection.
    surface : ExtraSurface
        Points of the shape, and which of them are extra.
    """

    shape: int
    surface: ExtraSurface

    @property
    def share(self) -> float:
        """The share of the shape's surface that is extra."""
        return float(self.surface.is_extra.mean())

    def direction(self, transform: FloatArray) -> FloatArray:
        """Return where it lies in the common frame, seen from the rest: a unit vector (3,).

        Parameters
        ----------
        transform : ndarray, shape (4, 4)
            File coordinates to the common frame.
        """
        points, extra = moved_by(transform, self.surface.points), self.surface.is_extra
        arm = points[extra].mean(axis=0) - points[~extra].mean(axis=0)
        return np.asarray(arm / max(float(np.linalg.norm(arm)), np.finfo(float).tiny))

    def side(self, transform: FloatArray) -> str:
        """Return the axis of the common frame nearest to this direction at a pose (4, 4), such as ``-z``."""
        direction = self.direction(transform)
        axis = int(np.abs(direction).argmax())
        return ("-" if direction[axis] < 0 else "") + "xyz"[axis]


@dataclass(frozen=True, kw_only=True)
class Excluded:
    """A file or a pair that was left out, and why.

    Attributes
    ----------
    file : str
        The file's name, or the two names of a pair.
    reason : str
        One sentence that says what is wrong.
    """

    file: str
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Shapes:
    """The shapes that could be prepared, in the order of the folder, and the files that could not.

    Attributes
    ----------
    names : tuple of str
    files : tuple of Path or Source
    digests : tuple of str
        Of the files' contents.
    keys : tuple of str
        Keys of the shapes' records in the store.
    samples : tuple of Samples
    cleaning : tuple of CleaningOptions
        How each was read.
    chirality : tuple of SurfaceChirality or None
        Which way each surface turns, where that was found out while it was sampled.
    excluded : tuple of Excluded
    notes : tuple of Note
        What was done otherwise than asked for.
    """

    names: tuple[str, ...]
    files: tuple[Origin, ...]
    digests: tuple[str, ...]
    keys: tuple[str, ...]
    samples: tuple[Samples, ...]
    cleaning: tuple[CleaningOptions, ...]
    chirality: tuple[SurfaceChirality | None, ...]
    excluded: tuple[Excluded, ...]
    notes: tuple[Note, ...] = ()

    def some(self, chosen: Sequence[int]) -> Shapes:
        """Return some of the shapes, by position."""
        of_shapes = ("names", "files", "digests", "keys", "samples", "cleaning", "chirality")
        return replace(
            self, **{name: tuple(getattr(self, name)[i] for i in chosen) for name in of_shapes}
        )

    @property
    def are_assembled(self) -> bool:
        """Whether most shapes are assembled of components, by whichever of these they were read."""
        every = zip(self.samples, self.cleaning, strict=True)
        return (
            sum(how.components == "all" or is_assembled(one.notes) for one, how in every)
            > len(self.names) / 2
        )

    def label(self, i: int, j: int) -> str:
        """Return what a pair of shapes is called in messages."""
        return f"{self.names[i]} - {self.names[j]}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Constraints:
    """What a person has decided about the poses, by position of the shape.

    Attributes
    ----------
    fixed : mapping of int to ndarray (3, 3)
        ``R_common_shape`` that stay.
    fixed_transforms : mapping of int to ndarray (4, 4)
        Whole transforms that stay, of shapes whose rotation is fixed as well.
    by_hand : frozenset of int
        The fixed shapes whose pose a person decided, which makes it certain; the others only stay where they were.
    reference : int
        Shape whose orientation is the common frame's where no shape is fixed.
    candidates : mapping of (int, int) to ndarray (m, 3, 3)
        ``R_i_j`` of pairs i < j that the caller proposes.
    weights : mapping of (int, int) to float
        How much pairs i < j count in synchronization; 0 leaves a pair out.
    order : tuple of int
        Scans in the order in which they were taken; empty where nobody said.
    rotation : ndarray, shape (3, 3), optional
        ``R_common_reference``, where no shape is fixed; by default the reference is not rotated.
    origin : ndarray, shape (3,), optional
        Point of the reference, in the coordinates of its file, at which the common frame has its origin, where no
        whole transform is fixed; by default that is in the middle of each shape.
    """

    fixed: Mapping[int, FloatArray] = field(default_factory=dict)
    fixed_transforms: Mapping[int, FloatArray] = field(default_factory=dict)
    by_hand: frozenset[int] = frozenset()
    reference: int = 0
    candidates: Mapping[tuple[int, int], FloatArray] = field(default_factory=dict)
    weights: Mapping[tuple[int, int], float] = field(default_factory=dict)
    order: tuple[int, ...] = ()
    rotation: FloatArray | None = None
    origin: FloatArray | None = None

    def some(self, chosen: Sequence[int]) -> Constraints:
        """Return those of some of the shapes, by position among these; the first is the reference if it is lost."""
        at = {i: number for number, i in enumerate(chosen)}
        return Constraints(
            fixed={at[i]: pose for i, pose in self.fixed.items() if i in at},
            fixed_transforms={at[i]: pose for i, pose in self.fixed_transforms.items() if i in at},
            by_hand=frozenset(at[i] for i in self.by_hand if i in at),
            reference=at.get(self.reference, 0),
            candidates={
                (at[i], at[j]): of for (i, j), of in self.candidates.items() if i in at and j in at
            },
            weights={
                (at[i], at[j]): of for (i, j), of in self.weights.items() if i in at and j in at
            },
            order=tuple(at[i] for i in self.order if i in at),
            rotation=self.rotation,
            origin=self.origin,
        )

    @property
    def any_mirrored(self) -> bool:
        """Whether a pose that is fixed, or proposed for a pair, mirrors a shape."""
        poses = (*self.fixed.values(), *self.candidates.values())
        return any(bool((np.linalg.det(pose) < 0).any()) for pose in poses)
