"""How a computation ended. The value of each member is a sentence that advises the user."""

from __future__ import annotations

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
