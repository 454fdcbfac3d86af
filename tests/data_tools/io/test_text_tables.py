import numpy as np
import pytest

from data_tools.io.text_tables import parse_table


def test_regular_tables() -> None:
    table = parse_table(["1 2.5 -3e-2", "\t4  nan inf", "7 8 9"])
    np.testing.assert_array_equal(table, [[1, 2.5, -0.03], [4, np.nan, np.inf], [7, 8, 9]])


@pytest.mark.parametrize(
    "lines",
    [[], [""], ["1 2", "3"], ["1 2 3", "4 5", "6 7 8 9"], ["1 2", "3 four"], ["1 2", "3 4x"], ["1/2 3"], ["1, 2"]],
)
def test_others_are_left_to_the_caller(lines: list[str]) -> None:
    assert parse_table(lines) is None
