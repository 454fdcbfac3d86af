"""Checks of option values, one sentence per kind; every class of options uses them at its door."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection
from typing import ParamSpec, TypeVar

import numpy as np

from data_tools.errors import OptionsError

_Arguments = ParamSpec("_Arguments")
_Returned = TypeVar("_Returned")


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


def former_arguments(
    **new_names: str,
) -> Callable[[Callable[_Arguments, _Returned]], Callable[_Arguments, _Returned]]:
    """Let a function refuse arguments by the names that earlier versions had, and say the new ones.

    Parameters
    ----------
    **new_names : str
        The new name of each former one.

    Raises
    ------
    OptionsError
        When the decorated function is called with a former name.
    """

    def decorate(function: Callable[_Arguments, _Returned]) -> Callable[_Arguments, _Returned]:
        @functools.wraps(function)
        def checked(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Returned:
            for name in kwargs.keys() & new_names.keys():
                raise OptionsError(f"{name}: this argument is called {new_names[name]} now")
            return function(*args, **kwargs)

        return checked

    return decorate
