"""Fixtures of the tests of experiments."""

import pytest

from collalign.engine.store import Store
from experiments.experiment import Bench


@pytest.fixture
def bench(tmp_path):
    """A bench for quick runs, without data and with a store of its own."""
    return Bench(data=tmp_path, store=Store.memory(), quick=True, quiet=True, results=tmp_path)
