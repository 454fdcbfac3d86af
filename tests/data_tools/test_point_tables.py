"""Tables of landmarks as programs, spreadsheets and people write them: all of these hold the same three landmarks."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.files import any_text
from data_tools.point_tables import number, read_point_table
from tests.data_tools.io.formats.test_text_points import written_anyhow

POINTS = [[1.5, -2.25, 3.0], [0.5, 0.25, -0.125], [10.0, 20.5, 30.25]]
LABELS = ("F-1", "F-2", "F-3")


def rows(form, sign="."):
    lines = [
        form.format(label=label, x=x, y=y, z=z)
        for label, (x, y, z) in zip(LABELS, POINTS, strict=True)
    ]
    return "".join(line.replace(".", sign) + "\n" for line in lines)


@pytest.mark.parametrize(
    ("heading", "form"),
    [
        ("label,x,y,z,type\n", "{label},{x},{y},{z},I"),
        ("label,x,y,z\n", "{label},{x},{y},{z}"),
        ("", "{label},{x},{y},{z}"),
        ("", "{x},{y},{z},{label}"),
        ("", "{label},{x},{y},{z},left"),
        ("type,Z,Y,X,Landmark\n", "I,{z},{y},{x},{label}"),
        ("name;X [mm];Y [mm];Z [mm]\n", "{label};{x};{y};{z}"),
        ("point\tx_mm\ty_mm\tz_mm\n", "{label}\t{x}\t{y}\t{z}"),
        ('"","x","y","z"\n', '"{label}",{x},{y},{z}'),
        ('"x" "y" "z"\n', '"{label}" {x} {y} {z}'),
        (",0,1,2\n", "{label},{x},{y},{z}"),
        ("id,pos_x,pos_y,pos_z,visible\n", "{label},{x},{y},{z},1"),
        ("Punkt,Rechts,Vorn,Oben\n", "{label},{x},{y},{z}"),
        ("# columns = label,x,y,z,sel,vis\n", "{label},{x},{y},{z},1,1"),
        ("name,x,y,z,,\n", "{label},{x},{y},{z},,"),
        ("label,x,y,z\n", '{label}, "{x}", "{y}", "{z}"'),
    ],
)
def test_columns_are_found_by_heading_or_content(heading, form):
    found = read_point_table(heading + rows(form), "a.csv")
    assert (found.labels, found.system, found.specimens) == (LABELS, None, ())
    np.testing.assert_array_equal(found.points, POINTS)
    assert not found.points.flags.writeable


@pytest.mark.parametrize(
    "form",
    [
        "{label};{x};{y};{z}",
        "{label}\t{x}\t{y}\t{z}",
        '{label},"{x}","{y}","{z}"',
        "{label} {x} {y} {z}",
    ],
)
def test_decimal_commas_are_read_where_commas_separate_nothing(form):
    found = read_point_table("label;x;y;z\n".replace(";", form[7]) + rows(form, ","), "a.csv")
    assert found.labels == LABELS
    np.testing.assert_array_equal(found.points, POINTS)


@pytest.mark.parametrize(("axes", "system"), [("r,a,s", "RAS"), ("l,p,s", "LPS"), ("x,y,z", None)])
def test_tables_of_3d_slicer_say_their_system_and_what_is_defined(axes, system):
    text = f"label,{axes},defined,selected,visible,locked,description\n" + rows(
        "{label},{x},{y},{z},1,1,1,0,"
    )
    found = read_point_table(text.replace(",30.25,1", ",30.25,0"), "a.csv")
    assert (found.labels, found.system) == (LABELS, system)
    np.testing.assert_array_equal(found.points[:2], POINTS[:2])
    assert np.isnan(found.points[2]).all()


@pytest.mark.parametrize(
    "cell", ["", "NA", "NaN", "nan", "N/A", "#N/A", "-nan(ind)", "-1.#IND", "null", "-", ".", "?"]
)
def test_cells_without_a_number_are_missing(cell):
    found = read_point_table(
        f"label,x,y,z\na,1,2,3\nb,{cell},{cell},{cell}\nc,1,{cell},3\n", "a.csv"
    )
    assert np.isnan(found.points).all(axis=1).tolist() == [False, True, True]
    assert np.isnan(number(cell))
    unheaded = read_point_table(f"b,{cell},{cell},{cell}\na,1,2,3\n", "a.csv")
    assert unheaded.labels == ("b", "a")


def test_other_signs_that_end_lines_stay_in_cells():
    text = "label,x,y,z\na\u2028b,1,2,3\n\u2029c\x85d,4,5,6\n"
    assert read_point_table(text, "a.csv").labels == ("a\u2028b", "c\x85d")


@pytest.mark.parametrize("text", ["1,1,2,3\n2,4,5,6\n", "1,2,3,1\n4,5,6,2\n"])
def test_a_column_that_counts_the_rows_numbers_landmarks(text):
    found = read_point_table(text, "a.csv")
    assert found.labels == ("1", "2")
    np.testing.assert_array_equal(found.points, [[1, 2, 3], [4, 5, 6]])


def test_a_column_of_specimens_says_whose_each_landmark_is():
    text = "specimen,label,x,y,z\nA,p,1,2,3\nB,p,4,5,6\nA,q,7,8,9\n"
    found = read_point_table(text, "a.csv")
    assert (found.specimens, found.labels) == (("A", "B", "A"), ("p", "p", "q"))
    assert read_point_table(text.replace("specimen,label", "name,landmark"), "a.csv").specimens == (
        "A",
        "B",
        "A",
    )
    bare = read_point_table("specimen,x,y,z\nA,1,2,3\nB,4,5,6\nA,7,8,9\n", "a.csv")
    assert (bare.specimens, bare.labels) == (("A", "B", "A"), ("0", "0", "1"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("label,x,y,z\nF-1,1,5,2,5,3,5\n", r"row 1 has 7 cells under 4 headings.*decimal points"),
        (
            "label,a,b,c,d\nF-1,1,2,3,4\n",
            r"its heading does not say .* \(label, a, b, c, d\). Call one each x, y and z",
        ),
        ("label,x,y,x,z\nF-1,1,2,3,4\n", "its heading does not say"),
        ("1,2,3,4,5,6,7\n2,3,4,5,6,7,9\n", "no heading, and 7 columns of numbers"),
        ("17,2,3,4\n18,3,4,5\n", "can be read as label, x, y, z, or as x, y, z, label"),
        ("F-1,2,b,3,4\nF-2,3,c,4,5\n", "3 columns of numbers; it is not clear"),
        ("id,a,b,c,d\n17,2,3,4,5\n", "its heading does not say"),
        ("label,x,y,z\nF-1,1,2\n", "F-1 has 2 coordinates"),
        ("F-1,1,2,3\nF-2,1,2\n", "row 2 has 3 cells, most have 4|row 1 has 4 cells, most have 3"),
        ("label,x,y,z\nF-1,1,two,3\n", "'two' of landmark F-1 is no number"),
        ("label,x,y,z\n", "only a heading"),
        ("2\n1 2 3\n4 5 6\n7 8 9\n", "announces 2 landmarks and holds 3"),
        ("# nothing\n", "holds no landmarks"),
        (
            "name,landmark,x,y,z,radius,status\na,p,1,2,3,1,carried over\n",
            "carried over, not placed by a person",
        ),
    ],
)
def test_what_is_not_clear_is_refused_by_name(text, reason):
    with pytest.raises(InputError, match=rf"^a\.csv: .*({reason})"):
        read_point_table(text, "a.csv")


@pytest.mark.parametrize("seed", range(100))
def test_no_way_to_write_a_table_is_misread(seed):
    points, content, _, _ = written_anyhow(np.random.default_rng(seed))
    try:
        found = read_point_table(any_text(content), "a.csv")
    except InputError:
        return
    np.testing.assert_array_equal(found.points, points, err_msg=repr(content))
