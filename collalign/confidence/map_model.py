"""What evidence says about a map of two surfaces: its score, and how far the chosen one can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Weight of the logarithm of the stretch, chosen on the 40 pairs of SHREC07's ants and glasses on which maps are
#: published: .5 to 1 choose the same candidates, of mean error .139 and .091; .25 .162 and .122, 0 .167 and .092.
STRETCH_WEIGHT = 0.5
#: Floor of a disagreement inside its logarithm.
FLOOR = 1e-3
#: Weights of the logarithms of what the best pose leaves, beside 1 for commutativity and roughness: their ratios in
#: :data:`collalign.confidence.candidate_model.WEIGHTS`, which were fitted on other pairs.
NORMALS_WEIGHT, SURFACE_WEIGHT = 0.8, 0.5
# ``python -m experiments calibrate maps`` tries other values of these on SCAPE and the ants of SHREC07.
#: Difference of scores at which the better candidate is taken to be right e times as often as the other.
SCORE_SCALE = 0.2
#: Score at which a candidate without rivals is as likely wrong as right, and how fast that changes.
DOUBTFUL_SCORE, DOUBT_SCALE = -9.5, 0.4


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
    coverage : float
        Share of the target's dense samples that are some point's image.
    bijectivity : float
        Share of the source's dense samples that come back, by map and inverse, to a point nearer than 0.1 sqrt(area).
    stretch : float
        Squared distances of neighbouring samples' images over those of the samples, the mean of both ways: a map that
        is torn takes neighbours far apart.
    normals : float
        Mean of 1 - cosine of matched normals at the rotation that the map asks for; NaN where no pose was asked.
    surface : float
        Mean squared distance of closest points with normals there; NaN likewise.
    """

    curvature: float
    commutativity: float
    roughness: float
    orientation: float
    coverage: float
    bijectivity: float
    stretch: float = float("nan")
    normals: float = float("nan")
    surface: float = float("nan")

    @property
    def score(self) -> float:
        """The map's own score and what its pose leaves, where one was asked, by logarithms; the lower the better."""
        if not np.isfinite(self.normals):
            return self.map_score
        left = NORMALS_WEIGHT * np.log(max(self.normals, FLOOR)) + SURFACE_WEIGHT * np.log(max(self.surface, FLOOR))
        return self.map_score + float(left)

    @property
    def map_score(self) -> float:
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
        return float(total)


def map_confidence(chosen: Evidence, score: float, rivals: Sequence[float], *, from_poses: bool) -> float:
    """Return how far a map can be trusted: its odds against its rivals, times how good it is at all.

    Without normals, and for a map that only poses lead to, it is at most one half. The scales were set on poses of
    one body and on ants, many of which it gets wrong.

    Parameters
    ----------
    chosen : Evidence
    score : float
        Of the chosen map, handicaps included; the lower the better.
    rivals : sequence of float
        Scores of the other maps that may be right.
    from_poses : bool
        Whether only poses lead to the map.
    """
    odds = np.exp(-(np.array([score, *rivals]) - score) / SCORE_SCALE)
    quality = 0.5
    if np.isfinite(chosen.orientation):
        quality = 1.0 / (1.0 + np.exp((chosen.map_score - DOUBTFUL_SCORE) / DOUBT_SCALE))
    if from_poses:
        quality = min(quality, 0.5)
    return float(min(1.0, 1.0 / odds.sum()) * quality)
