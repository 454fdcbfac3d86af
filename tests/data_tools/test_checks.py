from functools import partial

import numpy as np
import pytest

from data_tools.checks import check_choice, check_count, check_flag, check_number
from data_tools.errors import OptionsError

at_least_two = partial(check_count, lower=2)
share = partial(check_number, upper=1.0, positive=True)


@pytest.mark.parametrize(
    ("check", "value"),
    [
        (at_least_two, 2),
        (at_least_two, np.int64(3)),
        (check_flag, False),
        (check_number, 0),
        (check_number, np.float32(0.5)),
        (share, 1),
        (partial(check_choice, choices=("a", "b")), "b"),
    ],
)
def test_possible_values_pass(check, value):
    check("name", value)


@pytest.mark.parametrize(
    ("check", "value", "words"),
    [
        (at_least_two, 1, "an integer of at least 2, got 1"),
        (at_least_two, True, "an integer"),
        (at_least_two, 2.0, "an integer"),
        (check_flag, 1, "true or false, got 1"),
        (check_number, -1e-9, "a number of at least 0"),
        (check_number, np.nan, "a number"),
        (check_number, np.inf, "a number"),
        (check_number, True, "a number"),
        (check_number, "3", "a number"),
        (share, 0.0, "more than 0 and at most 1"),
        (share, 1.1, "more than 0 and at most 1"),
        (partial(check_choice, choices=("a", "b")), "c", "one of a, b, got 'c'"),
    ],
)
def test_impossible_values_are_refused_by_name(check, value, words):
    with pytest.raises(OptionsError, match=f"^name: expected .*{words}"):
        check("name", value)
