"""Certificates: the dual variables of a relaxation, saved without pickle and checked by independent code."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """Dual variables of a relaxation, which prove a lower bound of the matching energy to anybody.

    Attributes
    ----------
    kind : {"pm-sdp", "quaternion", "tight"}
        Which relaxation's dual the arrays belong to.
    arrays : dict of str to ndarray
        The dual variables, and the pattern, group, weights, candidates and constant costs they are for.
    problem_hash : str
        SHA-256 of the problem's arrays, so that a certificate of another problem is refused.
    bound : float
        The lower bound that the solver claims; the verifier recomputes its own.
    """

    kind: str
    arrays: dict[str, FloatArray]
    problem_hash: str
    bound: float
