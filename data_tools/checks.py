"""Checks of option values, one sentence per kind; every class of options uses them at its door."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from data_tools.errors import OptionsError


def check_choice(name: str, value: object, choices: Collection[str]) -> None:
    """Refuse a value that is none of the choices.

    Raises
    ------
    OptionsError
    """
    if value not in choices:
        raise OptionsError(f"{name}: expected one of {', '.join(choices)}, got {value!r}")


def check_count(name: str, value: object, *, lower: int) -> None:
    """Refuse what is no integer of at least ``lower``; true and false are none.

    Raises
    ------
    OptionsError
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lower:
        raise OptionsError(f"{name}: expected an integer of at least {lower}, got {value!r}")


def check_flag(name: str, value: object) -> None:
    """Refuse what is neither true nor false.

    Raises
    ------
    OptionsError
    """
    if not isinstance(value, bool):
        raise OptionsError(f"{name}: expected true or false, got {value!r}")


def check_number(
    name: str, value: object, *, lower: float = 0.0, upper: float = math.inf, positive: bool = False
) -> None:
    """Refuse what is no finite number from ``lower`` to ``upper``; with ``positive``, ``lower`` itself as well.

    Raises
    ------
    OptionsError
    """
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not lower <= value <= upper or (positive and value == lower):  # type: ignore[operator]
        limits = f"{'more than' if positive else 'at least'} {lower:g}"
        limits += f" and at most {upper:g}" if math.isfinite(upper) else ""
        raise OptionsError(f"{name}: expected a number of {limits}, got {value!r}")
