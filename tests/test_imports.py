"""Heavy packages are imported when they are needed, and one that is missing is named with the way to get it."""

import inspect
import pkgutil
import subprocess
import sys
from types import ModuleType
from typing import Any, get_args, get_type_hints, is_typeddict

import numpy as np
import pytest

import collalign
import pairwise
from collalign.engine.run_options import RunOptions
from data_tools import errors
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import CollalignError
from tests.test_docs import reference_names
from tests.test_layers import PACKAGES


def vars_of(face):
    """Return what a module makes public, the version aside."""
    return [getattr(face, name) for name in face.__all__ if name != "__version__"]


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
        part = getattr(module, name)
        for inner in getattr(part, "__all__", ()):
            getattr(part, inner)
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
from collalign.errors import InputError
from pairwise import MatchResult, OptionsError, match
import data_tools.errors, pairwise.results
assert InputError is collalign.errors.InputError is pairwise.InputError is data_tools.errors.InputError
assert MatchResult is pairwise.results.MatchResult
assert collalign.statistics.two_block_pls
assert "scipy" in sys.modules
"""


def test_names_are_imported_when_they_are_asked_for():
    subprocess.run([sys.executable, "-c", LAZY], check=True, timeout=600)


def test_every_error_is_in_the_module_of_errors():
    kinds = [
        kind
        for kind in vars(errors).values()
        if isinstance(kind, type) and issubclass(kind, Exception)
    ]
    assert len(kinds) > 8
    for kind in kinds:
        assert getattr(collalign.errors, kind.__name__) is kind


#: The modules whose names are public.
FACES = (collalign, *(one for one in vars_of(collalign) if isinstance(one, ModuleType)), pairwise)


def shown():
    """Return all that is public or shown in the reference, of modules all classes that are theirs."""
    things = [one for face in FACES for one in vars_of(face)]
    things += map(pkgutil.resolve_name, reference_names())
    modules = {one.__name__: one for one in things if isinstance(one, ModuleType)}
    inner = [one for module in modules.values() for one in vars(module).values()]
    return {id(one) for one in things} | {
        id(one) for one in inner if getattr(one, "__module__", None) in modules
    }


SHOWN = shown()


class Known(dict[str, Any]):
    """The classes of the toolkit by name, and those of libraries that are imported when needed."""

    def __missing__(self, name):
        if name == "Figure":
            return object
        loaded = [m for key, m in sorted(sys.modules.items()) if key.partition(".")[0] in PACKAGES]
        found = {vars(one)[name] for one in loaded if isinstance(vars(one).get(name), type)}
        if len(found) != 1:
            raise KeyError(name)
        return found.pop()


def named_types(hint):
    """Yield the classes of this project that a type hint names, but dictionaries of keywords."""
    own = isinstance(hint, type) and hint.__module__.partition(".")[0] in PACKAGES
    if own and not is_typeddict(hint):
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
        get_type_hints(one, localns=Known())
        for one in members
        if isinstance(one, type) or inspect.isroutine(one)
    ]
    return {found for one in hints for hint in one.values() for found in named_types(hint)}


def not_shown(things):
    """Return the classes that signatures of functions and classes name, and that are neither public nor shown."""
    found = {one for thing in things for one in signature_types(thing)}
    return {one.__qualname__ for one in found if id(one) not in SHOWN}


def test_every_type_that_a_public_signature_names_is_public_or_in_the_reference():
    things = [one for face in FACES for one in vars_of(face) if callable(one)]
    assert len(things) > 100
    assert not_shown(things) == set()


def test_a_type_that_is_not_shown_is_noticed():
    def stray(shape: WorkingSurface): ...

    assert not_shown([stray]) == {"WorkingSurface"}
    assert not_shown([collalign.align_collection]) == set()


def test_no_dictionary_of_keywords_is_public():
    names = [name for face in FACES for name in face.__all__]
    assert not [name for name in names if name.endswith("Keywords")]


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


@pytest.mark.parametrize("face", FACES, ids=lambda face: face.__name__)
def test_every_public_name_is_there(face):
    for name in {*face.__all__} - {"__version__"}:
        assert getattr(face, name).__name__.rpartition(".")[2] == name


@pytest.mark.parametrize("module", [collalign, pairwise], ids=["collalign", "pairwise"])
def test_what_the_stub_has_is_all(module):
    assert set(dir(module)) == set(module.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = module.no_such_name
