"""Runs the tests of a mutant in a copy of the project: killed, survived, or no verdict.

mutmut and cosmic-ray run all tests for each place, which takes days here; this draws places by a seed and runs the
few tests that call what a fault changes.
"""

import importlib
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.mutants.place import Mutant

#: What the tests of a mutant need of the project.
COPIED = (
    "collalign",
    "data_tools",
    "pairwise",
    "experiments",
    "tests",
    "pyproject.toml",
    "README.md",
    "docs",
)
#: Seconds for the tests of one mutant; one that hangs is killed.
TIME_LIMIT_S = 300.0
#: Imported once, before the processes that run tests are forked.
_LIBRARIES = (
    "hypothesis",
    "networkx",
    "scipy.optimize",
    "scipy.sparse.linalg",
    "scipy.spatial",
    "trimesh",
    "joblib",
)
#: Exit codes of pytest: passed, and failed or interrupted by an error while tests were collected.
_PASSED, _FAILED = 0, (1, 2)


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant: "killed", "survived", or "no verdict" where its tests cannot be run."""

    mutant: Mutant
    ending: str
    seconds: float


def run_mutants(mutants, root, *, time_limit_s=TIME_LIMIT_S):
    """Run the tests of one mutant after the other, in a copy of the project, where they pass without it.

    The project at ``root`` is only read.
    """
    warm_up()
    with _copy(root) as copy:
        passes = {}
        for mutant in mutants:
            start_s, ending = time.monotonic(), "no verdict"
            if mutant.tests not in passes:
                passes[mutant.tests] = _ending(copy, mutant.tests, time_limit_s) == "survived"
            if passes[mutant.tests]:
                ending = _ending_of(copy, mutant, time_limit_s)
            yield Verdict(mutant, ending, time.monotonic() - start_s)


@contextmanager
def _copy(root):
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Path(folder) / "project"
        copy.mkdir()
        for name in COPIED:
            source = root / name
            if source.is_dir():
                shutil.copytree(
                    source,
                    copy / name,
                    ignore=shutil.ignore_patterns("__pycache__", "node_modules"),
                )
            elif source.exists():
                shutil.copy(source, copy / name)
        yield copy


def _ending_of(copy, mutant, time_limit_s):
    """Run test files with another text of one module."""
    file = copy / mutant.file
    original = file.read_text("utf-8")
    file.write_text(mutant.changed, "utf-8")
    try:
        return _ending(copy, mutant.tests, time_limit_s)
    finally:
        file.write_text(original, "utf-8")


def _ending(copy, tests, time_limit_s):
    """Run test files until the first failure, in a fork of this process and a process group of its own."""
    process = multiprocessing.get_context("fork").Process(target=_run_tests, args=(copy, tests))
    process.start()
    process.join(time_limit_s)
    ended = process.exitcode is not None
    with suppress(ProcessLookupError):
        os.killpg(int(process.pid or 0), signal.SIGKILL)  # whatever the tests left running
    process.join()
    if not ended or int(process.exitcode or 0) < 0:
        return "killed"
    return {_PASSED: "survived", **dict.fromkeys(_FAILED, "killed")}.get(
        int(process.exitcode or 0), "no verdict"
    )


def _run_tests(copy, tests):
    """Run pytest in the copy and end the process with its exit code."""
    os.setsid()
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    os.chdir(copy)
    os.environ |= {"PYTHONPATH": str(copy), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(copy))
    os._exit(int(pytest.main(["-x", "-q", "-m", "not data", *tests])))


def warm_up():
    """Import what the tests need of others once, so that a mutant's tests begin at once; nothing of the project."""
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    for name in _LIBRARIES:
        with suppress(ImportError):
            importlib.import_module(name)
