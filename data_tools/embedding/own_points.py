"""Samples and invariants that a caller gives of a shape, counted as its file counts vertices or as the shape does."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnPoints:
    """What is given of one shape.

    Attributes
    ----------
    samples : ndarray of int, shape (k,), or None
        Vertices.
    invariants : ndarray, shape (v, m), or None
        Of every vertex.
    weight : float
        Of the invariants, as in :class:`data_tools.options.EmbeddingOptions`.
    """

    samples: IntArray | None
    invariants: FloatArray | None
    weight: float

    @property
    def digest(self) -> str:
        """What the keys of results hold of it."""
        found = hashlib.sha256(repr(self.weight).encode())
        for values in (self.samples, self.invariants):
            found.update(b"-" if values is None else repr(values.shape).encode() + values.tobytes())
        return found.hexdigest()

    def of_shape(self, shape: Shape) -> OwnPoints:
        """Return the same by the vertices of a shape that was read from the file.

        Raises
        ------
        InputError
            If there are not as many rows as vertices, or cleaning removed a sample.
        """
        total, file = len(shape.vertices), shape.file_indices
        invariants, samples = self.invariants, self.samples
        if invariants is not None:
            if len(invariants) != (num := shape.file_size or total):
                raise InputError(f"invariants: {len(invariants)} rows for {num} vertices of the file")
            invariants = invariants[file]
        if samples is not None:
            at = np.searchsorted(file, samples)
            lost = samples[(at == total) | (file[np.minimum(at, total - 1)] != samples)]
            if len(lost):
                raise InputError(f"samples: vertex {lost[0]} is none of the file, or was removed when it was cleaned")
            samples = at
        return replace(self, samples=samples, invariants=invariants)
