"""Options, and what the caller knows of shapes and pairs, from files and words, taken as written or refused."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from cyclopts import App, ArgumentCollection
from cyclopts.config import Toml

from collalign.console.messages import warn
from collalign.landmarks.on_surface import place_templates
from collalign.landmarks.templates import read_templates, shape_of
from collalign.products.own import Own
from collalign.wording import note_text
from data_tools.errors import CollalignError, InputError, OptionsError
from data_tools.io.files import open_regular, read_text, read_toml
from data_tools.io.listing import FolderListing
from data_tools.io.source import MAX_FILE_BYTES

#: Options of the program itself; a configuration file holds those of a command.
_OWN_OPTIONS = ("config", "verbose", "quiet", "json", "log")


class ConfigFile:
    """A TOML file with the options of a command, in the place that cyclopts gives to configurations.

    Parameters
    ----------
    path : Path
    commands : collection of str
        Names of all commands.

    Raises
    ------
    InputError
        If it cannot be read or is not TOML.
    """

    def __init__(self, path: Path, commands: Collection[str]) -> None:
        self._path = path
        self._commands = frozenset(commands)
        self._content = read_toml(path)
        self._toml = Toml(path, must_exist=True, search_parents=False, use_commands_as_keys=False)

    def __call__(self, app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
        """Give the file's values to the options that the command line leaves open.

        Raises
        ------
        OptionsError
            If an entry would be ignored: below the name of a command, a value in place of a table, an option of the
            program; or there is no such option, in which case a similar one is named.
        """
        tables = {name for argument in arguments if argument.children for name in argument.names}
        for name, value in self._content.items():
            if name in self._commands:
                raise self._misplaced(
                    name, "options stand at the top level, not below the name of a command"
                )
            if name in _OWN_OPTIONS:
                raise self._misplaced(name, "belongs on the command line")
            if f"--{name}" in tables and not isinstance(value, Mapping):
                raise self._misplaced(
                    name, f"a table of options, [{name}], is expected, not {value!r}"
                )
        from data_tools.checks import meant  # imports NumPy, which help shall not wait for

        known = {name.removeprefix("--") for argument in arguments for name in argument.names}
        for entry in _entries(self._content):
            if ".".join(entry).replace("_", "-") not in known:
                similar = meant(".".join(entry), known)
                raise OptionsError(
                    f"--config {self._path}: there is no option [{']['.join(entry)}]{similar}"
                )
        self._toml(app, commands, arguments)

    def _misplaced(self, name: str, reason: str) -> OptionsError:
        return OptionsError(f"--config {self._path}: {name!r}: {reason}")


def _entries(table: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the names that lead to each value of tables in tables."""
    for name, value in table.items():
        yield from (
            ((name, *below) for below in _entries(value))
            if isinstance(value, Mapping)
            else [(name,)]
        )


def refuse_rounding(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Refuse 24.7 where an integer is expected (cyclopts would round it), on the command line or in a file.

    Raises
    ------
    OptionsError
        Naming the option and, where there is one, the file.
    """
    for argument in arguments:
        if int not in (argument.hint, *get_args(argument.hint)):
            continue
        for token in argument.tokens:
            if "." in str(token.value):
                raise OptionsError(f"{_place(token)}: expected an integer, got {token.value}")


def _place(token: Any) -> str:
    keyword = token.keyword or "argument"
    return keyword if token.source == "cli" else f"--config {token.source}: {keyword}"


_KEYS = {"pairs", "samples", "invariants", "invariants_weight"}


def read_own(path: Path) -> tuple[Own, set[Path]]:
    """Return what a JSON file says of pairs and samples, with the invariants of a folder that it names.

    ``{"pairs": [{"target": A, "source": B, "rotations": [R], "vertices": [[0, 7]], "weight": 1}], "samples":
    {A: [0]}, "invariants": FOLDER, "invariants_weight": 0.4}``, each of which may be missing; ``vertices`` match
    those of A's file and of B's, and FOLDER, relative to the file, holds ``A.npy``.

    Returns
    -------
    own : Own
    inputs : set of Path
        The file and the folder.

    Raises
    ------
    InputError
        Naming the file, if it is not such a file, or an array cannot be read.
    """
    try:
        content = json.loads(read_text(path))
        if unknown := sorted(set(content) - _KEYS):
            raise InputError(f"there is no entry {unknown[0]!r}, only {', '.join(sorted(_KEYS))}")
        pairs = [((one["target"], one["source"]), one) for one in content.pop("pairs", [])]
        folder = path.parent / content.pop("invariants") if "invariants" in content else None
        own = Own(
            candidates={pair: one["rotations"] for pair, one in pairs if "rotations" in one},
            correspondences={pair: one["vertices"] for pair, one in pairs if "vertices" in one},
            pair_weights={pair: one["weight"] for pair, one in pairs if "weight" in one},
            invariants={} if folder is None else _arrays(folder),
            **content,
        )
    except (
        CollalignError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
        RecursionError,
    ) as error:
        reason = f"no {error} is given" if isinstance(error, KeyError) else str(error)
        raise InputError(f"{path}: {reason.removeprefix(f'{path}: ')}") from error
    return own, {path, *([] if folder is None else [folder])}


def read_marks(own: Own, path: Path, listing: FolderListing) -> tuple[Own, set[Path]]:
    """Return ``own`` with the landmarks of a file, and the file.

    Parameters
    ----------
    own : Own
    path : Path
        As :func:`collalign.landmarks.templates.read_templates` takes it.
    listing : FolderListing

    Raises
    ------
    InputError
        If it cannot be read, belongs to no shape, or its landmarks do not lie on that shape.
    """
    files = dict(zip(listing.names, listing.files, strict=True))
    placed, notes, _ = place_templates(read_templates([path], listing.names), files, ())
    for note in notes:
        warn(note_text(note))
    marks = {
        name: {
            label: point
            for label, point in zip(one.labels, one.points, strict=True)
            if not np.isnan(point).any()
        }
        for name, one in placed.items()
    }
    return replace(own, marks=marks), {shape_of(path)[1]}


def _arrays(folder: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a folder by the names of their shapes."""
    found = {}
    for file in sorted(folder.rglob("*.npy")):
        try:
            with open_regular(file, MAX_FILE_BYTES) as stream:
                found[file.relative_to(folder).with_suffix("").as_posix()] = np.load(
                    stream, allow_pickle=False
                )
        except (OSError, ValueError, EOFError) as error:
            raise InputError(f"invariants: {file} cannot be read ({error})") from error
    if not found:
        raise InputError(f"invariants: {folder} holds no NAME.npy")
    return found
