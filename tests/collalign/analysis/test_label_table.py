import pytest

from collalign.analysis.label_table import read_labels
from collalign.wording import note_text
from data_tools.errors import InputError
from data_tools.notes import Note


def table(tmp_path, text):
    path = tmp_path / "labels.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_by_name_with_unknown_values(tmp_path):
    labels = read_labels(
        table(tmp_path, "taxon,name,side\nAotus,a,left\nNA,b.ply,right\n,sub/c,?\n")
    )
    assert labels.column("taxon", ["a", "b", "c", "d"]) == ("Aotus", "", "", "")
    assert labels.columns_for(["a", "b"]) == {"taxon": ("Aotus", ""), "side": ("left", "right")}
    assert labels.columns_for(["nobody"]) == {}


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_and_byte_order_mark(tmp_path, separator):
    text = "\ufeffspecimen,genus\na,X\nb,Y\n".replace(",", separator)
    assert read_labels(table(tmp_path, text)).column("genus", ["b", "a"]) == ("Y", "X")


@pytest.mark.parametrize(
    ("text", "ages"),
    [
        ("name;age\na;4,5\nb;12\nc;\n", ("4.5", "12", "")),
        ("name;age\na;4,512\nb;1,250\nc;NA\n", ("4.512", "1.250", "")),
        ('name,age\na,"4,5"\nb,"1,25"\nc,3\n', ("4.5", "1.25", "3")),
        ('name,age\na,"4,512"\nb,"1,250"\nc,987\n', ("4,512", "1,250", "987")),
        ("name;age\na;4,5\nb;old, or so\nc;1\n", ("4,5", "old, or so", "1")),
        ("name;age\na;4,5\nb;4.5\nc;1\n", ("4,5", "4.5", "1")),
    ],
)
def test_decimal_commas_become_points_where_they_mark_no_thousands(tmp_path, text, ages):
    assert read_labels(table(tmp_path, text)).column("age", "abc") == ages


def test_first_column_holds_names_if_none_is_called_so(tmp_path):
    labels = read_labels(table(tmp_path, "tooth,genus\na,X\n\nb,Y\n"))
    assert labels.column("genus", ["a", "b"]) == ("X", "Y")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a heading and rows"),
        ("name,taxon\n", "a heading and rows"),
        ("name\na\nb\n", "a heading and rows"),
        ("name,taxon\na,X,Y\n", "line 2: 3 cells under 2 headings"),
        ("name,taxon\na,X\na,Y\n", "listed twice with different labels"),
        ("name,taxon\na," + "X" * 131_073 + "\n", "cannot be read as a table"),
    ],
)
def test_tables_that_cannot_be_meant_are_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_labels(table(tmp_path, text))


def test_missing_files_columns_and_names_are_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_labels(tmp_path / "none.csv")
    labels = read_labels(table(tmp_path, "name,taxon\na,X\n"))
    with pytest.raises(InputError, match="no column is called 'genus'; there are taxon"):
        labels.column("genus", ["a"])
    with pytest.raises(
        InputError, match=r"none of its rows belongs to a shape\. It names a, the shapes are b, c"
    ):
        labels.column("taxon", ["b", "c"])
    empty = read_labels(table(tmp_path, "name,taxon,sex\na,,f\n"))
    with pytest.raises(InputError, match="'taxon' has no value for any of the 1 shapes"):
        empty.column("taxon", ["a"])


def test_names_that_nearly_agree_lead_to_their_rows_and_are_told(tmp_path):
    rows = "".join(f"{number};{'mf'[number % 2]}\n" for number in range(1, 5))
    labels = read_labels(table(tmp_path, f"specimen;sex\n{rows}"))
    names = ["001", "002", "003", "04"]
    labels.check_fit(names)
    assert labels.columns_for(names) == {"sex": ("f", "m", "f", "m")}
    (note,) = labels.mismatches(names)
    assert note == Note(
        "labels-taken-as", tuple(names), {"source": labels.source, "rows": ("1", "2", "3", "4")}
    )
    assert "001 (row 1)" in note_text(note)
    assert [note.code for note in labels.mismatches(["001", "01", "2"])] == [
        "labels-unknown",
        "labels-missing",
    ]
    assert "1 (did you mean '001' or '01'?)" in note_text(labels.mismatches(["001", "01", "2"])[0])


def test_the_file_says_more_than_a_running_number(tmp_path):
    labels = read_labels(table(tmp_path, "id,file,sex\n1,x/004.ply,f\n2,x/001.ply,m\n3,2.PLY,f\n"))
    names = ["001", "002", "004"]
    assert labels.column("sex", names) == ("m", "f", "f")
    assert labels.mismatches(["001", "004"]) == [
        Note("labels-unknown", values={"source": labels.source, "rows": ("3",), "hints": ("",)})
    ]


def test_folders_tell_shapes_of_one_name_apart(tmp_path):
    labels = read_labels(table(tmp_path, "file,sex\na/skull.ply,f\nb/skull.ply,m\n"))
    assert labels.column("sex", ["a/skull", "b/skull"]) == ("f", "m")
    with pytest.raises(
        InputError, match=r"'skull' is listed twice, as 'a/skull\.ply' and 'b/skull"
    ):
        labels.check_fit(["skull"])
