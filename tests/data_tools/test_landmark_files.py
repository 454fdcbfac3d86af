import json

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.landmark_files import read_landmarks, read_semilandmarks

FCSV = """# Markups fiducial file version = 4.11
# CoordinateSystem = LPS
1,0,0,0,0,0,0,1,1,1,0,tip,,
2,1,2,3,0,0,0,1,1,1,0,base,,
"""
PICKED = """<!DOCTYPE PickedPoints><PickedPoints><DocumentData><DataFileName name="a.ply"/></DocumentData>
 <point x="0" y="0" z="0" active="1" name="tip"/><point y="2" x="1" z="3" active="1" name="base"/></PickedPoints>
"""
AMIRA = """# AmiraMesh 3D ASCII 2.0
define Markers 2
Parameters { NumSets 1, ContentType "LandmarkSet" }
Markers { float[3] Coordinates } @1
# Data section follows
@1
0.000000e+00 0 0
1 2 3
"""


def slicer(*controls):
    return json.dumps({"markups": [{"type": "Fiducial", "controlPoints": list(controls)}]})


TIP = {"label": "tip", "position": [0, 0, 0], "positionStatus": "defined"}
BASE = {"label": "base", "position": [1, 2, 3]}


@pytest.mark.parametrize(
    ("name", "content", "labels"),
    [
        ("a.mrk.json", slicer(TIP, BASE), ("tip", "base")),
        ("a.json", slicer(TIP, BASE), ("tip", "base")),
        ("a.pts", "Version 1.0\n2\nS000 0 0 0\nS001 1 2 3\n", ("S000", "S001")),
        ("a.PTS", "2\n0 0 0\n1 2 3\n", ("0", "1")),
        ("c.pts", "2\n17 0 0 0\n4 1 2 3\n", ("17", "4")),
        ("b.pts", "version: 1\nn_points:  2\n{\n0 0 0\n1 2 3\n}\n", ("0", "1")),
        ("a.fcsv", FCSV, ("tip", "base")),
        ("a.csv", "label,x,y,z\ntip,0,0,0\nbase,1,2,3\n", ("tip", "base")),
        ("b.csv", "0,0,0\n1,2,3\n", ("0", "1")),
        ("a.tsv", "label\tx\ty\tz\ntip\t0\t0\t0\nbase\t1\t2\t3\n", ("tip", "base")),
        ("a.txt", "tip 0 0 0\nbase 1 2 3\n", ("tip", "base")),
        ("b.txt", "Point #0,0,0,0\nPoint #1,1,2,3\n", ("Point #0", "Point #1")),
        ("c.csv", "sep=;\nlabel;x;y;z\ntip;0;0;0\nbase;1,0;2,0;3,0\n", ("tip", "base")),
        ("a.pp", PICKED, ("tip", "base")),
        ("a.landmarkAscii", AMIRA, ("0", "1")),
        ("b.landmarkAscii", AMIRA.replace("\n", "\r\n"), ("0", "1")),
    ],
)
def test_formats(tmp_path, name, content, labels):
    (tmp_path / name).write_bytes(content.encode())
    landmarks = read_landmarks(tmp_path / name)
    assert landmarks.labels == labels
    np.testing.assert_array_equal(landmarks.points, [[0, 0, 0], [1, 2, 3]])
    assert not landmarks.points.flags.writeable


def test_points_of_planes_boxes_lines_and_angles_are_no_landmarks(tmp_path):
    """3D Slicer writes all markups of a scene into one file where it is asked to."""
    others = [
        {"type": kind, "coordinateSystem": "RAS", "controlPoints": [TIP, BASE]}
        for kind in ("Plane", "ROI", "Line", "Angle")
    ]
    untyped = {"controlPoints": [TIP, BASE]}
    (tmp_path / "a.mrk.json").write_text(json.dumps({"markups": [*others, untyped]}))
    found = read_landmarks(tmp_path / "a.mrk.json")
    assert (found.labels, found.system) == (("tip", "base"), None)
    assert found.left_out == ("Plane", "ROI", "Line", "Angle")
    (tmp_path / "a.mrk.json").write_text(json.dumps({"markups": others}))
    with pytest.raises(
        InputError, match=r"only markups of other types \(Plane, ROI.*list of points"
    ):
        read_landmarks(tmp_path / "a.mrk.json")


@pytest.mark.parametrize("declared", ["LPS", "RAS", "0", "1", "", "IJK"])
def test_the_declared_coordinate_system_comes_along(tmp_path, declared):
    markups = json.loads(slicer(TIP, BASE))
    markups["markups"][0]["coordinateSystem"] = declared
    (tmp_path / "a.mrk.json").write_text(json.dumps(markups))
    (tmp_path / "a.fcsv").write_text(FCSV.replace("LPS", declared))
    (tmp_path / "b.fcsv").write_text(FCSV.replace("LPS", f"{declared},,,"))
    for name in ("a.mrk.json", "a.fcsv", "b.fcsv"):
        if declared == "IJK":
            with pytest.raises(InputError, match=f"{name}: .*LPS and RAS"):
                read_landmarks(tmp_path / name)
            continue
        found = read_landmarks(tmp_path / name)
        assert found.system == {"1": "LPS", "0": "RAS", "": None}.get(declared, declared)
        np.testing.assert_array_equal(found.points[1], [1, 2, 3])


def test_every_list_of_points_has_its_own_coordinate_system(tmp_path):
    curves = [{**slicer_curve("Curve", 4), "coordinateSystem": system} for system in ("RAS", "LPS")]
    points = [
        {"type": "Fiducial", "coordinateSystem": system, "controlPoints": [TIP]}
        for system in ("RAS", "LPS")
    ]
    path = tmp_path / "a.mrk.json"
    path.write_text(json.dumps({"markups": [*curves, points[0]]}))
    found = read_landmarks(path)
    assert (found.system, [one.system for one in found.semilandmarks]) == ("RAS", ["RAS", "LPS"])
    path.write_text(json.dumps({"markups": points}))
    with pytest.raises(InputError, match="different coordinate systems"):
        read_landmarks(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.mrk.json", slicer(TIP, {**BASE, "positionStatus": "undefined"})),
        ("a.mrk.json", slicer(TIP, {**BASE, "positionStatus": "preview"})),
        ("a.json", slicer(TIP, {**BASE, "positionStatus": "missing"})),
        ("a.mrk.json", slicer(TIP, {**BASE, "position": [None, None, None]})),
        ("a.mrk.json", slicer(TIP, {**BASE, "position": None})),
        ("a.csv", "tip,0,0,0\nbase,,,\n"),
        ("a.pp", PICKED.replace('active="1" name="base"', 'active="0" name="base"')),
        ("a.pts", "Version 1.0\n2\nS000 0 0 0\nS001 NA NA NA\n"),
        *(
            ("a.fcsv", FCSV.replace("tip,,", "tip,,,2,0").replace("base,,", f"base,,,{state},0"))
            for state in "013"
        ),
    ],
)
def test_missing_landmarks_are_nan(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    assert np.isnan(read_landmarks(tmp_path / name).points).all(axis=1).tolist() == [False, True]


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252"]
)
def test_tables_may_be_in_any_encoding_and_labels_are_composed(tmp_path, encoding):
    label = "Schädel" if encoding in ("latin-1", "cp1252") else "Scha\u0308del"
    (tmp_path / "a.csv").write_bytes(f"label,x,y,z\r\n{label},0,0,0\r\n".encode(encoding))
    assert read_landmarks(tmp_path / "a.csv").labels == ("Schädel",)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.mrk.json", '{"markups": ' + "[" * 100_000, "not a readable landmark file"),
        ("a.mrk.json", "[]", "no markups of 3D Slicer"),
        ("a.json", '{"version": 3}', "no markups of 3D Slicer"),
        (
            "a.json",
            slicer({"label": "far", "position": [1, 2, 10**400]}),
            "not a readable landmark file",
        ),
        ("a.pts", "Version 1.0\n3\nS000 0 0 0\n", "announces 3 landmarks and holds 1"),
        ("a.mrk.json", slicer(), "no landmarks"),
        ("a.mrk.json", slicer({"label": "flat", "position": [1, 2]}), "flat has 2 coordinates"),
        ("a.fcsv", "1,0,zero,0\n", "'zero' of landmark 0 is no number"),
        ("a.fcsv", "# nothing\n", "no landmarks"),
        ("a.csv", "tip,0,0,inf\n", "infinite"),
        ("a.csv", "0,0\n", "2 coordinates"),
        ("a.tps", "LM3=1\n", "unknown format of a list of points; readable are .*json"),
        ("a.pp", PICKED[:150], "its XML cannot be read"),
        ("a.pp", PICKED.replace('z="3"', 'z="three"'), "not a readable landmark file"),
        ("a.landmarkAscii", AMIRA[:80], "holds 0 sets"),
        (
            "a.landmarkAscii",
            AMIRA.replace("@1\n#", "@1\nMarkers { float[3] Coordinates2 } @2\n#"),
            "holds 2 sets",
        ),
        ("a.landmarkAscii", AMIRA.replace("1 2 3", "1 2"), "1 has 2 coordinates"),
        ("a.csv", "", "empty"),
    ],
)
def test_malformed_files_are_refused_by_name(tmp_path, name, content, reason):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=reason) as caught:
        read_landmarks(tmp_path / name)
    assert name in str(caught.value)


def slicer_curve(kind, num, label="R"):
    controls = [{"label": f"{label}-{at}", "position": [at, at % 2, 0]} for at in range(1, num + 1)]
    return {"type": kind, "controlPoints": controls}


def test_curves_of_slicer_are_no_landmarks(tmp_path):
    markups = [
        {"type": "Fiducial", "controlPoints": [TIP]},
        slicer_curve("Curve", 4),
        slicer_curve("ClosedCurve", 3, "S"),
    ]
    path = tmp_path / "a.mrk.json"
    path.write_text(json.dumps({"markups": markups}))
    found = read_landmarks(path)
    assert found.labels == ("tip",)
    assert [(one.name, one.kind, len(one.points)) for one in found.semilandmarks] == [
        ("R", "open curve", 4),
        ("S", "closed curve", 3),
    ]
    path.write_text(json.dumps({"markups": [slicer_curve("Curve", 1)]}))
    with pytest.raises(InputError, match="'R' has 1 points"):
        read_landmarks(path)


def test_lists_of_points_are_curves_or_patches_named_by_their_folder(tmp_path):
    (tmp_path / "orbit").mkdir()
    path = tmp_path / "orbit" / "a.csv"
    path.write_text("0,0,0\n1,0,0\n1,1,0\n0,0,0\n")
    found = read_semilandmarks(path, "curve")
    assert (found.name, found.kind, len(found.points)) == ("orbit", "closed curve", 3)
    assert read_semilandmarks(path, "patch").points.shape == (4, 3)
    path.write_text("0,0,0\n1,0,0\n")
    assert read_semilandmarks(path, "curve").kind == "open curve"
    markup = tmp_path / "orbit" / "b.mrk.json"
    markup.write_text(json.dumps({"markups": [slicer_curve("ClosedCurve", 4)]}))
    assert read_semilandmarks(markup, "curve").kind == "closed curve"
    markup.write_text(
        json.dumps({"markups": [slicer_curve("Curve", 4), slicer_curve("Curve", 4, "S")]})
    )
    with pytest.raises(InputError, match="holds 2 lists"):
        read_semilandmarks(markup, "curve")
