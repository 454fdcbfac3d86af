"""Heavy packages are imported when they are needed, and one that is missing is named with the way to get it."""

import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest

import collalign
import pairwise
from collalign.engine.run_options import RunOptions
from data_tools import errors
from data_tools.errors import CollalignError


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


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """The folder of a finished result."""
    folder = tmp_path_factory.mktemp("finished") / "out"
    collalign.align_collection([np.eye(8, 3)] * 2, progress=False, jobs=1).save(folder)
    return str(folder)


@pytest.mark.parametrize("words", [("status", "OUT"), ("align", "--help"), ("batch", "--help")])
def test_commands_that_compute_nothing_load_nothing_that_does(words, result):
    words = [result if word == "OUT" else word for word in words]
    code = f"import sys; from collalign.cli import main; main({words}); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "collalign.output.collection" in loaded
    assert not loaded & {"scipy.spatial", "scipy.sparse", "scipy.optimize", "networkx", "numba"}


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


def run_without(blocked):
    code = ALIGN_WITHOUT.format(blocked=blocked)
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=600
    )


def test_alignment_needs_no_optional_package():
    done = run_without(OPTIONAL)
    assert done.returncode == 0, done.stderr


def test_a_package_that_is_needed_is_noticed():
    assert "import of scipy halted" in run_without(("scipy",)).stderr


def use_scheduler():
    run = RunOptions(scheduler="tcp://127.0.0.1:9")
    return collalign.align_collection([np.eye(8, 3)] * 2, run=run, progress=False)


def test_a_missing_scheduler_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for module in [name for name in sys.modules if name.startswith("collalign.engine.dask_")]:
        monkeypatch.delitem(sys.modules, module)
    with pytest.raises(CollalignError, match=r"install it with: pip install 'collalign\[dask\]'"):
        use_scheduler()


@pytest.mark.parametrize("face", FACES, ids=lambda face: face.__name__)
def test_every_public_name_is_there(face):
    for name in {*face.__all__} - {"__version__"}:
        assert getattr(face, name).__name__.rpartition(".")[2] == name


@pytest.mark.parametrize("module", [collalign, pairwise], ids=["collalign", "pairwise"])
def test_what_the_stub_has_is_all(module):
    assert set(dir(module)) == set(module.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = module.no_such_name
