"""Every example in a docstring runs, and what a newcomer calls explains itself on one screen."""

import doctest
import pydoc
from functools import partial
from importlib import import_module
from pkgutil import walk_packages
from types import FunctionType

import numpy as np
import pytest

import collalign
import data_tools
import pairwise

pytestmark = pytest.mark.usefixtures("quick_search")

#: Names that examples use without importing them.
KNOWN = {"np": np, "collalign": collalign, "pairwise": pairwise}
#: Lines of a tall terminal window.
SCREEN = 60
FUNCTIONS = {
    f"{module.__name__}.{name}": getattr(module, name)
    for module in (collalign, pairwise)
    for name in module.__all__
    if isinstance(getattr(module, name), FunctionType)
}


def examples_of(package):
    """Return the examples of all modules of a package; they may use what their module has imported."""
    names = [package.__name__]
    names += [found.name for found in walk_packages(package.__path__, f"{package.__name__}.")]
    modules = [import_module(name) for name in names if not name.endswith("__main__")]
    finder = doctest.DocTestFinder(exclude_empty=True)
    return [
        test
        for module in modules
        for test in finder.find(module, globs=vars(module) | KNOWN)
        if test.examples
    ]


def complaints(test):
    """Return what is wrong with an example; nothing where it runs as it says."""
    said = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    return "".join(said)


EXAMPLES = [test for package in (data_tools, pairwise, collalign) for test in examples_of(package)]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return tmp_path_factory.mktemp("examples") / "store.sqlite"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_the_example_runs(example, store, monkeypatch):
    """Examples of what reads a result align the same three chairs; what one has matched the next ones find."""
    if ".tools." in example.name:
        monkeypatch.setattr(
            collalign, "align_collection", partial(collalign.align_collection, store=store)
        )
    assert not complaints(example)


def test_a_wrong_example_is_noticed():
    wrong = doctest.DocTestParser().get_doctest(
        ">>> int(np.sum([1, 1]))\n3\n", dict(KNOWN), "wrong", None, None
    )
    assert "Expected:\n    3\nGot:\n    2" in complaints(wrong)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_explains_itself(name):
    function = FUNCTIONS[name]
    text = pydoc.plain(pydoc.render_doc(function))
    assert ">>> " in text
    assert len(text.splitlines()) <= SCREEN
    assert max(map(len, text.splitlines()[3:])) <= 120
