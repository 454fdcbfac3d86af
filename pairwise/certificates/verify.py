"""Checks certificates without the solvers: is it for this problem, and does it prove what it claims."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_points
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread
from pairwise.certificates.certificate import PROBLEM_ARRAYS, Certificate, hash_problem
from pairwise.certificates.verify_pm_sdp import pm_sdp_bound

#: A recomputed bound may fall short of the claimed one by this much of the problem's scale (other BLAS, other order).
_CLAIM_TOL = 1e-9


@one_blas_thread()
def verify_certificate(
    target: ArrayLike,
    source: ArrayLike,
    certificate: Certificate,
    *,
    invariants: tuple[ArrayLike, ArrayLike] | None = None,
) -> float:
    """Check a certificate and return the lower bound of the Procrustes matching energy that it proves.

    Parameters
    ----------
    target, source : array_like, shapes (n, d) and (k, d)
        The points that the certificate is for.
    certificate : Certificate
        Brings the rest of the problem: candidates, weights, constant costs, pattern and group.
    invariants : pair of array_like, optional
        Where given, the certificate's constant costs must be the weighted squared differences of these.

    Returns
    -------
    float
        No pose of this problem has a lower energy. Rounding errors are accounted for.

    Raises
    ------
    InputError
        If the certificate is for another problem, has been changed, or does not prove what it claims.
    """
    q = as_points(target, "target")
    p = as_points(source, "source", dim=q.shape[1])
    _check_problem(q, p, certificate, invariants)
    if certificate.kind in ("quaternion", "tight"):
        from pairwise.certificates.verify_tight import tight_bound

        bound = tight_bound(q, p, certificate)
    elif certificate.kind == "pm-sdp":
        bound = pm_sdp_bound(q, p, certificate.arrays)
    else:
        raise InputError(f"certificate: unknown kind {certificate.kind!r}")
    scale = float((q**2).sum() + (p**2).sum() + np.abs(certificate.arrays["constant_cost"]).max(initial=0.0))
    if not bound >= certificate.bound - _CLAIM_TOL * (scale + abs(certificate.bound)):
        raise InputError(f"certificate: claims the bound {certificate.bound:.12g} but proves {bound:.12g}")
    return bound


def _check_problem(
    q: FloatArray, p: FloatArray, certificate: Certificate, invariants: tuple[ArrayLike, ArrayLike] | None
) -> None:
    """Refuse arrays of wrong shape, and certificates of other problems."""
    n, k, d = len(q), len(p), q.shape[1]
    arrays = certificate.arrays
    shapes = {"candidates": (n, k), "weights": (k,), "constant_cost": (n, k), "pattern": (d, d)}
    for name in PROBLEM_ARRAYS:
        if name not in arrays or arrays[name].shape != shapes.get(name, (len(arrays[name]), 2)):
            raise InputError(f"certificate: {name} is missing or does not fit {n} target and {k} source points")
    if any(values.dtype.kind == "f" and not np.isfinite(values).all() for values in arrays.values()):
        raise InputError("certificate: contains values that are not finite")
    if hash_problem(q, p, arrays) != certificate.problem_hash:
        raise InputError("certificate: is for another problem (the hash of points and options differs)")
    if invariants is not None:
        h, g = (as_points(values, "invariants") for values in invariants)
        cost = ((h[:, None, :] - g[None, :, :]) ** 2).sum(axis=2) * arrays["weights"]
        if cost.shape != (n, k) or not np.allclose(cost, arrays["constant_cost"], rtol=1e-12, atol=1e-300):
            raise InputError("certificate: is for other invariants")
