"""Dense correspondence of a collection: one triangulation laid onto every shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray, one_line


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseCorrespondence:
    """The mean surface of a collection and where each of its vertices lies on every shape. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
        Shapes that were registered.
    faces : ndarray of int, shape (f, 3)
        Triangles of the mean and of every shape's copy of it; empty for point clouds.
    mean : ndarray, shape (v, 3)
        In the common frame: the average of the copies, each where its shape is there; on no specimen.
    vertices : ndarray, shape (N, v, 3)
        The mean's vertices on each shape, in the common frame; NaN where an incomplete shape has nothing.
    completed : ndarray, shape (N, v, 3)
        The same, with what an incomplete shape lacks as the mean has it, bent as the rest of the shape asks: a guess.
    residual : ndarray, shape (N, v)
        Distance of each of them to the shape's surface, in units of the common frame; NaN where it has nothing.
    quality : ndarray, shape (N, v)
        Between 0 (no counterpart on the shape) and 1.
    failed : tuple of (str, str)
        Names of shapes that could not be registered, and why.
    """

    names: tuple[str, ...]
    faces: IntArray
    mean: FloatArray
    vertices: FloatArray
    completed: FloatArray
    residual: FloatArray
    quality: FloatArray
    failed: tuple[tuple[str, str], ...] = ()

    __repr__ = one_line

    @property
    def missing(self) -> BoolArray:
        """Where each shape has nothing, shape (N, v)."""
        return np.asarray(np.isnan(self.vertices).any(axis=2))
