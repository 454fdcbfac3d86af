"""Shapes that are there more than once: identical files, copies in another pose or size, and mirror images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray, read_only, rms_length
from data_tools.notes import Note
from data_tools.surface.cleaning import share_kept
from data_tools.surface.shape import Shape
from data_tools.surface.topology import vertex_components

_LEVELS = (np.arange(16) + 0.5) / 16


@dataclass(frozen=True, kw_only=True)
class Copies:
    """Shapes of a collection that are one and the same surface.

    Attributes
    ----------
    names : tuple of str
    kind : {"identical", "moved", "mirrored"}
        Files of the same bytes; the same vertices up to rotation, shift, size and order; or up to a reflection too.
    """

    names: tuple[str, ...]
    kind: Literal["identical", "moved", "mirrored"]

    @property
    def note(self) -> Note:
        """Who they are, as a note."""
        return Note("copies", self.names, {"kind": self.kind})


def shape_signature(shape: Shape) -> FloatArray:
    """Describe a shape by what no rotation, shift or size and no order of its vertices changes.

    Parameters
    ----------
    shape : Shape
        As its file has it: of a decimated copy little is reproducible.

    Returns
    -------
    ndarray, shape (18,)
        Quantiles of the vertices' distances from their centroid, in root mean square radii; the length of a = mean of
        |x|^2 x; and the determinant of the directions of a, C a and C^2 a, with the covariance C, whose sign a
        reflection changes. Read-only.
    """
    centred = shape.vertices - shape.vertices.mean(axis=0)
    unit = centred / (rms_length(centred) or 1.0)
    radii = np.linalg.norm(unit, axis=1)
    skew, spread = (radii[:, None] ** 2 * unit).mean(axis=0), unit.T @ unit / len(unit)
    rotated = np.array([skew, spread @ skew, spread @ spread @ skew])
    hand = np.linalg.det(
        rotated / np.maximum(np.linalg.norm(rotated, axis=1, keepdims=True), np.finfo(float).tiny)
    )
    return read_only(np.array([*np.quantile(radii, _LEVELS), np.linalg.norm(skew), hand]))


#: How near signatures of copies are. Rotated and rounded copies differ by less than 1e-5, different models by 9e-4.
COPIES_TOL = 3e-5


def is_copy(one: FloatArray, other: FloatArray) -> bool:
    """Return whether signatures (18,) are those of one shape, or of mirror images."""
    return bool(np.linalg.norm(one[:-1] - other[:-1]) <= COPIES_TOL)


def find_copies(
    names: Sequence[str],
    digests: Sequence[str],
    signatures: Sequence[FloatArray],
    notes: Sequence[Sequence[Note]],
    *,
    tol: float = COPIES_TOL,
) -> tuple[Copies, ...]:
    """Find the shapes that are there more than once.

    Parameters
    ----------
    names, digests : sequence of str
        Of all shapes and their files' contents.
    signatures : sequence of ndarray, shape (18,)
        See :func:`shape_signature`.
    notes : sequence of sequence of Note
        Of all shapes. Where cleaning kept some components, copies have the same share of their area in these: alike
        bodies of two guitars with other strings are no copies.
    tol : float
        How near signatures of copies are.
    """
    if not names:
        return ()
    first = {digest: at for at, digest in reversed([*enumerate(digests)])}
    same = np.array([first[digest] for digest in digests], dtype=np.int64)
    pairs = np.column_stack([np.arange(len(names)), same])
    kept = np.array([share_kept(own) for own in notes])
    values = np.column_stack([kept, np.array(signatures).reshape(len(names), -1)])
    near = (
        scipy.spatial.cKDTree(values[:, :-1])
        .query_pairs(tol, output_type="ndarray")
        .astype(np.int64)
    )
    hands = values[near, -1]
    opposite = (hands.prod(axis=1) < 0) & (
        np.abs(hands).min(axis=1) > tol**2
    )  # else its own mirror image
    groups = _groups(np.vstack([pairs, near[~opposite]]), len(names))
    mirrored = near[opposite]
    found = []
    for group in np.flatnonzero(np.bincount(groups, minlength=1) > 1):
        members = [at for at, of in enumerate(groups) if of == group]
        is_one_file = len({digests[at] for at in members}) == 1
        found.append(
            Copies(names=_named(names, members), kind="identical" if is_one_file else "moved")
        )
    for left, right in np.unique(np.sort(groups[mirrored], axis=1), axis=0):
        firsts = sorted(groups.tolist().index(group) for group in (left, right))
        found.append(Copies(names=_named(names, firsts), kind="mirrored"))
    return tuple(found)


def _groups(pairs: IntArray, num: int) -> IntArray:
    """Return the number of the component of each shape, in the order of their first members."""
    return vertex_components(num, [pairs])[1]


def _named(names: Sequence[str], chosen: Sequence[int]) -> tuple[str, ...]:
    return tuple(names[at] for at in chosen)
