import csv
import io

import pytest

from data_tools.io.text_tables import (
    axis_columns,
    csv_text,
    parse_table,
    read_table,
)


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
    "\uff1d1+1",
    "'\uff20a",
    "left\u2028right",
    "a\x85b",
    "-1.5",
]


def read(text):
    return list(csv.reader(io.StringIO(text)))


def test_no_text_begins_like_a_formula_and_numbers_stay_numbers():
    rows = read(csv_text([["name", "x"], *([name, -1.5] for name in NAMES)]))
    assert rows[1:] == [[rows[at + 1][0], "-1.5"] for at in range(len(NAMES))]
    assert not [
        cell
        for cell, _ in rows[1:]
        if cell[:1] in {*"=+-@\t\uff1d\uff0b\uff0d\uff20"} and cell != "-1.5"
    ]
    assert rows[-1][0] == "-1.5"


def test_unknown_numbers_are_empty():
    assert csv_text([[float("nan"), 0.1, 3]]) == ",0.1,3\n"


@pytest.mark.parametrize(
    ("text", "heading", "separator", "first"),
    [
        ("x y z\n1 2 3\n", ("x", "y", "z"), None, ["1", "2", "3"]),
        ("# x y z class\n1 2 3 4\n", ("x", "y", "z", "class"), None, ["1", "2", "3", "4"]),
        ("# points: x, y, z\n1 2 3 4\n", (), None, ["1", "2", "3", "4"]),
        ("# x y z\n1 2 3 4\n", (), None, ["1", "2", "3", "4"]),
        ("# columns = x,y,z\n1,2,3,4\n", ("x", "y", "z"), ",", ["1", "2", "3", "4"]),
        ("2\nx;y;z\n1,5;2;3\n4;5;6\n", ("x", "y", "z"), ";", ["1,5", "2", "3"]),
        ("a 1,2,3\nb 4,5,6\n", (), ",", ["a 1", "2", "3"]),
        ('a,1,2,3,"\nb,4,5,6,c\n', (), ",", ["a", "1", "2", "3", '"']),
    ],
)
def test_rows_and_headings(text, heading, separator, first):
    """A comment names columns if it has a word for each; a quote that does not end swallows no row."""
    table = read_table(text, "a")
    assert (table.heading, table.separator, table.rows()[0]) == (heading, separator, first)


def test_axes_of_headings():
    for heading, want in {
        "class,x,y,z": ((1, 2, 3), None),
        "Z [mm],pos_y,Points:0,x_size": ((2, 1, 0), None),
        "label,r,a,s": ((1, 2, 3), "RAS"),
        "a,b,c": ((0, 1, 2), None),
        "a,b,c,d": (None, None),
        "x,y,z,vx,vy,vz": ((0, 1, 2), None),
        "x,y,z,x": ((0, 3, 1, 2), None),
        "p_x,p_y,p_z,q_x,q_y,q_z": (None, None),
    }.items():
        assert axis_columns(heading.split(",")) == want
