"""Generated bodies of which a part is cut away, with the true map and what has no counterpart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.surface.shape import Shape
from data_tools.surface.topology import mesh_components
from experiments.generated.bipeds import Biped, template_points

#: What each cut leaves, by the places of the template; x is in front, y left, z up.
CUTS: dict[str, Callable[[FloatArray], BoolArray]] = {
    "without an arm": lambda places: np.asarray(places[:, 1] < 0.25),
    "without a forearm": lambda places: np.asarray(places[:, 1] < 0.5),
    "without a leg": lambda places: np.asarray((places[:, 1] < 0.0) | (places[:, 2] > 0.75)),
    "without the head": lambda places: np.asarray(places[:, 2] < 1.5),
    "upper body": lambda places: np.asarray(places[:, 2] > 1.0),
    "lower body": lambda places: np.asarray(places[:, 2] < 1.2),
    "torso": lambda places: np.asarray((np.abs(places[:, 1]) < 0.25) & (places[:, 2] > 0.75)),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class CutBiped:
    """A generated body of which a part is cut away.

    Attributes
    ----------
    shape : Shape
    places : ndarray of int, shape (t,)
        The vertex at each point of the template, -1 where that was cut away.
    to_template : ndarray of int, shape (v,)
        The point of the template at each vertex.
    """

    shape: Shape
    places: IntArray
    to_template: IntArray

    def true_map_from(self, source: CutBiped | Biped) -> IntArray:
        """Return the vertex of this body for each vertex of another one, shape (v_source,), -1 for none."""
        return self.places[source.to_template]


def cut_biped(body: Biped, cut: str) -> CutBiped:
    """Return what a cut of :data:`CUTS` leaves of a body: the largest piece, open where the rest was."""
    stays = CUTS[cut](template_points())[body.to_template]
    faces = body.shape.faces[stays[body.shape.faces].all(axis=1)]
    used = np.unique(faces)
    faces = np.searchsorted(used, faces)
    _, piece = mesh_components(len(used), faces)
    largest = np.flatnonzero(piece == np.bincount(piece).argmax())
    faces = faces[np.isin(faces[:, 0], largest)]
    kept = used[largest]
    new = np.full(len(body.shape.vertices), -1)
    new[kept] = np.arange(len(kept))
    shape = Shape.from_arrays(
        body.shape.vertices[kept], np.searchsorted(largest, faces), name=f"{body.shape.name} {cut}"
    )
    return CutBiped(shape=shape, places=new[body.places], to_template=body.to_template[kept])
