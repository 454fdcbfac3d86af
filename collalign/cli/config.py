"""Options, and what the caller knows of shapes and pairs, from files and words, taken as written or refused."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from cyclopts import App, ArgumentCollection
from cyclopts.config import Toml

from data_tools.errors import OptionsError
from data_tools.io.files import read_toml

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
