"""Whole runs search from few starts: what they find is the subject of the tests of their parts and of the goldens."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def quick(quick_search):
    """Search from few starts in every test of this folder."""
