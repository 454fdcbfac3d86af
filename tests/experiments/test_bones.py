"""Generated bones: which of their landmarks the surface holds."""

import numpy as np

from collalign.template_landmarks.local_fit import holds
from experiments.collections.radii import OPEN
from experiments.peers.bones import landmarked_bones


def test_the_surface_holds_the_landmarks_at_the_ends_and_none_on_the_shaft():
    shapes, landmarks = landmarked_bones(2)
    for shape, places in zip(shapes, landmarks, strict=True):
        arms = shape.vertices - shape.vertices.mean(axis=0)
        unit = float(np.sqrt((arms**2).sum(axis=1).mean()))
        found = holds(places, shape.vertices, shape.faces, unit)[0]
        assert np.flatnonzero(found < OPEN).tolist() == [*range(6, 14)]
