"""What the report, the exports, the classification and the desktop viewer need of an aligned collection.

A :class:`CollectionView` is a plain record. ``AlignedCollection`` makes one,
:mod:`collalign.output.evidence.evidence_file` writes it into the folder and reads it back, and nothing else of
the toolkit is needed to show or export a result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.products.aligned_collection import position_of
from collalign.products.incomplete import Incomplete
from collalign.products.pair import Alternative, Pair, Pairs
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.poses import scales_of


@dataclass(frozen=True, kw_only=True, eq=False)
class CollectionView:
    """An aligned collection, ready to be shown or exported.

    Attributes
    ----------
    names : tuple of str
        N names, unique.
    files : tuple of str
        Where each shape was read from; empty where it came from memory.
    transforms : ndarray, shape (N, 4, 4)
        Take file coordinates to the common frame, scale and reflection included.
    confidence : ndarray, shape (N,)
        In [0, 1].
    samples : ndarray, shape (N, k, 3)
        Sample positions in *file* coordinates; row b of every shape carries the same label, NaN where a shape has no
        sample of that label.
    vertices, faces : tuple of ndarray
        Display meshes in file coordinates, (v, 3) and (f, 3); no faces for a point cloud. May be decimated.
    pairs : tuple of Pair
        With the candidates that a person would tell apart and without their maps; ``map_target_source[b]`` is the
        *label* on the target of the sample with label b on the source, -1 where unmatched, and the map is empty
        where it is the collection's own correspondence, in which equal labels match.
    alternatives : tuple of tuple of Alternative
        Per shape, the other poses that its pairs allow; the present pose is not among them.
    part_numbers : ndarray of int, shape (N,)
        Shapes of different parts are not aligned to each other.
    labels : mapping of str to tuple of str
        Column name to N values, ``""`` where unknown.
    excluded : tuple of (file, reason)
        What could not be aligned.
    options, versions, timings_s : mapping
        Of the run; JSON types only.
    cycle_errors_deg : ndarray
        Rotation angle left after going around cycles of three pairs.
    notes : tuple of str
        Warnings about the collection as a whole, one sentence each.
    landmark_names : tuple of str
        What the rows of ``samples`` are called; ``L1``, ``L2``, ... where nothing is given.
    incomplete : tuple of Incomplete
        The shapes of which parts are missing.
    places : tuple of ndarray of uint8
        Where all vertices have maps, a colour (v, 3) of each vertex of the display meshes by its place on the
        reference, alike where vertices correspond; empty (0, 3) for a shape without maps.
    """

    names: tuple[str, ...]
    files: tuple[str, ...]
    transforms: FloatArray
    confidence: FloatArray
    samples: FloatArray
    vertices: tuple[FloatArray, ...]
    faces: tuple[IntArray, ...]
    pairs: tuple[Pair, ...] = ()
    alternatives: tuple[tuple[Alternative, ...], ...] = ()
    part_numbers: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    excluded: tuple[tuple[str, str], ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    timings_s: Mapping[str, float] = field(default_factory=dict)
    cycle_errors_deg: FloatArray = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()
    landmark_names: tuple[str, ...] = ()
    incomplete: tuple[Incomplete, ...] = ()
    places: tuple[NDArray[np.uint8], ...] = ()

    def __post_init__(self) -> None:
        """Fill what may be left out and check that everything speaks of the same N shapes."""
        num = len(self.names)
        if not self.landmark_names:
            object.__setattr__(self, "landmark_names", tuple(f"L{at + 1}" for at in range(self.samples.shape[1])))
        if not self.alternatives:
            object.__setattr__(self, "alternatives", ((),) * num)
        if not len(self.part_numbers):
            object.__setattr__(self, "part_numbers", np.zeros(num, dtype=np.int64))
        lengths: dict[str, int] = {
            "files": len(self.files),
            "transforms": len(self.transforms),
            "confidence": len(self.confidence),
            "samples": len(self.samples),
            "vertices": len(self.vertices),
            "faces": len(self.faces),
            "alternatives": len(self.alternatives),
            "part_numbers": len(self.part_numbers),
        } | {f"label column {column}": len(values) for column, values in self.labels.items()}
        for name, length in lengths.items():
            if length != num:
                raise InputError(f"{name}: {length} entries for {num} shapes")
        if len(set(self.names)) != num:
            raise InputError("names: two shapes of a collection carry the same name; rename one of the files")
        if self.transforms.shape != (num, 4, 4) or self.samples.shape != (num, self.samples.shape[1], 3):
            raise InputError(
                f"transforms and samples: expected ({num}, 4, 4) and ({num}, k, 3), "
                f"got {self.transforms.shape} and {self.samples.shape}"
            )
        if not np.isfinite(self.transforms).all() or (np.abs(np.linalg.det(self.transforms[:, :3, :3])) == 0).any():
            raise InputError("transforms: singular, NaN or infinite")
        if len(self.landmark_names) != self.samples.shape[1]:
            raise InputError(
                f"landmark_names: {len(self.landmark_names)} names for {self.samples.shape[1]} landmarks"
            )
        for pair in self.pairs:
            if not (0 <= pair.target < num and 0 <= pair.source < num and pair.target != pair.source):
                raise InputError(f"pairs: ({pair.target}, {pair.source}) is not a pair of {num} shapes")
        for one in self.incomplete:
            if not all(0 <= i < num for i in (one.shape, *one.partners.tolist())):
                raise InputError(f"incomplete: shape {one.shape} or its partners are not among {num} shapes")
        object.__setattr__(self, "pairs", Pairs.of(self.pairs, self.names))

    @property
    def num_shapes(self) -> int:
        """Number of aligned shapes N."""
        return len(self.names)

    @property
    def scales(self) -> FloatArray:
        """Factor of each transform, shape (N,): common-frame length per unit of the file."""
        return scales_of(self.transforms)

    @property
    def rotations(self) -> FloatArray:
        """Orthogonal part of each transform, shape (N, 3, 3)."""
        return self.transforms[:, :3, :3] / self.scales[:, None, None]

    @property
    def reflected(self) -> BoolArray:
        """Whether each transform mirrors its shape, shape (N,)."""
        return np.linalg.det(self.transforms[:, :3, :3]) < 0

    @property
    def aligned_samples(self) -> FloatArray:
        """Sample positions in the common frame, shape (N, k, 3); NaN where missing."""
        return self.samples @ np.swapaxes(self.transforms[:, :3, :3], 1, 2) + self.transforms[:, None, :3, 3]

    @property
    def centroid_sizes(self) -> FloatArray:
        """Square root of the summed squared distances of samples from their centroid, in file units, shape (N,).

        NaN where a shape has no samples.
        """
        known = np.asarray(np.isfinite(self.samples).all(axis=2))
        counts = known.sum(axis=1)
        filled = np.where(known[..., None], self.samples, 0.0)
        centres = filled.sum(axis=1) / np.maximum(counts, 1)[:, None]
        squares = np.where(known, ((filled - centres[:, None]) ** 2).sum(axis=2), 0.0).sum(axis=1)
        return np.asarray(np.sqrt(np.where(counts > 0, squares, np.nan)))

    @property
    def is_incomplete(self) -> BoolArray:
        """Whether parts of each shape are missing, shape (N,)."""
        found = np.zeros(self.num_shapes, dtype=bool)
        found[[one.shape for one in self.incomplete]] = True
        return found

    @property
    def coverage(self) -> FloatArray:
        """Share of its partners' surfaces that each incomplete shape covers, NaN for complete ones, shape (N,)."""
        found = np.full(self.num_shapes, np.nan)
        for one in self.incomplete:
            found[one.shape] = one.coverage
        return found

    def file(self, at: int) -> Path:
        """Return the file of one shape.

        Raises
        ------
        InputError
            If the shape came from memory.
        """
        if not self.files[at]:
            raise InputError(
                f"{self.names[at]}: came from memory, not from a file; save the shapes as files and align these"
            )
        return Path(self.files[at])

    @property
    def inputs(self) -> set[Path]:
        """Files and their folders, in none of which results may lie, nor they in the results' folder."""
        return {place for file in self.files if file for place in (Path(file), Path(file).parent)}

    def index(self, name: str) -> int:
        """Position of a shape.

        Raises
        ------
        UnknownName
            If no shape has that name.
        """
        return position_of(self.names, name)


def json_types(value: Any) -> Any:
    """Turn a value into JSON types: tuples into lists, numbers that are not finite into None."""
    if isinstance(value, Mapping):
        return {str(key): json_types(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_types(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return json_types(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
