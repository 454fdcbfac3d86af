"""Which places lie where a surface has nothing: beyond its rim, or far from it."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import BoolArray, FloatArray

#: A place lies beyond a surface if the nearest one on the surface is on its rim and farther than the first of these,
#: or farther than the second wherever it is; in root mean square radii of the surface.
BEYOND_RIM, FAR = 0.05, 0.25


def lies_beyond(distances: FloatArray, on_rim: BoolArray, radius: float) -> BoolArray:
    """Return which places lie where a surface has nothing, by what is nearest to them.

    Parameters
    ----------
    distances : ndarray, shape (q,)
        From each place to the nearest one of the surface.
    on_rim : ndarray of bool, shape (q,)
        Whether that is on the surface's rim.
    radius : float
        Root mean square radius of the surface.
    """
    return np.asarray(distances > radius * np.where(on_rim, BEYOND_RIM, FAR))
