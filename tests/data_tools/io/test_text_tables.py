import csv
import io

import numpy as np
import pytest

from data_tools.io.text_tables import csv_text, parse_table, plain_cell


def test_regular_tables():
    table = parse_table("1 2.5 -3e-2\n\t4  nan inf\n7 8 9", num_rows=3)
    np.testing.assert_array_equal(table, [[1, 2.5, -0.03], [4, np.nan, np.inf], [7, 8, 9]])


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "1 2\n3",
        "1 2 3\n4 5\n6 7 8 9",
        "1 2 3 4\n5 6",
        "1 2\n3 four",
        "1 2\n3 4x",
        "1x 2\n3 4",
        "1.2.3\n4 5",
        "1/2 3",
        "1, 2",
        "1 ٢",
    ],
)
def test_others_are_left_to_the_caller(text):
    assert parse_table(text, num_rows=text.count("\n") + 1) is None


def test_blank_lines_hold_no_words():
    assert parse_table("1 2\n\n3 4", num_rows=3) is None


NAMES = [
    "=1+1",
    "+a",
    "-a",
    "@sum",
    "\tx",
    "'=a",
    "''=a",
    "'quoted'",
    "tooth",
    "a,b",
    'a"b',
    "two\nlines",
    "",
    "-1.5",
]


def read(text):
    return list(csv.reader(io.StringIO(text)))


def test_no_text_begins_like_a_formula_and_numbers_stay_numbers():
    rows = read(csv_text([["name", "x"], *([name, -1.5] for name in NAMES)]))
    assert rows[1:] == [[rows[at + 1][0], "-1.5"] for at in range(len(NAMES))]
    assert not [
        cell for cell, _ in rows[1:] if cell[:1] in ("=", "+", "-", "@", "\t") and cell != "-1.5"
    ]
    assert rows[-1][0] == "-1.5"


def test_names_come_back_as_they_were():
    assert [plain_cell(cell) for (cell,) in read(csv_text([[name] for name in NAMES if name]))] == [
        *filter(None, NAMES)
    ]


def test_unknown_numbers_are_empty():
    assert csv_text([[float("nan"), 0.1, 3]]) == ",0.1,3\n"
