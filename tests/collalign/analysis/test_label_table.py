import pytest

from collalign.analysis.label_table import read_labels, shape_name
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


def test_names_that_do_not_fit_are_told(tmp_path):
    labels = read_labels(
        table(tmp_path, "name,file,taxon\na,x/A1.ply,X\nB,b.ply,Y\nbb,bbb.ply,Z\n")
    )
    source = {"source": str(labels.source)}
    assert labels.mismatches(["A1", "b"]) == [
        Note("labels-unknown", values={**source, "rows": ("bb",)})
    ]
    assert labels.mismatches(["a", "b", "bbb", "d", "e"]) == [
        Note("labels-missing", ("d", "e"), source)
    ]
    assert labels.mismatches(["a", "B", "bb"]) == []


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


def test_names_lose_folder_and_mesh_ending_only():
    assert [shape_name(text) for text in ("a/b.PLY", "x\\y.off", " v1.2 ", "n")] == [
        "b",
        "y",
        "v1.2",
        "n",
    ]


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
    with pytest.raises(InputError, match="no column 'genus'; it has 'taxon'"):
        labels.column("genus", ["a"])
    with pytest.raises(InputError, match="must be those of the shapes"):
        labels.column("taxon", ["b", "c"])


def test_a_file_column_leads_to_the_row_as_well(tmp_path):
    labels = read_labels(table(tmp_path, "name,file,genus\nB03,B03_scan.off,X\n"))
    assert labels.column("genus", ["B03_scan"]) == labels.column("genus", ["B03"]) == ("X",)
    assert list(labels.columns) == ["genus"]
