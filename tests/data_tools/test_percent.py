"""Confidences read alike everywhere."""

import pytest

from data_tools.percent import listed, percent


@pytest.mark.parametrize(
    ("share", "words"),
    [(1.0, "100 %"), (0.999, "99 %"), (0.29, "29 %"), (0.0, "0 %"), (float("nan"), "unknown")],
)
def test_what_is_not_certain_is_never_called_so(share, words):
    assert percent(share) == words


def test_long_lists_are_cut():
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(i) for i in range(11)]) == "0, 1, 2, 3, 4, 5, 6, 7 and 3 more"
