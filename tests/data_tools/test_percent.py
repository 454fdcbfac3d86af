"""Confidences read alike everywhere."""

import pytest

from data_tools.percent import percent


@pytest.mark.parametrize(
    ("share", "words"), [(1.0, "100 %"), (0.999, "99 %"), (0.29, "29 %"), (0.0, "0 %"), (float("nan"), "unknown")]
)
def test_what_is_not_certain_is_never_called_so(share, words):
    assert percent(share) == words
