"""What a calibration is, and how constants that nothing fits are tried: other values beside those of the code."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

#: Numbers that belong together are scaled together.
Constant: TypeAlias = float | tuple[float, ...]
#: Score of a collection, the more the better, with some constants changed.
Score: TypeAlias = Callable[[str, Mapping[str, Constant]], float]

#: Values that are tried, in parts of the code's; nearest first, so that equal scores leave the code as it is.
FACTORS = (1.0, 1.2, 0.85, 1.4, 0.7, 2.0, 0.5)
QUICK_FACTORS = (1.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was measured of one constant.

    Attributes
    ----------
    value : float or tuple of float
        Fitted, or best of those tried.
    now, best : float
        Mean score of the collections with the code's value, and with this one; NaN where nothing was tried.
    left_out : float
        Mean score of each collection with the value that is best on the others.
    """

    value: Constant
    now: float = math.nan
    best: float = math.nan
    left_out: float = math.nan


#: Measures constants by name: from the folder of the public collections, the names of those to be used, and whether
#: the smallest sizes will do.
Measure: TypeAlias = Callable[[Path, Sequence[str], bool], Mapping[str, Finding]]


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The constants of one estimator and how they are measured.

    Attributes
    ----------
    module : str
        Where they are.
    constants : mapping of str to float or tuple of float
        As the code has them.
    measure : callable
    collections : tuple of str
        Those that are used by default; classes that are held back for results are not among them.
    score : str
        What is compared where values are tried.
    """

    module: str
    constants: Mapping[str, Constant]
    measure: Measure
    collections: tuple[str, ...]
    score: str = ""


def scan(
    constants: Mapping[str, Constant],
    collections: Sequence[str],
    score: Score,
    *,
    quick: bool = False,
) -> dict[str, Finding]:
    """Try other values of each constant while the others stay.

    Parameters
    ----------
    constants : mapping of str to float or tuple of float
    collections : sequence of str
    score : callable
    quick : bool
    """
    factors = QUICK_FACTORS if quick else FACTORS
    now = [score(collection, {}) for collection in collections]
    found = {}
    for name, value in constants.items():
        tried = [
            [score(c, {name: scaled(value, factor)}) for c in collections] for factor in factors[1:]
        ]
        scores = np.array([now, *tried])
        best = int(scores.mean(axis=1).argmax())
        found[name] = Finding(
            value=scaled(value, factors[best]),
            now=float(scores[0].mean()),
            best=float(scores[best].mean()),
            left_out=float(
                np.mean([scores[_best_without(scores, c), c] for c in range(len(collections))])
            ),
        )
    return found


def _best_without(scores: np.ndarray, collection: int) -> int:
    return int(np.delete(scores, collection, axis=1).sum(axis=1).argmax())


def scaled(value: Constant, factor: float) -> Constant:
    """Return a constant times a factor; counts stay whole."""
    if isinstance(value, tuple):
        return tuple(factor * one for one in value)
    return round(factor * value) if isinstance(value, int) else factor * value


def constants_of(owner: Any, *names: str) -> dict[str, Constant]:
    """Return constants of a module, or options, as they are."""
    return {name: getattr(owner, name) for name in names}


@contextmanager
def patched(module: ModuleType, changed: Mapping[str, Any]) -> Iterator[None]:
    """Give constants of a module other values for a while."""
    before = {name: getattr(module, name) for name in changed}
    try:
        vars(module).update(changed)
        yield
    finally:
        vars(module).update(before)
