"""The helper that measures memory notices who takes too much."""

import numpy as np
import pytest

from tests.memory import most_memory


def test_too_much_memory_is_noticed():
    with most_memory(2**20):
        np.zeros(2**10)
    with pytest.raises(AssertionError, match="bytes were taken"), most_memory(2**20):
        np.zeros(2**20)
