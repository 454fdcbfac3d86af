import csv
import io

from data_tools.io.csv_cells import csv_text, plain_cell

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
