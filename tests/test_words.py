"""A name is one thing: no two public functions or classes share one, and words of files keep to their rooms."""

import ast
import re
from collections import defaultdict

import pytest

from tests.test_contributing import room_docstrings
from tests.test_layers import ROOT, sources

#: Called as the command line calls them, as the driver lists its steps, or as every format of an export.
CALLED_ALIKE = (
    re.compile(r"/command\.py$"),
    re.compile(r"stages/steps\.py$"),
    re.compile(r"tools/export/\w+\.py$"),
)
#: Words that rooms define, and that files may be called after, and the folders or files where they have that meaning.
HOMES = {
    "hypotheses": {"synchronization"},
    "evidence": {"stages/evidence", "stages/local_evidence", "output/evidence", "nonrigid"},
    "dense": {"pairwise/dense.py", "stages/deformation"},
    "maps": {
        "collalign/maps.py",
        "products",
        "output",
        "nonrigid",
        "stages/deformation",
        "tools/correspond",
        "tools/match",
    },
    "incomplete": {"products", "stages/incomplete", "confidence"},
    "partial": {"pairwise/partial"},
    "certify": {"tools/certify", "pairwise/pm_sdp"},
}


def public_names(modules):
    """Return where each public function and class is, of modules given by path and text."""
    found = defaultdict(list)
    for path, text in modules.items():
        if not any(alike.search(path) for alike in CALLED_ALIKE):
            for node in ast.parse(text).body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith(
                    "_"
                ):
                    found[node.name].append(path)
    return found


def strays(paths):
    """Return the files called after a word of :data:`HOMES` outside of the places where it has its meaning."""
    wrong = []
    for path in paths:
        for part in re.split(r"[/_.]", path):
            word = part if part in HOMES else part.removesuffix("s")
            if word in HOMES and not any(home in path for home in HOMES[word]):
                wrong.append((word, path))
    return wrong


def modules():
    return {file.relative_to(ROOT).as_posix(): file.read_text("utf-8") for _, file in sources()}


def test_no_two_public_things_have_one_name():
    twice = {name: paths for name, paths in public_names(modules()).items() if len(paths) > 1}
    assert twice == {}


def test_files_are_called_after_a_word_where_it_has_its_meaning():
    assert strays(modules()) == []


def defined_words(docstrings):
    """Return the words that docstrings of rooms define."""
    return {word for text in docstrings for word in re.findall(r"\*\*(\w+)\*\*:? ", text)}


def test_every_word_that_is_held_is_defined_in_a_room():
    words = defined_words(room_docstrings().values())
    assert HOMES.keys() <= words
    assert {"candidate", "part", "fixed"} <= words
    assert defined_words(["**part**: a", "*whole*: b"]) == {"part"}


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("def pose(): ...", ["pose"]),
        ("class Pose: ...\ndef _pose(): ...", ["Pose"]),
        ("def f():\n    def g(): ...", ["f"]),
    ],
)
def test_the_check_sees_public_names_alone(text, names):
    assert [*public_names({"pairwise/a.py": text})] == names


def test_the_checks_see_a_name_and_a_word_in_two_places():
    twice = public_names({"a/x.py": "def pose(): ...", "b/y.py": "class pose: ..."})
    assert twice["pose"] == ["a/x.py", "b/y.py"]
    assert not public_names({"collalign/tools/match/command.py": "def match(): ..."})
    assert strays(["collalign/engine/partial.py", "collalign/engine/impartial.py"]) == [
        ("partial", "collalign/engine/partial.py")
    ]
    assert strays(["collalign/output/certify.py", "pairwise/pm_sdp/certify.py"]) == [
        ("certify", "collalign/output/certify.py")
    ]
