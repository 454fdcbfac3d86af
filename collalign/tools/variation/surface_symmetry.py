"""Symmetric and asymmetric components of bilateral surfaces in dense correspondence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collalign.analysis.procrustes import PrincipalComponents, principal_components
from collalign.analysis.shape_tests import AnovaRow
from collalign.analysis.symmetry import object_symmetry
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.surface.closest import SurfacePoints
from data_tools.threads import one_blas_thread


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceSymmetry:
    """Bilateral surfaces, superimposed; the mirror plane is x = 0, lengths are in root mean square radii.

    Arrays are read-only.

    Attributes
    ----------
    mean, directional : ndarray, shape (v, 3)
        The symmetric mean, and the mean of the asymmetric components.
    asymmetric : ndarray, shape (N, v, 3)
        What each vertex of each surface differs by from where symmetry would have it.
    asymmetry, fluctuating : ndarray, shape (N,)
        Root mean square of the asymmetric component, and of what it differs by from the directional one.
    symmetric_components, asymmetric_components : PrincipalComponents
        Of each component of shape variation.
    anova : tuple of AnovaRow
    """

    mean: FloatArray
    directional: FloatArray
    asymmetric: FloatArray
    asymmetry: FloatArray
    fluctuating: FloatArray
    symmetric_components: PrincipalComponents
    asymmetric_components: PrincipalComponents
    anova: tuple[AnovaRow, ...]


@one_blas_thread()
def surface_symmetry(
    vertices: FloatArray,
    faces: IntArray,
    counterparts: SurfacePoints,
    *,
    mirrored: BoolArray | None = None,
    individuals: Sequence[str] | None = None,
) -> SurfaceSymmetry:
    """Split surfaces into symmetric and asymmetric components.

    Every vertex and its counterpart are a pair, so that the pairing is exact whatever the triangulation is.

    Parameters
    ----------
    vertices : ndarray, shape (N, v, 3)
    faces : ndarray of int, shape (f, 3)
    counterparts : SurfacePoints
        Of every vertex, on the triangulation; see :func:`collalign.tools.variation.mirror.mirror_map`.
    mirrored : ndarray of bool, shape (N,), optional
        Surfaces that were mirrored to fit the others: their sides are exchanged back.
    individuals : sequence of str, length N, optional
        Whom each surface belongs to, where some are replicates.

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
    found = object_symmetry(both, partner, individuals=individuals)
    unit = float(np.sqrt(2 * num))
    mean = unit * found.mean[:num]
    return SurfaceSymmetry(
        mean=read_only(mean),
        directional=read_only(unit * found.directional[:num]),
        asymmetric=read_only(unit * found.asymmetric[:, :num]),
        asymmetry=found.asymmetry,
        fluctuating=found.fluctuating,
        symmetric_components=principal_components(unit * found.symmetric[:, :num]),
        asymmetric_components=principal_components(unit * found.asymmetric[:, :num]),
        anova=found.anova,
    )
