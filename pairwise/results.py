"""What the pairwise functions return: frozen records whose arrays are read-only and whose failed numbers are NaN."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from data_tools.arrays import FloatArray, IntArray, one_line

if TYPE_CHECKING:
    from pairwise.certificates.certificate import Certificate


from enum import Enum


class Status(Enum):
    """How an iterative computation ended; whatever it says, the bounds that come with it are valid.

    ``status.name`` is stable and meant for scripts, ``status.value`` is for people.
    """

    CONVERGED = "Converged to the requested tolerance."
    PROVEN_OPTIMAL = "The energy equals a verified lower bound to the requested tolerance: no better pose exists."
    LOCAL_OPTIMUM = (
        "Locally optimal; no proof that no better pose exists; "
        "certify=True (--certify) tries to prove it."
    )
    ITERATION_LIMIT = (
        "Stopped at the iteration limit: the bound is valid but loose. Raise max_iterations."
    )
    TIME_LIMIT = (
        "Stopped at the time limit: the answer is the best found so far. Raise time_limit_s."
    )
    STALLED = (
        "No further progress in floating-point arithmetic: the bound is valid. "
        "Loosen tol or rescale the points."
    )
    FAILED = "No usable answer: the numbers are NaN. Check the input for extreme scales, or try another solver."


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One locally optimal pose of the source on the target.

    Attributes
    ----------
    R_target_source : ndarray, shape (d, d)
        Takes source coordinates to target coordinates.
    map_target_source : ndarray of int, shape (k,)
        Index on the target of each source point; -1 where it may stay unmatched and does.
    energy : float
        Sum of squared distances, in squared units of the points (plus the constant costs of the invariants).
    reflected : bool
        Whether the rotation block (the first three or two coordinates) has determinant -1.
    origin : str
        What found it: ``"search"``, ``"axes"``, ``"around"``, ``"relaxation"``, ``"start"``, ...
    translation : ndarray, shape (d,), or None
        Added to the rotated source's points; None unless it was asked for.
    """

    R_target_source: FloatArray
    map_target_source: IntArray
    energy: float
    reflected: bool
    origin: str
    translation: FloatArray | None = None

    __repr__ = one_line


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchResult:
    """The best pose found for a pair, its alternatives, and what is proven about it.

    Attributes
    ----------
    R_target_source : ndarray, shape (d, d)
    map_target_source : ndarray of int, shape (k,)
    energy : float
        Sum of squared distances of the matched points at this pose, plus constant costs.
    lower_bound : float
        No pose has a smaller energy; 0 for an exact match, NaN where nothing else was certified.
    candidates : tuple of Candidate
        The distinct poses found, the best one first, which is the answer itself.
    status : Status
        ``PROVEN_OPTIMAL`` only where the answer has the energy that is proven; ``TIME_LIMIT`` where the limit stopped
        the relaxation or the proof.
    translation : ndarray, shape (d,), or None
        Added to the rotated source's points; None unless it was asked for.
    certificate : Certificate or None
        Of the relaxation, where one was solved.
    log : tuple of str
        What was done, one sentence a step: search, relaxation, proof, each with its size and how it ended.
    """

    R_target_source: FloatArray
    map_target_source: IntArray
    energy: float
    lower_bound: float
    candidates: tuple[Candidate, ...]
    status: Status
    translation: FloatArray | None = None
    certificate: Certificate | None = None
    log: tuple[str, ...] = ()

    __repr__ = one_line


@dataclass(frozen=True, kw_only=True, eq=False)
class RelaxationResult:
    """The solution of a convex relaxation of Procrustes matching.

    Attributes
    ----------
    value : float
        The primal value that the solver reached: an estimate of the relaxation's optimum, not a bound by itself.
    lower_bound : float
        Proven by ``certificate``: at most the optimum of the matching energy. NaN where there is no certificate.
    R : ndarray, shape (d, d)
        E[R] in the reading of X as probabilities.
    X : ndarray, shape (n, k)
        Probability that source point j goes to target point i.
    C : ndarray, shape (r, r)
        ``E[[R][R]^T]`` over the free entries of R, in column-major order.
    B : ndarray, shape (k, r, n)
        ``X_ij E[[R] | j -> i]`` of each source point.
    status : Status
    certificate : Certificate or None
        The dual variables that prove ``lower_bound``; check it with :func:`pairwise.verify_certificate`.
    """

    value: float
    lower_bound: float
    R: FloatArray
    X: FloatArray
    C: FloatArray
    B: FloatArray
    status: Status
    certificate: Certificate | None = None

    __repr__ = one_line
