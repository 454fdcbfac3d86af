"""A name is one thing: no two public functions or classes share one."""

import ast
import re
from collections import defaultdict

from tests.test_layers import ROOT, sources

#: Called as the command line calls them, as the driver lists its steps, or as every format of an export.
CALLED_ALIKE = (
    re.compile(r"/command\.py$"),
    re.compile(r"stages/steps\.py$"),
    re.compile(r"tools/export/\w+\.py$"),
)


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


def modules():
    return {file.relative_to(ROOT).as_posix(): file.read_text("utf-8") for _, file in sources()}


def test_no_two_public_things_have_one_name():
    twice = {name: paths for name, paths in public_names(modules()).items() if len(paths) > 1}
    assert twice == {}


def test_the_check_sees_a_name_in_two_places():
    twice = public_names({"a/x.py": "def pose(): ...", "b/y.py": "class pose: ..."})
    assert twice["pose"] == ["a/x.py", "b/y.py"]
    assert not public_names({"collalign/tools/match/command.py": "def match(): ..."})
