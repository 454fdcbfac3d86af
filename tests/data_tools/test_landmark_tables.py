"""Landmarks of several specimens in one file, as the field's programs write them."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.listing import FolderListing
from data_tools.landmark_tables import notes_beside, read_specimens
from tests.memory import most_memory

#: As tpsDig, NTSYSpc and morphologika have them; the second landmark of the second specimen is missing.
TPS = """LM3=2
0 0 0
1 2 3
CURVES=1
POINTS3=3
0 0 0
1 0 0
2 0 0
ID=a
LM3=2
0 0 0
NA NA NA
IMAGE=C:\\scans\\b one.ply
"""
NTS = """"made by hand
1 2L 6 1 -9999 DIM=3
a b_one
0 0 0 1 2 3
0 0 0 -9999 -9999 -9999
"""
MORPHOLOGIKA = """[Individuals]
2
[landmarks]
2
[dimensions]
3
[names]
a
b one
[rawpoints]
'a
0 0 0
1 2 3

'b one
0 0 0
NaN NaN NaN
"""


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("all.tps", TPS),
        ("all.NTS", NTS),
        ("all.dta", NTS.replace('"made', "'made")),
        ("all.txt", MORPHOLOGIKA),
        ("old.txt", MORPHOLOGIKA.replace("\n", "\r")),
    ],
)
def test_every_specimen_is_read_by_its_name(tmp_path, name, content):
    (tmp_path / name).write_bytes(content.encode())
    found = read_specimens(tmp_path / name)
    assert [*found] in (["a", "b one"], ["a", "b_one"])
    first, second = found.values()
    np.testing.assert_array_equal(first.points, [[0, 0, 0], [1, 2, 3]])
    np.testing.assert_array_equal(second.points, [[0, 0, 0], [np.nan] * 3])
    assert (first.labels, first.points.flags.writeable) == (("0", "1"), False)


def test_curves_and_scales_of_tps(tmp_path):
    path = tmp_path / "b.tps"
    path.write_text(TPS.replace("ID=a", "ID=a\nSCALE=0.5"))
    (curve,) = read_specimens(path)["a"].semilandmarks
    assert (curve.name, curve.kind) == ("curve 1", "open curve")
    np.testing.assert_array_equal(curve.points, [[0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(read_specimens(path)["a"].points[1], [0.5, 1, 1.5])


def test_tables_of_several_specimens_keep_their_system(tmp_path):
    path = tmp_path / "all.csv"
    path.write_text("specimen;label;r;a;s\nA;p;1,5;2;3\nB;p;4;5;6\n")
    found = read_specimens(path)
    assert [*found] == ["A", "B"]
    assert (found["A"].system, found["A"].points.tolist()) == ("RAS", [[1.5, 2.0, 3.0]])


@pytest.mark.parametrize(
    ("heading", "labels"),
    [
        ("specimen,sex,nose_x,nose_y,nose_z,chin_x,chin_y,chin_z", ("nose", "chin")),
        ('"","sex","1.X","1.Y","1.Z","2.X","2.Y","2.Z"', ("1", "2")),
        ("ID;sex;X1 (mm);Y1 (mm);Z1 (mm);X2 (mm);Y2 (mm);Z2 (mm)", ("1", "2")),
    ],
)
def test_a_row_may_hold_all_landmarks_of_a_specimen(tmp_path, heading, labels):
    text = f"{heading}\nA,f,0,0,0,1,2.5,3\nB,m,NA,,,4,5,6\n"
    (tmp_path / "all.csv").write_text(
        text.replace(",", ";").replace(".5", ",5") if ";" in heading else text
    )
    first, second = read_specimens(tmp_path / "all.csv").values()
    assert (first.labels, first.points.tolist()) == (labels, [[0, 0, 0], [1, 2.5, 3]])
    np.testing.assert_array_equal(second.points, [[np.nan] * 3, [4, 5, 6]])
    (tmp_path / "s.csv").write_text("X1,Y1,Z1\n1,2,3\n")
    assert read_specimens(tmp_path / "s.csv")["s"].points.tolist() == [[1, 2, 3]]


def test_rows_of_nts_with_three_columns_are_landmarks(tmp_path):
    (tmp_path / "a.nts").write_text("1 2L 3 0 DIM=3\nnose chin\n0 0 0\n1 2 3\n")
    found = read_specimens(tmp_path / "a.nts")["a"]
    assert (found.labels, found.points.tolist()) == (("nose", "chin"), [[0, 0, 0], [1, 2, 3]])


def test_one_specimen_without_a_name_is_called_like_its_file(tmp_path):
    (tmp_path / "skull.nts").write_text("1 2 3 0 dim=3\n0 0 0\n1 2 3\n")
    (tmp_path / "jaw.tps").write_text("LM3=1\n1 2 3\n")
    (tmp_path / "orbit.csv").write_text("0,0,0\n1,2,3\n")
    assert read_specimens(tmp_path / "skull.nts")["skull"].points.shape == (2, 3)
    assert read_specimens(tmp_path / "jaw.tps")["jaw"].points.shape == (1, 3)
    assert read_specimens(tmp_path / "orbit.csv")["orbit"].points.shape == (2, 3)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.tps", "LM3=1\n0 0 0\nSCALE=inf\n", "not a readable TPS"),
        ("a.tps", "LM=2\n0 0\n1 2\n", "not a readable TPS file of three-dimensional"),
        ("a.tps", "LM3=2\n0 0 0\n", "not a readable TPS"),
        ("a.tps", "nothing\n", "holds no landmarks"),
        ("a.tps", 2 * "LM3=1\n0 0 0\nID=x\n", "two specimens are called 'x'"),
        ("a.nts", "1 2L 4 0 DIM=2\na b\n0 0 1 1\n0 0 1 1\n", "not a readable NTS"),
        ("a.nts", NTS + "7", "not a readable NTS"),
        ("a.txt", MORPHOLOGIKA.replace("1 2 3", "1 2"), "not a readable TXT"),
        ("a.tps", "LM3=1\n0 0 0\n1 2 3\n", "not a readable TPS"),
        ("a.csv", "X1,Y1,Z1\n0,0,0\n1,2,3\n", "no column says which specimen each row is"),
        ("a.tps", "LM3=400000000\n0 0 0\n", "not a readable TPS"),
        ("a.nts", "1 400000000 0 0 DIM=3\n0 0 0\n", "not a readable NTS"),
        (
            "a.txt",
            "[individuals]\n400000000\n[landmarks]\n1\n[dimensions]\n3\n[rawpoints]\n0 0 0\n",
            "not a read",
        ),
        (
            "a.txt",
            "[individuals]\n400000000\n[landmarks]\n0\n[dimensions]\n3\n[rawpoints]\n",
            "not a readable",
        ),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, name, content, reason):
    (tmp_path / name).write_text(content)
    with (
        most_memory(2**22),
        pytest.raises(InputError, match=f"{name}: .*{reason}|{name}: {reason}"),
    ):
        read_specimens(tmp_path / name)


def test_landmarks_beside_shapes_are_told_from_other_tables(tmp_path):
    rows = "".join(f"{at},{at * at},1\n" for at in range(1001))
    contents = {
        "a.csv": "x,y,z\n0,0,0\n1,2,3\n",
        "a.tps": TPS,
        "cloud.csv": f"x,y,z\n{rows}",
        "notes.md": "0,0,0\n",
        "specimens.csv": "name,sex\na,f\n",
        "unclear.txt": "1 2 3 4 5\n",
    }
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "folder.csv").mkdir()
    listing = FolderListing(files=(), names=(), skipped=tuple(sorted(tmp_path.iterdir())))
    found = {note.code: note.values["files"] for note in notes_beside(listing)}
    assert found == {
        "landmarks-beside": ("a.csv", "a.tps"),
        "tables-beside": ("cloud.csv", "folder.csv", "unclear.txt"),
    }
    assert notes_beside(FolderListing(files=(), names=())) == ()
