"""Options that messages and docstrings name are there."""

import ast
import re
from pathlib import Path

import pytest

from collalign.cli import _COMMANDS, app

ROOT = Path(__file__).resolve().parents[3]
MODULES = [
    path
    for package in ("collalign", "pairwise", "data_tools")
    for path in (ROOT / package).rglob("*.py")
]
#: An option's name, but no variable of a style sheet.
OPTION = re.compile(r"(?<![\w/(-])--[a-z][a-z0-9]*(?:[.-][a-z0-9]+)*(?![\w:.-]*[:(])")
#: A call of a command, in a code block or between backquotes, on one line.
CALL = re.compile(r"collalign ([a-z]+)((?: [^`\n|]*)?)")
#: A word where a command's name belongs: after backquotes, at the beginning of a line, or after a folder of programs.
COMMAND = re.compile(r"(?:`|/bin/|^\$ |^(?=\w+ \w+ .*--))collalign ([a-z]+)\b", re.MULTILINE)
#: Of the program itself, of `python -m experiments`, of the scripts below tests, and of Dask, pip, ruff and Docker.
OTHERS = {
    *("--config", "--verbose", "--quiet", "--json", "--log", "--help", "--help-all", "--version"),
    *("--data", "--quick", "--hypothesis-seed"),
    *(
        "--only",
        "--random",
        "--stores",
        "--shapes",
        "--certificates",
        "--kills",
        "--signals",
        "--write",
    ),
    *("--nthreads", "--nworkers", "--port", "--check"),
    *("--entrypoint", "--network", "--rm"),
}


def options_of(command):
    return {
        name for argument in app[command].assemble_argument_collection() for name in argument.names
    }


@pytest.fixture(scope="module")
def commands():
    return {command: options_of(command) for command in _COMMANDS}


def unknown(text, known):
    """Return the options that a text names and that are not known."""
    return {name for name in OPTION.findall(text) if name not in set(known)}


def misplaced(text, commands):
    """Return the calls of a command with an option that it has not."""
    calls = [(name, rest) for name, rest in CALL.findall(text) if name in commands]
    return {
        f"collalign {name}{rest}" for name, rest in calls if unknown(rest, commands[name] | OTHERS)
    }


def gone(text, commands):
    """Return the commands that a text calls and that are not there."""
    return set(COMMAND.findall(text)) - set(commands)


def test_options_in_messages_and_docstrings_exist(commands):
    known = set.union(
        OTHERS, *commands.values(), {"--memory", "--pair-time", "--shape-time"}
    )  # beginnings, in help.py
    for module in MODULES:
        tree = ast.parse(module.read_text("utf-8"))
        texts = [
            n.value
            for n in ast.walk(tree)
            if isinstance(n, ast.Constant) and isinstance(n.value, str)
        ]
        assert not unknown("\n".join(texts), known), module
        assert not misplaced("\n".join(texts), commands), module
        assert not gone("\n".join(texts), commands), module


def test_wrong_names_are_noticed(commands):
    assert unknown("give --num-pionts more, or `--group`", commands["align"]) == {"--num-pionts"}
    assert not unknown("color: var(--ink); --card: #fff", commands["align"])
    assert gone("run `collalign poses OUT`, or .venv/bin/collalign algin FOLDER", commands) == {
        "poses",
        "algin",
    }
    assert not gone("`collalign align`; collalign matches pairs", commands)
    assert misplaced("`collalign status OUT --certify`", commands) == {
        "collalign status OUT --certify"
    }
    assert not misplaced("`collalign align FOLDER --out OUT --certify` and `--json`", commands)
