"""What evidence says about the poses of a pair: one table of weights, from many kinds of evidence to log-odds.

Every kind of evidence is a disagreement whose noise level nobody knows and which differs from pair to pair, so it
counts by its logarithm (the profile likelihood of the level), and only differences between the poses of one pair
count. The weights say how independent and how telling the kinds are: a conditional logit over the poses of a pair.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray

#: Kinds of evidence of a pose, in the order of the columns of ``Pair.evidence``.
EVIDENCE = (
    "energy",  # of the samples' best one-to-one match at the pose
    "surface",  # mean squared distance of closest points, normals included
    "normals",  # mean 1 - cosine of the normals of points that the map matches
    "curvature",  # the map's, as in collalign.nonrigid.evidence.Evidence
    "commutativity",
    "roughness",
    "orientation",  # times the determinant of the pose, so that 1 is right for mirrored poses too
)
#: Log-odds lost per unit of the logarithm of each disagreement: a conditional logit of which pose of a pair is within
#: 25 deg of the landmarks', over the 190 pairs each of SHREC07's humans, ants, armadillos and glasses, about 27 poses
#: a pair, rounded. Orientation adds nothing to the others there. ``python -m experiments calibrate evidence`` fits
#: them again, as well as without each class.
WEIGHTS = {
    "energy": 4.0,
    "surface": 1.8,
    "normals": 3.0,
    "curvature": 2.7,
    "commutativity": 3.6,
    "roughness": 3.8,
}
#: Floor of a disagreement inside its logarithm.
FLOOR = 1e-3


def evidence_score(evidence: FloatArray) -> FloatArray:
    """Return the log-odds of poses of one pair up to a constant, shape (m,).

    Parameters
    ----------
    evidence : ndarray, shape (m, 7)
        Columns as :data:`EVIDENCE` names them; NaN where unknown, which says nothing.
    """
    columns = [EVIDENCE.index(kind) for kind in WEIGHTS]
    logs = np.log(np.maximum(evidence[:, columns], FLOOR))
    return np.asarray(-np.nan_to_num(logs) @ np.array(list(WEIGHTS.values())))
