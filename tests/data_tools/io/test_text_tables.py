import csv
import io
import time

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.text_tables import csv_text, parse_table, plain_cell, read_points_table


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


@pytest.mark.parametrize(
    "text",
    [
        "x;y;z\n-1;2.42;.5\n3.25;0;-7.75\n",
        "-1\t2.42\t.5\n3.25\t0\t-7.75\n",
        "X (mm),Y (mm),Z (mm),nx,ny,nz\n-1,2.42,.5,9,9,9\n3.25,0,-7.75,9,9,9\n",
        "nx,ny,nz,X [mm],Y [mm],Z [mm]\n9,9,9,-1,2.42,.5\n9,9,9,3.25,0,-7.75\n",
        "X (mm) Y (mm) Z (mm) nx ny nz\n-1 2.42 .5 9 9 9\n3.25 0 -7.75 9 9 9\n",
        "name;x_mm;y_mm;z_mm\na b;-1;2.42;.5\nc, d;3.25;0;-7.75\n",
        'x, y, z, name\n-1, 2.42, .5, "c, d"\n3.25, 0, -7.75, e\n',
        "'nx' 'x' 'y' 'z'\n9 -1 2.42 .5\n9 3.25 0 -7.75\n",
        '"Points:0","Points:1","Points:2","Normals:0"\n-1,2.42,.5,9\n3.25,0,-7.75,9\n',
        "tooth a, -1, 2.42, .5\ntooth b, 3.25, 0, -7.75\n".replace("tooth", "name,x,y,z\ntooth", 1),
        "pos_x pos_y pos_z\n-1 2.42 .5\n3.25 0 -7.75\n",
        "a,b,c\n-1,2.42,.5\n3.25,0,-7.75\n",
        "Point,Easting,Northing,Elevation\nP1,-1,2.42,.5\nP2,3.25,0,-7.75\n",
        "-1e0,2.42,5e-1,,\n3.25,0,-7.75,,\n",
        "-1,00\t2,42\t0,5\n3,25\t0\t-7,75\n",
        'sep=;\n"x";"y";"z"\n-1;"2,42";,5\n3,25;0;-7,75\n',
        "\ufeffsep=,\r\nx,y,z\r\n-1,2.42,.5\r\n3.25,0,-7.75\r\n",
    ],
)
def test_tables_of_all_habits_are_read_alike(text):
    np.testing.assert_array_equal(
        read_points_table(text, "a.csv").vertices, [[-1, 2.42, 0.5], [3.25, 0, -7.75]]
    )


#: Content, and what the error must say.
AMBIGUOUS = [
    ("1,234;5,678;2,100\n3,456;7,890;1,234\n", "save it with decimal points"),
    ("1.5;2.5;3,5\n4,5;5,5;6,5\n", "row 1 .* save it with decimal points"),
    ("-1,00 2,42 0,5\n3,25 0,00 -7,75\n", "both commas and blanks"),
    ("1,2,3 4\n5,6,7 8\n", "both commas and blanks"),
    ("-1,00,2,42,3,10\n4,05,5,17,6,00\n", "both columns and decimals"),
    ("x,y,z\n-1,00,2,42,3,10\n4,05,5,17,6,00\n", "decimal commas"),
    ("id,a,b,c\n1,2,3,4\n5,6,7,8\n", "not all three columns"),
    ("X (mm),X (px),Y,Z\n1,2,3,4\n5,6,7,8\n", "several columns"),
    ("x,y,z,x\n1,2,3,4\n5,6,7,8\n", "several columns"),
    ("nx,ny,nz,z\n1,2,3,4\n5,6,7,8\n", "not all three columns"),
    ("1 0.5 2 3\n2 1 1 1\n3 9 8 7\n", "counts the rows"),
    ("0,0.5,2,3\n1,1,1,1\n2,9,8,7\n", "counts the rows"),
    ("0 0 1.5 2.5 3.5 9\n0 1 2.5 3.5 4.5 9\n0 2 1.5 0.5 4.5 9\n", "row and column of a scanner"),
    ("1_0 2 3\n4 5 6\n", "holds no points|not numbers|columns"),
    ("x,y,z\n1,2\n", "row 1 has 2 columns, expected 3"),
]


@pytest.mark.parametrize(("text", "reason"), AMBIGUOUS)
def test_ambiguous_tables_are_refused_with_the_reason(text, reason):
    with pytest.raises(InputError, match=reason) as caught:
        read_points_table(text, "a.csv")
    assert str(caught.value).startswith("a.csv: ")


def test_integers_with_colours_are_no_split_decimals():
    text = "10,20,30,255,0,0\n40,50,60,0,128,9\n"
    np.testing.assert_array_equal(
        read_points_table(text, "a.csv").vertices, [[10, 20, 30], [40, 50, 60]]
    )


def test_missing_numbers_are_nan_wherever_they_are():
    for sign in (",", ";", "\t"):
        text = f"x{sign}y{sign}z\n{sign}2{sign}3\n1{sign}{sign}3\n1{sign}2{sign}\n"
        found = read_points_table(text, "a.csv").vertices
        np.testing.assert_array_equal(np.isnan(found), np.eye(3, dtype=bool))


def test_long_tables_take_the_short_way(rng, monkeypatch):
    points = rng.standard_normal((1000, 3))
    rows = "\n".join(",".join(map(repr, point)) for point in points.tolist())
    monkeypatch.setattr(
        "data_tools.io.text_tables._row_by_row", lambda *_: pytest.fail("row by row")
    )
    np.testing.assert_array_equal(read_points_table("x,y,z\n" + rows, "a.csv").vertices, points)


@pytest.mark.parametrize(
    "heading", ["(" * 300_000, "x" + " (" * 150_000, " ".join("({[" * 50_000) + " y"]
)
def test_a_heading_of_brackets_takes_no_time(heading):
    started = time.process_time()
    with pytest.raises(InputError, match="heading"):
        read_points_table(f"{heading} x\n1 2 3 4\n", "table.txt")
    assert time.process_time() - started < 5.0, "minutes where the time grows with the square"
    np.testing.assert_array_equal(
        read_points_table("x (mm) y [mm] z{mm}\n1 2 3\n", "table.txt").vertices, [[1, 2, 3]]
    )


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
