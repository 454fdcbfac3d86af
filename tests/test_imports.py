"""Heavy packages are imported when they are needed, and one that is missing is named with the way to get it."""

import inspect
import subprocess
import sys
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

import collalign
import pairwise
from collalign.engine.run_options import RunOptions
from data_tools import errors
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import CollalignError

#: Nothing of these is needed to align shapes and to match pairs.
OPTIONAL = ("cvxpy", "clarabel", "scs", "matplotlib", "open3d", "pandas", "distributed", "dask")
ALIGN_WITHOUT = """
import sys
for name in {blocked}:
    sys.modules[name] = None  # every import of it fails
import numpy as np
import collalign, pairwise
for module in (collalign, pairwise):
    for name in module.__all__:
        getattr(module, name)
points = np.random.default_rng(0).random((30, 3))
aligned = collalign.align_collection([points, points[::-1]], progress=False, run=collalign.RunOptions(jobs=1))
assert aligned.confidence.min() > 0
"""


#: What a script imports, and what must not be loaded before it is asked for.
LAZY = """
import sys
import collalign, pairwise
own = [name for name in sys.modules if name.partition(".")[0] in ("collalign", "pairwise", "data_tools", "numpy")]
assert own == ["collalign", "pairwise"], own
from collalign import InputError, MatchResult
from pairwise import OptionsError, match
import collalign.options, data_tools.errors, pairwise.results
assert InputError is pairwise.InputError is data_tools.errors.InputError
assert MatchResult is pairwise.MatchResult is pairwise.results.MatchResult
assert "scipy" in sys.modules
"""


def test_names_are_imported_when_they_are_asked_for():
    subprocess.run([sys.executable, "-c", LAZY], check=True, timeout=600)


def test_every_error_can_be_imported_from_the_top():
    kinds = [
        kind
        for kind in vars(errors).values()
        if isinstance(kind, type) and issubclass(kind, Exception)
    ]
    assert len(kinds) > 8
    for kind in kinds:
        assert getattr(collalign, kind.__name__) is kind


class Top(dict[str, Any]):
    """The names that can be imported from collalign, and those of libraries that are imported when needed."""

    def __missing__(self, name):
        if name == "Figure":
            return object
        try:
            return getattr(collalign, name)
        except AttributeError:
            raise KeyError(name) from None


def named_types(hint):
    """Yield the classes of this project that a type hint names."""
    if isinstance(hint, type) and hint.__module__.partition(".")[0] in (
        "collalign",
        "data_tools",
        "pairwise",
    ):
        yield hint
    for part in get_args(hint):
        yield from named_types(part)


def signature_types(thing):
    """Return the classes that the signature of a function names, or the public attributes and methods of a class."""
    members = [thing]
    if isinstance(thing, type):
        public = [member for name, member in inspect.getmembers(thing) if not name.startswith("_")]
        members += [getattr(member, "fget", getattr(member, "func", member)) for member in public]
    hints = [
        get_type_hints(one, localns=Top())
        for one in members
        if isinstance(one, type) or inspect.isroutine(one)
    ]
    return {found for one in hints for hint in one.values() for found in named_types(hint)}


def not_at_the_top(names):
    """Return the classes that signatures of these names of collalign name, and that are not to be had there."""
    found = {one for name in names for one in signature_types(getattr(collalign, name))}
    return {one.__qualname__ for one in found if getattr(collalign, one.__name__, None) is not one}


def test_every_type_that_a_signature_names_is_imported_from_the_top():
    functions_and_types = [name for name in collalign.__all__ if callable(getattr(collalign, name))]
    assert len(functions_and_types) > 60
    assert not_at_the_top(functions_and_types) == set()


def test_a_type_that_is_missing_at_the_top_is_noticed(monkeypatch):
    def stray(shape: WorkingSurface): ...

    monkeypatch.setattr(collalign, "stray", stray, raising=False)
    assert not_at_the_top(["stray"]) == {"WorkingSurface"}
    assert not_at_the_top(["align_collection"]) == set()


def run_without(blocked):
    code = ALIGN_WITHOUT.format(blocked=blocked)
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=600
    )


def test_alignment_needs_no_optional_package():
    done = run_without(OPTIONAL)
    assert done.returncode == 0, done.stderr


def test_a_package_that_is_needed_is_noticed():
    assert "No module named 'scipy" in run_without(("scipy",)).stderr


def use_scheduler():
    run = RunOptions(scheduler="tcp://127.0.0.1:9")
    return collalign.align_collection([np.eye(8, 3)] * 2, run=run, progress=False)


def use_solver():
    return pairwise.solve_relaxation(np.eye(3), np.eye(3), solver="clarabel")


@pytest.mark.parametrize(
    ("package", "call", "advice"),
    [
        ("distributed", use_scheduler, "pip install 'collalign[dask]'"),
        ("cvxpy", use_solver, "pip install 'collalign[cvxpy]'"),
    ],
)
def test_a_missing_package_is_named(package, call, advice, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    for module in [name for name in sys.modules if name.startswith("collalign.engine.dask_")]:
        monkeypatch.delitem(sys.modules, module)
    with pytest.raises(CollalignError) as raised:
        call()
    assert package in str(raised.value) or "Dask" in str(raised.value)
    assert f"install it with: {advice}" in str(raised.value)


@pytest.mark.parametrize("module", [collalign, pairwise], ids=["collalign", "pairwise"])
def test_every_name_of_the_stub_is_there(module):
    for name in {*module.__all__} - {"__version__"}:
        assert getattr(module, name).__name__ == name
    assert set(dir(module)) == set(module.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = module.no_such_name
