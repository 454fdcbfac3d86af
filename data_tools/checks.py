"""Checks of option values, one sentence per kind; every class of options uses them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from data_tools.errors import OptionsError

OptionsT = TypeVar("OptionsT")

_hints_of = cache(get_type_hints)


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
    is_number = (
        isinstance(value, int | float | np.number)
        and not isinstance(value, bool)
        and math.isfinite(value)
    )
    if not is_number or not lower <= value <= upper or (positive and value == lower):  # type: ignore[operator]
        limits = f"{'more than' if positive else 'at least'} {lower:g}"
        limits += f" and at most {upper:g}" if math.isfinite(upper) else ""
        raise OptionsError(f"{name}: expected a number of {limits}, got {value!r}")


def as_options(
    name: str,
    given: OptionsT | Mapping[str, Any] | None,
    kind: type[OptionsT],
    keywords: Mapping[str, Any] | None = None,
) -> OptionsT:
    """Return options of a class: as they are, or made of a table of names and values, lists for tuples as in JSON.

    Parameters
    ----------
    name : str
        The argument, for messages.
    given : object of ``kind``, mapping or None
        None stands for the defaults.
    kind : type
        A dataclass of options.
    keywords : mapping, optional
        Options by name, which win.

    Raises
    ------
    OptionsError
        If it is neither, or an option is unknown, in which case a similar one is named.
    """
    entries = dict(keywords or {})
    if isinstance(given, Mapping):
        entries = {**given, **entries}
        given = None
    elif given is not None and type(given) is not kind:
        raise OptionsError(f"{name}: expected a table of options or {kind.__name__}, got {given!r}")
    known = [one.name for one in fields(kind)]  # type: ignore[arg-type]
    for entry in entries:
        if entry not in known:
            raise OptionsError(
                f"{name}: there is no option {entry!r}{suggested_option(entry, kind)}"
            )
    values = {
        entry: tuple(value) if isinstance(value, list) else value
        for entry, value in entries.items()
    }
    return kind(**values) if given is None else replace(given, **values)  # type: ignore[type-var]


def meant(name: object, known: Iterable[str], *, most: int = 1) -> str:
    """Return the words that name what somebody may have meant; none where nothing is similar."""
    return did_you_mean(get_close_matches(str(name), list(known), n=most))


def did_you_mean(names: Sequence[str]) -> str:
    """Return the words that name what may be meant; none of no name."""
    return f"; did you mean {' or '.join(map(repr, names))}?" if names else ""


def suggested_option(name: str, *kinds: Any) -> str:
    """Return the words that help somebody whose option none of some classes of options has.

    An option of another level is named with the table that it belongs to, and one of another function with what
    :attr:`advice` of a class says of it. Else a similar option of any level is named, or nothing.
    """
    advice = {key: text for kind in kinds for key, text in getattr(kind, "advice", {}).items()}
    if name in advice:
        return f"; {advice[name]}"
    hints = {key: hint for kind in kinds for key, hint in _hints_of(kind).items()}
    below = {
        one.name: key for key, hint in hints.items() if is_dataclass(hint) for one in fields(hint)
    }
    if name in below:
        return f"; it belongs to {below[name]}: use {below[name]}={{{name!r}: ...}}"
    own = [one.name for kind in kinds for one in fields(kind)]
    if similar := get_close_matches(name, [*own, *below], n=1):
        (found,) = similar
        return (
            meant(name, own)
            if found in own
            else f"; did you mean {below[found]}={{{found!r}: ...}}?"
        )
    return ""


def check_kinds(options: Any) -> None:
    """Check the options whose annotations say all: one of some words, true or false, options that may be a table.

    Raises
    ------
    OptionsError
        Naming the option.
    """
    kind: Any = type(options)
    for name, hint in _hints_of(kind).items():
        value = getattr(options, name)
        if get_origin(hint) is Literal:
            check_choice(name, value, get_args(hint))
        elif hint is bool:
            check_flag(name, value)
        elif isinstance(hint, type) and is_dataclass(hint):
            object.__setattr__(options, name, as_options(name, value, hint))
