"""Symmetric and asymmetric components of bilateral surfaces in dense correspondence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED
from collalign.analysis.symmetry import ObjectSymmetry, object_symmetry
from data_tools.arrays import BoolArray, FloatArray, read_only
from data_tools.notes import Note
from data_tools.surface.closest import SurfacePoints
from data_tools.threads import one_blas_thread


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
    return float(np.sqrt(((back - mean) ** 2).sum(axis=1).mean()))


def shared_error_notes(found: ObjectSymmetry, error: float) -> tuple[Note, ...]:
    """Return the warning that the directional asymmetry may be an error of registration; none where it is larger."""
    directional = float(np.sqrt((found.directional**2).sum(axis=1).mean()))
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
    found = object_symmetry(both, partner, individuals=individuals, permutations=permutations, seed=seed)
    unit = float(np.sqrt(2 * num))
    return replace(
        found,
        mean=read_only(unit * found.mean[:num]),
        symmetric=read_only(unit * found.symmetric[:, :num]),
        asymmetric=read_only(unit * found.asymmetric[:, :num]),
        directional=read_only(unit * found.directional[:num]),
    )
