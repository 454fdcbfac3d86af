"""Certificates of the tight relaxation: the stages of a proof as arrays.

Kind "tight" or "quaternion" says which relaxation was solved; every stage says itself in which lift it is written,
because a proof may end in the quaternion lift. Arrays of stage s of a chirality c ("proper", "reflected"), in which
the source of "reflected" is ``-source`` (d = 3) or the source with its last coordinate negated (d = 2):

============================ ============ ======================================================================
name                         shape        meaning
============================ ============ ======================================================================
``c_s_allowed``              (n, k)       the matches that the stage speaks about; those missing from the next
                                          stage's are proven by this one to cost more than the bound
``c_s_target_multipliers``   (n, s, s)    B_i, symmetric; s is 10, 3 (tight, d = 3, 2) or 4, 2 (quaternion)
``c_s_source_multipliers``   (k, s, s)    A_j, symmetric
``c_s_identity_multipliers`` (b, c)       coefficients of the identities of z: allowed matches row by row, then
                                          for k < n every target point; c is 20 or 1, and 0 for quaternions
============================ ============ ======================================================================

The order of the identities is that of :func:`pairwise.tight.lift.rotation_identities`; the costs W_ij, to which the
multipliers belong, are written orthogonal to all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pairwise.certificates.certificate import Certificate, hash_problem, problem_arrays
from pairwise.problem.problem import Problem
from pairwise.tight.dual import DualStage


def make_certificate(
    problem: Problem, form: str, proofs: list[tuple[bool, tuple[DualStage, ...]]], bound: float
) -> Certificate:
    """Write down the proofs of all chiralities.

    Parameters
    ----------
    problem : Problem
    form : {"tight", "quaternion"}
    proofs : list of (reflected, stages)
    bound : float
        What they prove together.
    """
    arrays: dict[str, NDArray[Any]] = problem_arrays(problem)
    for reflected, stages in proofs:
        chirality = "reflected" if reflected else "proper"
        for number, stage in enumerate(stages):
            prefix, basis = f"{chirality}_{number}_", stage.lift.basis
            arrays[prefix + "allowed"] = stage.allowed
            arrays[prefix + "target_multipliers"] = np.tensordot(stage.target_multipliers, basis, axes=1)
            arrays[prefix + "source_multipliers"] = np.tensordot(stage.source_multipliers, basis, axes=1)
            arrays[prefix + "identity_multipliers"] = stage.identity_multipliers
    return Certificate(kind=form, arrays=arrays, problem_hash=hash_problem(problem), bound=bound)
