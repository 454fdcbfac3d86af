"""What evidence says about a map of two surfaces: its score, and how far the chosen one can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray

#: Weight of the logarithm of the stretch.
STRETCH_WEIGHT = 0.5
#: Floor of a disagreement inside its logarithm.
FLOOR = 1e-3
#: Weights of the logarithms of what the best pose leaves, beside 1 for commutativity and roughness: their ratios in
#: ``CANDIDATE_WEIGHTS`` of ``candidate_model.py``.
NORMALS_WEIGHT, SURFACE_WEIGHT = 0.8, 0.5
#: Weight of the logarithm of what does not fit across limbs.
LIMB_WEIGHT = 3.0
#: A point is in place within this distance of its true place, in units of sqrt(area). A map is right if its points
#: are nearer in the mean.
NEAR = 0.1
#: Least share of agreeing candidates inside a logarithm.
LEAST_AGREEMENT = 0.02
#: Weights of agreement, lead, and the negative logarithm of commutativity, and the constant: a logistic model of
#: whether a candidate is right (``python -m experiments calibrate maps``).
MAP_WEIGHTS, MAP_CONSTANT = (5.8, 0.7, 1.7), -7.7
#: Weights of the logarithm of agreement at a point, of the negative logarithm of the distance at which it comes back,
#: and of the log-odds of the whole map, and the constant.
POINT_WEIGHTS, POINT_CONSTANT = (1.75, 0.2, 0.3), 1.65
#: No confidence is stated beyond this, and none beyond the other where nothing tells left from right.
MOST_CONFIDENT_MAP, WITHOUT_SIDES = 0.99, 0.5


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """How well a map of the dense samples agrees with what the shapes are.

    Attributes
    ----------
    curvature : float
        1 - correlation of the smoothed mean curvatures at matched points; NaN without normals.
    commutativity : float
        Share of the functional map that does not commute with the two Laplacians, in [0, 1].
    roughness : float
        Mean squared difference between the target's low functions at the images and the smooth functions that the
        functional map makes of them: a map that is torn, or turned over in part, cannot be smooth.
    orientation : float
        Correlation of the orientation forms: near 1 keeps left and right, near -1 swaps them, near 0 mixes them; NaN
        without normals.
    stretch : float
        Squared distances of neighbouring samples' images over those of the samples, the mean of both ways: a map that
        is torn takes neighbours far apart.
    normals : float
        Mean of 1 - cosine of matched normals at the rotation that the map asks for; NaN where no pose was asked.
    surface : float
        Mean squared distance of closest points with normals there; NaN likewise.
    limbs : float
        Share of the extent across the ends of limbs that no rotation of a neighbourhood explains: a half turn about
        the long axis of a body leaves much. NaN where it was not asked.
    """

    curvature: float
    commutativity: float
    roughness: float
    orientation: float
    stretch: float = float("nan")
    normals: float = float("nan")
    surface: float = float("nan")
    limbs: float = float("nan")

    @property
    def score(self) -> float:
        """Logarithms of the map's disagreements plus what the orientation leaves open; the lower the better.

        Curvature counts twice, because it alone tells the sides of an intrinsically symmetric surface apart.
        """
        total = np.log(max(self.commutativity, FLOOR)) + np.log(max(self.roughness, FLOOR))
        if np.isfinite(self.curvature):
            total += 2.0 * np.log(max(self.curvature, FLOOR))
        if np.isfinite(self.stretch):
            total += STRETCH_WEIGHT * np.log(max(self.stretch, FLOOR))
        if np.isfinite(self.orientation):
            total += 1.0 - abs(self.orientation)
        if np.isfinite(self.normals):
            total += NORMALS_WEIGHT * np.log(max(self.normals, FLOOR))
            total += SURFACE_WEIGHT * np.log(max(self.surface, FLOOR))
        if np.isfinite(self.limbs):
            total += LIMB_WEIGHT * np.log(max(self.limbs, FLOOR))
        return float(total)


def map_terms(agreement: float, lead: float, evidence: Evidence) -> FloatArray:
    """Return what :func:`map_probability` weighs of a map, shape (3,).

    Parameters
    ----------
    agreement, lead : float
        As :func:`collalign.nonrigid.portfolio.standing` gives them.
    evidence : Evidence
    """
    return np.array([agreement, lead, -np.log(max(evidence.commutativity, FLOOR))])


def map_probability(terms: FloatArray, *, knows_sides: bool) -> float:
    """Return the probability that a map is right: that its mean error is below :data:`NEAR`.

    Parameters
    ----------
    terms : ndarray, shape (3,)
        As :func:`map_terms` gives them.
    knows_sides : bool
        Whether normals tell left from right.
    """
    chance = float(1.0 / (1.0 + np.exp(-(terms @ MAP_WEIGHTS + MAP_CONSTANT))))
    return min(chance, MOST_CONFIDENT_MAP if knows_sides else WITHOUT_SIDES)


def point_probability(terms: FloatArray, whole: float, *, knows_sides: bool) -> FloatArray:
    """Return the probability of each point to be within :data:`NEAR` of its true place, shape (s,).

    Parameters
    ----------
    terms : ndarray, shape (s, 2)
        As :func:`collalign.nonrigid.portfolio.point_terms` gives them.
    whole : float
        Probability of the map.
    knows_sides : bool
        As for :func:`map_probability`.
    """
    most = MOST_CONFIDENT_MAP if knows_sides else WITHOUT_SIDES
    score = (
        np.column_stack([terms, np.full(len(terms), np.log(whole / (1.0 - whole)))]) @ POINT_WEIGHTS
    )
    return np.asarray(np.minimum(1.0 / (1.0 + np.exp(-score - POINT_CONSTANT)), most))
