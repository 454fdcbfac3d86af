"""Fixtures that every test file may use."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.optional import OPEN3D_EXTRA, optional_module

if hasattr(signal, "SIGHUP"):  # behind nohup, what tests start would ignore it, and be waited for
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault(
    "LOKY_MAX_CPU_COUNT", "1"
)  # two tests run at a time: worker processes only for ``two_cores``

#: Ends of the names of files whose tests kill processes: one worker for all, first.
KILLING = (
    *(
        f"collalign/engine/test_{name}.py"
        for name in ("cluster", "faults", "jobs", "jobs_dask", "jobs_guard")
    ),
    "collalign/engine/test_jobs_interrupted.py",
    "collalign/cli/test_main.py",
    "tests/test_packaging.py",
)
#: Folders of many quick files: they come last, so that neither of two workers waits long for the other.
QUICK = ("data_tools", "pairwise")
SHARED_DATA = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"


def pytest_configure(config):
    """Let files begin in the order of the collection, not of their numbers of tests."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """Begin with the tests that kill processes, and end with the folders of quick files."""

    def place(item):
        name = item.path.as_posix()
        folder = name.removeprefix(f"{Path(__file__).resolve().parent.as_posix()}/").partition("/")[
            0
        ]
        return not name.endswith(KILLING), folder in QUICK

    items.sort(key=place)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file in one worker, which makes what they share once; those of ``KILLING`` go together."""
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return "killing" if file.endswith(KILLING) else file

    return ByFile(config, log)


@pytest.fixture(scope="session")
def shared_data():
    """The folder of public collections beside the checkout; the test skips where it is missing."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the public collections of ../shared/data are not here")
    return SHARED_DATA.resolve()


@pytest.fixture
def two_cores(monkeypatch):
    """Two worker processes for whoever asks for them."""
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "2")


@pytest.fixture(scope="module")
def quick_search():
    """Maps and poses from fewer starts, registrations of fewer Gaussians, and no worker for one core."""
    from collalign import RunOptions
    from collalign.nonrigid import portfolio
    from collalign.registration import register

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunOptions, "is_alone", property(lambda run: run.scheduler is None))
        patch.setattr(register, "TUNED", register.TUNED._replace(num_centres=150))
        patch.setattr(portfolio, "TUNED", portfolio.TUNED._replace(num_source=16, num_screened=5))
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(20161)


@pytest.fixture
def open3d():
    """Open3D; the test skips where it is missing, or the system lacks a library that it loads."""
    return optional_module("open3d", OPEN3D_EXTRA)


@pytest.fixture
def tiny3d():
    """A library with objects and functions as Open3D has them."""
    return optional_module("tiny3d")


@pytest.fixture(scope="module")
def driver():
    """Playwright, which drives browsers; the test skips where it is missing."""
    playwright = optional_module("playwright.sync_api")
    with playwright.sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def browser(driver):
    """A headless Chromium; the test skips where none is installed."""
    from tests.browser import launched

    chromium = launched(driver)
    yield chromium
    chromium.close()
