"""The errors that collalign raises, and the exit code that each gives the command line.

Bad input raises at once and names the file or argument, what was found and what was expected. What happens
*inside* an iterative method is a :class:`pairwise.results.Status`, not an exception.
"""

from __future__ import annotations

import re
from typing import Any

#: Control characters, ends of lines, marks that reverse the direction of writing, and invisible ones: a file's name
#: may hold any of them, and a terminal, a log, a table or a page would obey it. Joiners (U+200C, U+200D) stay.
_UNPRINTABLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\U000e0000-\U000e007f]"
)


def printable(text: str, *, keep: str = "") -> str:
    r"""Return text whose control characters are escapes such as ``\x1b``.

    Parameters
    ----------
    text : str
    keep : str
        Control characters that stay.
    """

    def escape(found: re.Match[str]) -> str:
        return found[0] if found[0] in keep else found[0].encode("unicode_escape").decode()

    return _UNPRINTABLE.sub(escape, text)


class CollalignError(Exception):
    """Root of every error raised on purpose by the three packages.

    Attributes
    ----------
    exit_code : int
        What ``collalign`` exits with when this error reaches the command line.

    Notes
    -----
    The message is one line in which :func:`printable` has escaped the names of files.
    """

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class InputError(CollalignError, ValueError):
    """A file or an array is not what the function asks for; the message names it and says what to do."""

    exit_code = 2


class UnknownName(InputError, KeyError):
    """Nothing has this name."""

    __str__ = Exception.__str__


class UnavailableError(InputError):
    """A file cannot be read here and now: it is missing or forbidden, memory is short, a package is not installed.

    Nothing is wrong with its content as far as is known, so that another run may succeed.
    """


class OptionsError(CollalignError, ValueError):
    """An option has an impossible value, or two options exclude each other."""

    exit_code = 2


class SolveFailed(CollalignError, RuntimeError):
    """A solver ended without a usable answer and the caller asked for an exception instead of a status.

    Parameters
    ----------
    message : str
        What happened, in words that advise.
    result : Any
        The result as far as it went; its failed numbers are NaN.
    """

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result


class RunLost(CollalignError):
    """The processes or machines that did the work are gone; what was finished before is in the store."""

    exit_code = 4


class CollectionError(CollalignError):
    """A collection cannot be aligned as a whole, for instance because fewer than two shapes could be read."""

    exit_code = 2


class StoreError(CollalignError):
    """A store is damaged, of another version, or in use by another run."""

    exit_code = 2
