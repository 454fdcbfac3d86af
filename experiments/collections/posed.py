"""Puts collections into random poses and measures how well an alignment undoes them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collalign.engine.records import Record
from data_tools.arrays import FloatArray, IntArray
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.datasets import Dataset

#: A pair beyond this angle is called gross.
GROSS_DEG = 30.0
#: The error of a shape of the wrong chirality.
MIRRORED_DEG = 180.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedCollection:
    """Shapes of a dataset that were written in random poses.

    Attributes
    ----------
    folder : Path
    names : tuple of str
        File stems, in the natural order of the folder.
    relative : ndarray, shape (N, N, 3, 3)
        True ``R_i_j`` between the posed shapes.
    axes : ndarray, shape (N, 3), or None
        Axis of each posed shape about which it looks the same from all sides: of pairs only its direction counts.
    """

    folder: Path
    names: tuple[str, ...]
    relative: FloatArray
    axes: FloatArray | None = None

    def pair_errors_deg(self, rotations: FloatArray, names: Sequence[str]) -> FloatArray:
        """Return the angle between found and true relative rotation of every pair; NaN where chirality is wrong.

        Of shapes with axes it is the angle between these.

        Parameters
        ----------
        rotations : ndarray, shape (M, 3, 3)
            ``R_common_shape`` of the shapes that were aligned.
        names : sequence of str, length M
        """
        index = [self.names.index(name) for name in names]
        pairs = list(itertools.combinations(range(len(names)), 2))
        if self.axes is not None:
            common = np.einsum("nij,nj->ni", rotations, self.axes[index])
            return np.array(
                [np.degrees(np.arccos(np.clip(common[a] @ common[b], -1.0, 1.0))) for a, b in pairs]
            )
        return np.array(
            [
                rotation_angle_deg(rotations[a].T @ rotations[b], self.relative[index[a], index[b]])
                for a, b in pairs
            ]
        )

    def figures(self, rotations: FloatArray, names: Sequence[str]) -> Record:
        """Return how right an alignment is.

        Parameters
        ----------
        rotations : ndarray, shape (M, 3, 3)
        names : sequence of str, length M

        Returns
        -------
        dict
            ``shapes``, ``pairs``; ``median_deg``, ``worst_deg`` and ``gross`` of the pairs whose chirality is right
            (NaN if there is none), ``mirrored``: pairs of wrong chirality; ``within_10`` and ``within_20``: shapes.
        """
        errors = self.pair_errors_deg(rotations, names)
        right = errors[~np.isnan(errors)]
        shapes = self.shape_errors_deg(rotations, names)
        return {
            "shapes": len(names),
            "pairs": len(errors),
            "median_deg": float(np.median(right)) if len(right) else float("nan"),
            "worst_deg": float(right.max()) if len(right) else float("nan"),
            "gross": int((right > GROSS_DEG).sum()),
            "mirrored": int(np.isnan(errors).sum()),
            "within_10": int((shapes <= 10).sum()),
            "within_20": int((shapes <= 20).sum()),
        }

    def shape_errors_deg(self, rotations: FloatArray, names: Sequence[str]) -> FloatArray:
        """Return each shape's error for the gauge that puts most shapes within 20 degrees (ties: least median).

        Parameters
        ----------
        rotations : ndarray, shape (M, 3, 3)
        names : sequence of str, length M

        Returns
        -------
        ndarray, shape (M,)
            Degrees; :data:`MIRRORED_DEG` where the chirality is wrong.
        """
        index = np.array([self.names.index(name) for name in names])
        found = np.swapaxes(rotations, 1, 2)[:, None] @ rotations[None]
        errors = rotation_angle_deg(found, self.relative[np.ix_(index, index)])
        errors = np.where(np.isnan(errors), MIRRORED_DEG, errors)
        best = max(errors, key=lambda row: ((row <= 20).sum(), -np.median(row)))
        return np.asarray(best)


def pose_collection(
    dataset: Dataset,
    chosen: IntArray,
    folder: Path,
    rng: np.random.Generator,
    *,
    axis: Sequence[float] | None = None,
) -> PosedCollection:
    """Write shapes of a dataset in uniformly random poses.

    Parameters
    ----------
    dataset : Dataset
        With landmarks or known poses; mirrored specimens (``chirality``) have truth in O(3).
    chosen : ndarray of int
        Which of its shapes.
    folder : Path
        Gets one PLY file per shape.
    rng : numpy.random.Generator
    axis : sequence of 3 floats, optional
        Of rotational symmetry, in the frame of the dataset's known poses.
    """
    chosen = np.sort(chosen)
    group = "SO" if dataset.chirality is None else "O"
    rotations = [random_rotation(rng) for _ in chosen]
    for rotation, which in zip(rotations, chosen, strict=True):
        shape = dataset.shape(int(which))
        posed = Shape.from_arrays(shape.vertices @ rotation.T, shape.faces, name=shape.name)
        write_mesh(folder / f"{shape.name}.ply", posed)
    relative = np.empty((len(chosen), len(chosen), 3, 3))
    for a, b in itertools.product(range(len(chosen)), repeat=2):
        true = (
            np.eye(3) if a == b else dataset.rotation(int(chosen[a]), int(chosen[b]), group=group)
        )
        relative[a, b] = rotations[a] @ true @ rotations[b].T
    axes = None
    if axis is not None and dataset.rotations is not None:
        axes = np.array(
            [
                rotation @ dataset.rotations[i].T @ axis
                for rotation, i in zip(rotations, chosen, strict=True)
            ]
        )
    return PosedCollection(
        folder=folder, names=tuple(dataset.names[i] for i in chosen), relative=relative, axes=axes
    )
