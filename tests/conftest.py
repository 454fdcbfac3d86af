"""Fixtures that every test file may use."""

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

SHARED_DATA = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of a file in one worker, which makes what they share once; marked files go together."""
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(str(item.path)))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of public collections beside the checkout; the test skips where it is missing."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the public collections of ../shared/data are not here")
    return SHARED_DATA.resolve()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20161)


@pytest.fixture
def open3d() -> Any:
    """Open3D; the test skips where it is missing, or the system lacks a library that it loads."""
    try:
        return import_module("open3d")
    except (ImportError, OSError) as error:
        pytest.skip(f"the extra open3d cannot be imported here: {error}")
