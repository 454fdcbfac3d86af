"""Posture taken out of statistics: each part of all specimens brought to its mean place and direction."""

from __future__ import annotations

import numpy as np
import scipy

from collalign.analysis.procrustes import (
    MIN_LABELS,
    best_rotations,
    centroid_sizes,
    generalized_procrustes,
)
from collalign.output.collection import Collection
from collalign.tools.correspond import DenseCorrespondence
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.poses import moved_by


def parts_of_mean(
    collection: Collection, dense: DenseCorrespondence
) -> tuple[tuple[str, ...], IntArray]:
    """Return the names of the parts of specimens, and to which of them each vertex of the mean belongs.

    Each specimen votes for the part that is nearest to its copy of the vertex.

    Parameters
    ----------
    collection : Collection
        Whose original files can be read.
    dense : DenseCorrespondence
        Of complete shapes.

    Returns
    -------
    names : tuple of str
        Of those parts that have vertices.
    parts : ndarray of int, shape (v,)

    Raises
    ------
    InputError
        If a file is not there any more, specimens are of one part, or two parts cannot be told apart.
    """
    votes: dict[str, IntArray] = {}
    for name, copy in zip(dense.names, dense.vertices, strict=True):
        at = collection.index(name)
        shape = read_shape(collection.file(at), collection.cleaning_of(at), name=name)
        if len(shape.parts) > 1:
            own = shape.split()
            placed = [moved_by(collection.transforms[at], part.vertices) for part in own.values()]
            nearest = np.argmin(
                [scipy.spatial.cKDTree(points).query(copy)[0] for points in placed], axis=0
            )
            for number, part in enumerate(own):
                votes[part] = votes.get(part, np.zeros(len(copy), dtype=np.int64)) + (
                    nearest == number
                )
    if len(votes) < 2:
        raise InputError(
            "without_posture: the specimens are of one part each; posture is that of parts to each other. Align "
            "folders of parts with --parts"
        )
    chosen = np.argmax([*votes.values()], axis=0)
    kinds, parts, counts = np.unique(chosen, return_inverse=True, return_counts=True)
    if len(kinds) < 2 or counts.min() < MIN_LABELS:
        raise InputError(
            "without_posture: the parts lie in each other, so their surfaces cannot be told apart"
        )
    return tuple([*votes][kind] for kind in kinds.tolist()), parts.reshape(-1)


def at_mean_posture(vertices: FloatArray, parts: IntArray) -> FloatArray:
    """Bring each part of all specimens to its mean place and direction among the others, by rotation and translation.

    Sizes stay: how large a part is compared with another one is shape. Other information in the places of parts, such
    as a joint that lies farther back, goes as well.

    Parameters
    ----------
    vertices : ndarray, shape (N, v, 3)
        Complete, in correspondence.
    parts : ndarray of int, shape (v,)
        The part of each vertex.

    Returns
    -------
    ndarray, shape (N, v, 3)
        In the unit of ``vertices``, superimposed.

    References
    ----------
    Adams, Methods for shape analysis of landmark data from articulated structures, Evolutionary Ecology Research 1
    (1999): separate superimposition of parts that move against each other.
    """
    whole = generalized_procrustes(vertices)
    moved = np.array(whole)
    for part in np.unique(parts):
        own = whole[:, parts == part]
        centre = own.mean(axis=(0, 1))
        alone = generalized_procrustes(own) * centroid_sizes(own)[:, None, None]
        rotation = best_rotations(own.mean(axis=0) - centre, alone.mean(axis=0))
        moved[:, parts == part] = alone @ rotation.T + centre
    return read_only(moved * centroid_sizes(vertices)[:, None, None])
