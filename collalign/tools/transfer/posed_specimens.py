"""The specimens of a collection as a transfer needs them: surfaces in the common frame, and who gets no landmarks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from collalign.output.collection import Collection
from collalign.products.trust import DOUBT
from collalign.registration.surface import RegistrationSurface, nearest_on, with_cloud_rim
from collalign.tools.correspond import DenseCorrespondence
from collalign.tools.transfer.result import (
    DOUBTFUL_POSE,
    NO_COUNTERPART,
    NOT_REACHED,
    NOT_REGISTERED,
)
from data_tools.arrays import FloatArray, rms_length
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions
from data_tools.poses import moved_by
from data_tools.surface.closest import lies_beyond

#: Farthest points by which the size of a specimen is measured, which says how far from its rim it has nothing.
_NUM_RIM_POINTS = 300


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecimenSurface:
    """A specimen on which landmarks are predicted, in the common frame.

    Attributes
    ----------
    row : int
        Of the dense correspondence.
    surface : RegistrationSurface
    normals : ndarray, shape (w, 3)
        At its vertices.
    copy : ndarray, shape (v, 3)
        Of the mean.
    fits : dict of int to pair of ndarray
        By template, where rigid fits of its surroundings take its landmarks, (l, 3), and their misfits, (l,).
    """

    row: int
    surface: RegistrationSurface
    normals: FloatArray
    copy: FloatArray
    fits: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)


class PosedSpecimens:
    """Specimens in the common frame of a collection.

    Parameters
    ----------
    collection : Collection
    dense : DenseCorrespondence
        Of its shapes.

    Attributes
    ----------
    rows : dict of str to int
        Those that are registered, by their rows of the correspondence.
    radius : float
        Root mean square radius of the mean.
    """

    def __init__(self, collection: Collection, dense: DenseCorrespondence) -> None:
        self.collection, self.dense = collection, dense
        self.rows = {name: row for row, name in enumerate(dense.names)}
        centred = dense.mean - dense.mean.mean(axis=0)
        self.radius = rms_length(centred)

    def abstention(self, name: str) -> str | None:
        """Return why a specimen gets no landmarks; None where it does."""
        if name not in self.rows:
            return NOT_REGISTERED
        return DOUBTFUL_POSE if self.is_doubtful(name) else None

    def is_doubtful(self, name: str) -> bool:
        """Return whether the pose of a specimen is in doubt."""
        return bool(self.collection.confidence[self.collection.index(name)] < DOUBT)

    def surface(self, name: str) -> RegistrationSurface:
        """Read a specimen's surface, as its file has it, in the common frame."""
        at = self.collection.index(name)
        cleaning = CleaningOptions(inner=self.collection.options.cleaning.inner).again
        shape = read_shape(self.collection.file(at), cleaning, name=name)
        shape = shape.transformed(self.collection.transforms[at])
        return with_cloud_rim(RegistrationSurface.from_shape(shape, _NUM_RIM_POINTS))

    def look_at(self, name: str) -> SpecimenSurface:
        """Read a specimen on which landmarks are to be predicted."""
        surface, row = self.surface(name), self.rows[name]
        return SpecimenSurface(
            row=row,
            surface=surface,
            normals=surface.normals(surface.vertices),
            copy=self.dense.completed[row],
        )

    def scale(self, name: str) -> float:
        """Return the length in the common frame of one unit of a specimen's file."""
        return float(self.collection.scales[self.collection.index(name)])

    def posed(self, name: str, points: FloatArray) -> FloatArray:
        """Take points of a specimen's file to the common frame."""
        return moved_by(self.collection.transforms[self.collection.index(name)], points)

    def in_file(self, name: str, points: FloatArray) -> FloatArray:
        """Take points of the common frame to a specimen's file."""
        transform = self.collection.transforms[self.collection.index(name)]
        return moved_by(np.linalg.inv(transform), points)


def why_lost(surface: RegistrationSurface, points: FloatArray) -> NDArray[np.str_]:
    """Return why points that are known have no place on a surface, shape (l,); empty where they have one."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    distances, on_rim = nearest_on(surface, np.where(known[:, None], points, surface.vertices[0]))
    beyond = known & lies_beyond(distances, on_rim, surface.radius)
    return np.where(beyond, np.where(on_rim, NO_COUNTERPART, NOT_REACHED), "")
