"""Names as somebody wrote them, in a table, a file or an option, and the shapes that are meant by them."""

from __future__ import annotations

import logging
import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import TypeAlias, TypeVar

from data_tools.checks import did_you_mean, meant
from data_tools.errors import InputError
from data_tools.io.files import composed
from data_tools.notes import listed

ValueT = TypeVar("ValueT")
_Key: TypeAlias = tuple[str, ...]

#: The command line shows what is said below "collalign".
_LOG = logging.getLogger("collalign.names")
#: Names that a message offers.
MOST_NEAREST = 3
#: What ends the name of a file: of a mesh, a picture, landmarks.
_ENDING = re.compile(r"(\.mrk)?\.[A-Za-z][A-Za-z0-9]{0,4}$")
#: A number that a spreadsheet wrote with decimals.
_WHOLE = re.compile(r"(\d+)[.,]0+")
#: Numbers, words, and single signs; blanks, hyphens, dashes, minus signs and underscores only separate.
_TOKENS = re.compile(r"\d+|[^\W\d_]+|[^\w\s\-\u2010-\u2015\u2212]")


def match_names(asked: Iterable[str], known: Iterable[str]) -> dict[str, str]:
    """Return which known name is meant by each of some names, where one alone can be.

    A name agrees exactly, perhaps behind folders or before the ending of a file. Else it agrees nearly: up to leading
    zeros, decimals of a spreadsheet (``1.0``), case, blanks, hyphens, underscores and Unicode forms. Else by its
    folder: ``skull`` or ``AMNH 100`` for ``AMNH 100/skull``, and ``AMNH 100/landmarks`` for ``AMNH 100``.

    Parameters
    ----------
    asked, known : iterable of str

    Returns
    -------
    dict of str to str
        Without names by which several or none are meant. What only nearly agrees is not taken either where another
        name means the same shape.
    """
    index, asked = _Index(known), [*dict.fromkeys(asked)]
    exact = {name: found for name in asked if (found := index.exact(name)) is not None}
    near = {
        name: hits[0] for name in asked if name not in exact and len(hits := index.near(name)) == 1
    }
    claims = Counter([*{*exact.values()}, *near.values()])
    near = {name: found for name, found in near.items() if claims[found] == 1}
    return {name: found for name in asked if (found := exact.get(name, near.get(name))) is not None}


def known_names(
    argument: str, asked: Iterable[str], known: Iterable[str], *, kind: str = "shape"
) -> dict[str, str]:
    """Return which known name is meant by each of some names, and warn of those that only nearly agree.

    Parameters
    ----------
    argument : str
        The option or file that has the names, for messages.
    asked, known : iterable of str
        See :func:`match_names`.
    kind : str
        What is called so, for messages.

    Raises
    ------
    InputError
        If by a name none or several of the known ones are meant; those nearest to it are named.
    """
    asked, known = [*dict.fromkeys(asked)], [*known]
    found = match_names(asked, known)
    for name in sorted({*asked} - {*found}):
        advice = nearest_names(name, known) or f"; there are {listed(known) or 'none'}"
        raise InputError(f"{argument}: no {kind} is called {name!r}{advice}")
    warn_of_near(argument, found)
    return found


def warn_of_near(argument: str, found: Mapping[str, str]) -> None:
    """Warn of matched names that only nearly agree."""
    if near := nearly(found):
        _LOG.warning("%s: %s", argument, taken_as(near))


def by_known_names(
    argument: str, given: Mapping[str, ValueT], known: Iterable[str]
) -> dict[str, ValueT]:
    """Return values by the names of shapes, of values by names that nearly agree; see :func:`known_names`."""
    found = known_names(argument, given, known)
    return {found[name]: value for name, value in given.items()}


def nearly(found: Mapping[str, str]) -> dict[str, str]:
    """Return those of some matched names that are not the shape's own, nor its file."""
    return {name: one for name, one in found.items() if one not in _forms(name)}


def taken_as(near: Mapping[str, str]) -> str:
    """Return the words that say what some names were taken as."""
    return listed([f"{name!r} is taken as {one!r}" for name, one in near.items()])


def nearest_names(name: str, known: Iterable[str]) -> str:
    """Return the words that name the shapes somebody may have meant; none where nothing is similar."""
    known = [*known]
    return did_you_mean(_Index(known).near(name)[:MOST_NEAREST]) or meant(
        name, known, most=MOST_NEAREST
    )


class _Index:
    """Known names by what they have in common with others."""

    def __init__(self, known: Iterable[str]) -> None:
        self._known = {composed(name): name for name in known}
        self._by_key, self._by_folder = (
            defaultdict[_Key, list[str]](list),
            defaultdict[_Key, list[str]](list),
        )
        for name, own in self._known.items():
            self._by_key[name_key(name)].append(own)
            folder, sign, last = name.rpartition("/")
            for part in (folder, last) if sign else ():
                self._by_folder[name_key(part)].append(own)

    def exact(self, name: str) -> str | None:
        """Return the known name that a name is, perhaps as the path of a file."""
        return next((self._known[form] for form in _forms(name) if form in self._known), None)

    def near(self, name: str) -> list[str]:
        """Return all known names with which a name nearly agrees."""
        forms = [*_forms(name)]
        for form in forms:
            if (key := name_key(form)) and key in self._by_key:
                return self._by_key[key]
        *_, folder, _ = "", *forms[min(1, len(forms) - 1)].split("/")
        if folder:
            return self._by_key.get(name_key(folder), [])
        return next((found for form in forms if (found := self._by_folder.get(name_key(form)))), [])


def _forms(name: str) -> Iterator[str]:
    """Yield a name, and what it is without leading folders and the ending of a file, the longest first."""
    yield composed(name)
    parts = [
        part for part in re.split(r"[\\/]", composed(name).strip()) if part not in ("", ".", "..")
    ]
    for at in range(len(parts)):
        tail = "/".join(parts[at:])
        yield tail
        yield _ENDING.sub("", tail)


def name_key(name: str) -> tuple[str, ...]:
    """Return what names that nearly agree have in common: words and numbers in their order."""
    text = unicodedata.normalize("NFKC", name).casefold().strip()
    text = whole[1] if (whole := _WHOLE.fullmatch(text)) else text
    key: list[str] = []
    for token in _TOKENS.findall(text):
        if key and token.isalpha() and key[-1].isalpha():
            key[-1] += token
        else:
            key.append(token.lstrip("0") or "0" if token.isdecimal() else token)
    return tuple(key)
