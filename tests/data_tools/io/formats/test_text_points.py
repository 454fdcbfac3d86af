from pathlib import Path

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError, OptionsError
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.formats.text_points import read_points_table, read_pts, read_text_points
from data_tools.io.shapes import read_shape
from data_tools.io.source import Source
from data_tools.options import CleaningOptions

MALFORMED = [
    ("nan.xyz", "0 0 0\nnan 1 2\n3 4 5\n", "NaN"),
    ("inf.xyz", "0 0 0\ninf 1 2\n3 4 5\n", "infinite"),
    ("cut.xyz", "0 0 0\n1 2 3\n4 5\n", "row 3 has 2 columns"),
    ("flat.xyz", "0 0\n1 2\n", "2 columns, expected 3"),
    ("words.xyz", "0 0 0\n1 two 3\n", "row 2 is not numbers"),
    ("gap.csv", "0,0,0\n1,,3\n4,5,6\n", "1 of 9 values are NaN"),
    ("gaps.csv", "x,y,z,w\n,0,0,7\n,2,3,7\n,5,6,7\n", "3 of 9 values are NaN"),
    ("comments.xyz", "# nothing\n\n", "no points"),
    ("header.csv", "x,y,z\n", "no points"),
    ("binary.txt", "\x00\x01\x02", "columns|no points|numbers"),
    (
        "prose.txt",
        "This is a letter to a friend.\nIt has no points in it, or few.\n",
        "columns|numbers",
    ),
    ("few.xyz", "4\n0 0 0\n1 2 3\n4 5 7\n", "promises 4 points, 3 lines follow. It is truncated"),
    (
        "many.pts",
        "1\n0 0 0 9\n1 2 3 9\n4 5 7 9\n",
        "promises 1 points, 3 lines follow. To read all, delete that line",
    ),
    ("huge.pts", "9" * 30 + "\n0 0 0\n", "promises 99999999999999999999 points, 1 lines follow"),
    (
        "landmarks.pts",
        "Version 1.0\n3\nS000 0 0 0\nS001 1 2 3\nS002 4 5 7\n",
        "landmarks, no point cloud",
    ),
    ("counts.pts", "0\n0\n", "no points"),
    ("text.npz", "not an archive", "not an NPZ archive"),
    ("start.npz", "PK\x03\x04", "not an NPZ archive|damaged"),
    ("end.npz", "PK\x05\x06" + "\x00" * 18, "none of the arrays"),
    ("tabs.txt", "\t\t\t\n", "no points"),
    ("mark.txt", "\ufeff", "no points"),
    ("hex.txt", "0x10 0x20 0x30\n0x1 0x2 0x3\n", "columns|numbers"),
    ("null.txt", "1 2 3\n\x004 5 6\n", "numbers"),
]


@pytest.mark.parametrize("suffix", [".xyz", ".asc", ".pts", ".txt"])
def test_the_number_of_points_may_come_first(tmp_path, suffix):
    for count in ("", "3\n", "003 \r\n", "# by hand\n\n3\n", "//X Y Z I\n3\n", "3\nX Y Z I\n"):
        more = " 1" * ("I" in count)
        rows = [f"{row}{more}\n" for row in ("0 0 0", "1 2 3", "4 5 7")]
        (tmp_path / f"a{suffix}").write_text(count + "".join(rows))
        np.testing.assert_array_equal(
            read_shape(tmp_path / f"a{suffix}").vertices, [[0, 0, 0], [1, 2, 3], [4, 5, 7]]
        )


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
def test_clouds_and_obj_may_be_in_any_encoding(tmp_path, encoding):
    (tmp_path / "a.txt").write_bytes("Länge_x;y;z\r\n0;0;0\r\n1;2;3\r\n4;5;7\r\n".encode(encoding))
    (tmp_path / "a.obj").write_bytes(
        "v 0 0 0\ng Schädel\nv 1 2 3\nv 4 5 7\nf 1 2 3\n".encode(encoding)
    )
    for suffix in (".txt", ".obj"):
        np.testing.assert_array_equal(
            read_shape(tmp_path / f"a{suffix}").vertices, [[0, 0, 0], [1, 2, 3], [4, 5, 7]]
        )


def test_npz_holds_meshes_and_clouds(tmp_path, rng):
    shape = blob(rng, num_vertices=50)
    np.savez(tmp_path / "mesh.npz", vertices=shape.vertices, faces=shape.faces)
    np.savez(tmp_path / "libigl.npz", V=shape.vertices, F=shape.faces)
    assert read_shape(tmp_path / "libigl.npz").is_mesh
    np.savez_compressed(tmp_path / "cloud.npz", points=shape.vertices.astype(np.float32))
    np.testing.assert_array_equal(read_shape(tmp_path / "mesh.npz").faces, shape.faces)
    assert not read_shape(tmp_path / "cloud.npz").is_mesh


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
        "-1,00 2,42 0,5\n3,25 0,00 -7,75\n",
        "p -1 2.42 .5\nq 3.25 0 -7.75\n",
        "-1,2.42,.5,p\n3.25,0,-7.75,q\n",
        "# class x y z\n6 -1 2.42 .5\n8 3.25 0 -7.75\n",
        "//I,X,Y,Z\n2\n6,-1,2.42,.5\n8,3.25,0,-7.75\n",
        "x,y,z,vx,vy,vz\n-1,2.42,.5,9,9,9\n3.25,0,-7.75,9,9,9\n",
        "l,p,s,size\n-1,2.42,.5,9\n3.25,0,-7.75,9\n",
        "-1 2.42 .5 # first\n3.25 0 -7.75 // last\n",
        "-1\u2028 2.42 .5\n3.25 0 \x85-7.75\n",
        "2\nwater, 0.5 -1.0 2.0\nO -1 2.42 .5\nH 3.25 0 -7.75\n",
        "2\n\n8 -1 2.42 .5 0.1\n1 3.25 0 -7.75 0.2\n",
        '2\nLattice="1 0 0" Properties=id:I:1:pos:R:3:species:S:1 pbc=T\n1 -1 2.42 .5 O\n2 3.25 0 -7.75 H\n',
        'sep=;\n"x";"y";"z"\n-1;"2,42";,5\n3,25;0;-7,75\n',
        "\ufeffsep=,\r\nx,y,z\r\n-1,2.42,.5\r\n3.25,0,-7.75\r\n",
    ],
)
def test_tables_of_all_habits_are_read_alike(text):
    found = read_text_points(Source(Path("a.csv"), text.encode()))
    np.testing.assert_array_equal(found.vertices, [[-1, 2.42, 0.5], [3.25, 0, -7.75]])


#: Content, and what the error must say.
AMBIGUOUS = [
    ("1,234;5,678;2,100\n3,456;7,890;1,234\n", "save it with decimal points"),
    ("1.5;2.5;3,5\n4,5;5,5;6,5\n", "row 1 .* save it with decimal points"),
    ("1,2,3 4\n5,6,7 8\n", "both commas and blanks"),
    ("-1,00,2,42,3,10\n4,05,5,17,6,00\n", "both columns and decimals"),
    ("x,y,z\n-1,00,2,42,3,10\n4,05,5,17,6,00\n", "decimal commas"),
    ("id,a,b,c\n1,2,3,4\n5,6,7,8\n", "not all three columns"),
    ("X (mm),X (px),Y,Z\n1,2,3,4\n5,6,7,8\n", "several columns"),
    ("x,y,z,x\n1,2,3,4\n5,6,7,8\n", "several columns"),
    ("nx,ny,nz,z\n1,2,3,4\n5,6,7,8\n", "not all three columns"),
    ("1 0.5 2 3\n2 1 1 1\n3 9 8 7\n", "x, y, z, intensity, or as number, x, y, z"),
    ("0,0.5,2,3\n1,1,1,1\n2,9,8,7\n", "x, y, z, intensity, or as number, x, y, z"),
    ("6 0.5 2 3.5\n8 1 1.5 1\n6 9 8 7\n", r"x, y, z, \.\.\., or as number, x, y, z. Say which"),
    (".01 5 2 .5\n.02 1 1 .1\n.03 -9 8 .7\n", "x, y, z, intensity, or as time, x, y, z"),
    (".9 5 2 .5\n.2 1 1 .1\n.7 -9 8 .7\n", "x, y, z, intensity, or as intensity, x, y, z"),
    ("2 5.5 2 .5 9 9 9\n1 1 1 .1 7 7 7\n", "as number, x, y, z, .*--columns number,x,y,z"),
    ("5.5 2.5 .5 9 9\n1 1 .1 7 7\n", r"its 5 columns can be read as x, y, z, \.\.\."),
    ("5.5 -2.5 7.5 .9 .9 .9\n1 1 .1 7 7 8\n", "its 6 columns can be read as"),
    ("1 2 .5 .5\n2 .5 .5 zwei\n3 .5 .5 .5\n", "row 2 is not numbers alone"),
    ("1 2 .5 .5\n2 .5 .5 .5 .5\n", "row 2 has 5 columns, expected 4"),
    ("a 1 2\nb 2 3\n", "row 1 is not numbers"),
    ("a 1 2 b 3\nb 2 3 c 4\n", "and 3 columns of numbers; it is not clear"),
    ("x,y,z\n1,2,3\n1,2,3,4\n", "row 2 has 4 columns"),
    (
        "0 0 1.5 2.5 3.5 9\n0 1 2.5 3.5 4.5 9\n0 2 1.5 0.5 4.5 9\n",
        "as row, column, x, y, z, .*--columns row,column,x,y,z",
    ),
    ("10,20,30,255,0,0\n40,50,60,0,128,9\n", "If each number is a column of its own, name them"),
    ("2\n\nC 1 2 3\nH 4 5 6\n2\n\nC 1 2 3\nH 4 5 6\n", "more than one model of 2 atoms"),
    ("3\n\nC 1 2 3\nH 4 5 6\n", "promises 3 points, 2 lines follow. It is truncated"),
    ("1_0 2 3\n4 5 6\n", "holds no points|not numbers|columns"),
    ("x,y,z\n1,2\n", "row 1 has 2 columns, expected 3"),
]


@pytest.mark.parametrize(("text", "reason"), AMBIGUOUS)
def test_ambiguous_tables_are_refused_with_the_reason(text, reason):
    with pytest.raises(InputError, match=reason) as caught:
        read_text_points(Source(Path("a.csv"), text.encode()))
    assert str(caught.value).startswith("a.csv: ")


def test_columns_are_what_the_user_says(tmp_path):
    """Each table that is refused or misread without that can be read, from Python as well."""
    want = [[10, 20, 30], [40, 50, 60], [40, 50, 61]]
    for columns, text in {
        "x,y,z": "10,20,30,255,0,0\n40,50,60,0,128,9\n40,50,61,0,128,9\n",
        "class,x,y,z": "6 10 20 30\n8 40 50 60\n8 40 50 61\n",
        "Z, Y, X": "30 20 10 7 7\n60 50 40 7 8\n61 50 40 7 8\n",
        "n,m,x,y,z": "a,b,c,d,e\n1,2,10,20,30\n1,2,40,50,60\n1,2,40,50,61\n",
    }.items():
        np.testing.assert_array_equal(read_points_table(text, "a", columns).vertices, want)
        for suffix in (".xyz", ".csv", ".pts"):
            (tmp_path / f"a{suffix}").write_text(text)
            shape = read_shape(tmp_path / f"a{suffix}", CleaningOptions(columns=columns))
            np.testing.assert_array_equal(shape.vertices, want)
    headed = "n,x,y,z\n1,10,20,30\n1,40,50,60\n"
    assert len(read_points_table(headed, "a", "class,x,y,z").vertices) == 2
    with pytest.raises(InputError, match=r"x, y and z in columns 2, 3, 4, which contradicts"):
        read_points_table(headed, "a", "x,y,z,n")
    with pytest.raises(InputError, match="row 1 has 3 columns, expected 4"):
        read_points_table("1 2 3\n4 5 6\n", "a", "class,x,y,z")
    for wrong in ("x,y", "x,y,z,x", "a,b,c", 3):
        with pytest.raises(OptionsError, match="columns: expected"):
            CleaningOptions(columns=wrong)


@pytest.mark.parametrize(
    "more",
    [
        "7",
        "0.25",
        "255 0 9",
        "0 0.6 -0.8",
        "-900 1 2 3",
        "1 2 3 0.5",
        "1 2 3 0 .6 .8",
        "0 0 1 1 2 3",
    ],
)
def test_documented_formats_have_coordinates_first(rng, more):
    """Intensity, colour and normal after x, y and z; the same columns before them are refused, but never misread."""
    points = np.round(100 * rng.standard_normal((30, 3)), 3)
    rows = [" ".join(map(str, point)) for point in points]
    after = read_points_table("".join(f"{row} {more}\n" for row in rows), "a")
    np.testing.assert_array_equal(after.vertices, points)
    assert not_kept(["further columns"])[0] in after.notes
    with pytest.raises(InputError, match="can be read as"):
        read_points_table("".join(f"{more} {row}\n" for row in rows), "a")


def written_anyhow(rng):
    """Return points, a table of them as somebody may write it, what a person calls its columns, if it has a count."""

    def one_of(*choices):
        return choices[int(rng.integers(len(choices)))]

    points = np.round(rng.standard_normal((8, 3)) * one_of(1, 10, 1000), one_of(2, 3))
    if rng.random() < 0.2:
        points = np.round(100 * points)
    extras = {
        "": lambda at: [],
        "class": lambda at: [int(rng.integers(1, 5))],
        "time": lambda at: [round(0.04 * at, 3)],
        "quality": lambda at: [round(float(rng.normal()), 3)],
        "intensity": lambda at: [round(float(rng.random()), 3)],
        "r,g,b": lambda at: rng.integers(0, 256, 3).tolist(),
        "nx,ny,nz": lambda at: [0, 0.6, -0.8],
        "label": lambda at: [f"p{at}"],
    }
    before, after = (one_of("", *extras) if rng.random() < share else "" for share in (0.5, 0.6))
    rows = [
        [*extras[before](at), *point, *extras[after](at)]
        for at, point in enumerate(points.tolist())
    ]
    names = [*filter(None, before.split(",")), "x", "y", "z", *filter(None, after.split(","))]
    sign = one_of(",", ";", "\t", " ", "  ", ", ", " ; ")
    comma = "," not in sign and rng.random() < 0.3
    lines = [sign.join(str(x).replace(".", "," if comma else ".") for x in row) for row in rows]
    kind = one_of("none", "none", "first", "units", "comment")
    heading = sign.join(f"{name} [mm]" if kind == "units" else name for name in names)
    head = {"none": [], "comment": [f"# {heading}"]}.get(kind, [heading])
    count = one_of(None, None, None, len(lines), len(lines) - 1)
    head = [*head, str(count)] if count and kind in ("none", "comment") else head
    head += [""] * (count is not None and rng.random() < 0.3)
    text = one_of("\n", "\r\n", "\r").join([*one_of([], ["# by hand"]), *head, *lines, ""])
    return points, text.encode(one_of("utf-8", "utf-8-sig", "utf-16")), ",".join(names), bool(count)


@pytest.mark.parametrize("seed", range(150))
def test_no_way_to_write_a_table_is_misread(seed):
    """What is read is right, whoever writes it how; what is refused is read where its columns are named."""
    points, content, columns, has_count = written_anyhow(np.random.default_rng(seed))
    for named in ("", columns):
        for reader in (read_text_points, read_pts):
            if reader is read_pts and has_count:  # its format says what comes first
                continue
            try:
                found = reader(Source(Path("a.txt"), content), named)
            except InputError as error:
                reason = str(error)
                if named and "commas" not in reason:
                    raise
            else:
                np.testing.assert_array_equal(found.vertices, points, err_msg=repr(content))
