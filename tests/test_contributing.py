"""CONTRIBUTING.md and the docstrings of rooms show the project as it is: files, modules."""

import ast
import re

import pytest

from tests.test_layers import ROOT, sources

TEXT = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
#: Folders from which the text names files.
BASES = tuple(
    ROOT / base
    for base in (
        "",
        "collalign",
        "data_tools/io/formats",
        "collalign/tools/variation",
        "tests",
        "experiments",
    )
)


def named(text):
    """Return what a text has in code, blocks aside."""
    return re.findall(
        r"`([^`]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    )


def exists(path):
    return any((base / path).exists() for base in BASES)


@pytest.mark.parametrize(
    "path", sorted({name for name in named(TEXT) if re.fullmatch(r"[\w/]+(\.py|/)", name)})
)
def test_every_file_and_folder_that_is_named_exists(path):
    assert exists(path), path


def room_docstrings():
    """Return what each folder of the packages says of itself, by its path."""
    folders = {file.parent for _, file in sources()}
    return {
        folder.relative_to(ROOT).as_posix(): ast.get_docstring(
            ast.parse((folder / "__init__.py").read_text("utf-8"))
        )
        for folder in sorted(folders)
    }


def described(docstring):
    """Return the modules that a docstring of a room lists, each once or more."""
    lines = re.findall(r"^\* (``\w+``(?:, ``\w+``)*):", docstring, re.MULTILINE)
    return [name for line in lines for name in re.findall(r"``(\w+)``", line)]


@pytest.mark.parametrize("room", [room for room in room_docstrings() if room != "collalign"])
def test_a_room_says_of_each_of_its_modules_what_it_is(room):
    assert sorted(described(room_docstrings()[room])) == inside(room)


def inside(room):
    """Return the names of the modules and folders of a room, sorted."""
    modules = [file.stem for file in (ROOT / room).glob("*.py") if not file.stem.startswith("__")]
    return sorted([*modules, *(file.parent.name for file in (ROOT / room).glob("*/__init__.py"))])


def test_the_checks_can_fail():
    assert not exists("collalign/nowhere.py")
    assert exists("tools/export/")
    assert described("A room.\n\n* ``a``, ``b``: two\n* **a**: a word\n") == ["a", "b"]
