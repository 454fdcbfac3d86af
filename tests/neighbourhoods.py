"""Points with normals whose neighbourhoods differ."""

import numpy as np


def bumpy(num=80):
    """Points on a bumpy ellipsoid and unit vectors near its normals."""
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((num, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = directions + 0.3 * rng.standard_normal((num, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return directions * [1.0, 0.8, 0.6] * rng.uniform(0.9, 1.1, (num, 1)), normals
