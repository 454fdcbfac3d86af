"""To which shapes landmark files belong."""

import logging
from pathlib import Path
from typing import get_args

import pytest

from collalign.analysis.sliding import CRITERIA
from collalign.template_landmarks.templates import (
    SemilandmarkRequest,
    Slide,
    read_templates,
    with_semilandmarks,
)
from data_tools.errors import InputError, OptionsError

TPS = "LM3=1\n0 0 0\nID={}\n"


def test_files_belong_to_shapes_by_name_by_what_they_say_or_as_told(tmp_path, caplog):
    (tmp_path / "all.tps").write_text("".join(map(TPS.format, ("a", "b.ply", "stranger"))))
    (tmp_path / "c.csv").write_text("0,0,0\n")
    (tmp_path / "one.tps").write_text(TPS.format("a"))
    (tmp_path / "d.tps").write_text(TPS.format("specimen 7"))
    names = ("a", "b", "c", "d", "left/e")
    files = [
        tmp_path / "all.tps",
        tmp_path / "c.csv",
        tmp_path / "d.tps",
        f"left/e={tmp_path / 'one.tps'}",
    ]
    with caplog.at_level(logging.WARNING):
        assert read_templates(files, names).keys() == set(names)
    (tmp_path / "other.tps").write_text(TPS.format("b.ply"))
    assert [*read_templates([tmp_path / "other.tps"], names)] == ["b"]
    assert "left aside, no shapes of the collection: stranger" in caplog.text
    curves = [f"left/e={tmp_path / 'c.csv'}"]
    (tmp_path / "c.csv").write_text("0,0,0\n1,0,0\n")
    assert [*with_semilandmarks({}, SemilandmarkRequest(curves=tuple(curves)), names)] == ["left/e"]


@pytest.mark.parametrize(
    ("files", "reason"),
    [
        (["all.tps", "a.csv"], "a second landmark file of the specimen 'a'"),
        (["x=all.tps"], "holds 2 specimens, expected that of 'x' alone"),
        (["no.tps"], "none of its specimens"),
    ],
)
def test_files_of_no_shape_or_of_one_twice_are_refused(files, reason, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("all.tps").write_text(TPS.format("a") + TPS.format("b"))
    Path("no.tps").write_text(TPS.format("p") + TPS.format("q"))
    Path("a.csv").write_text("0,0,0\n")
    with pytest.raises(InputError, match=reason):
        read_templates(files, ("a", "b"))


def test_a_word_for_landmarks_after_the_name_does_not_matter(tmp_path, caplog):
    for name in ("s0_LM1.mrk.json", "s0_2_landmarks.csv"):
        text = '{"markups": [{"type": "Fiducial", "controlPoints": [{"label": "a", "position": [0, 0, 1]}]}]}'
        (tmp_path / name).write_text(text if name.endswith("json") else "a,0,0,1\n")
    names = ("s0", "s0_2", "s1")
    with caplog.at_level(logging.WARNING):
        assert [
            *read_templates([tmp_path / "s0_LM1.mrk.json", tmp_path / "s0_2_landmarks.csv"], names)
        ] == [
            "s0",
            "s0_2",
        ]
    assert "s0_LM1.mrk.json: taken as the landmarks of s0" in caplog.text
    (tmp_path / "s0_left.csv").write_text("a,0,0,1\n")
    message = r"s0_left\.csv: no shape is called 's0_left' \(call the file like its shape, or give it as SHAPE="
    with pytest.raises(InputError, match=message):
        read_templates([tmp_path / "s0_left.csv"], names)
    with pytest.raises(InputError, match="no shape is called 's0_3'; did you mean 's0_2'"):
        read_templates([f"s0_3={tmp_path / 's0_left.csv'}"], names)


def tps(path, *specimens):
    """Write specimens with these lines of names, and return the path."""
    path.write_text("".join(f"LM3=1\n{at} 0 0\n{said}\n" for at, said in enumerate(specimens)))
    return path


@pytest.mark.parametrize(
    ("said", "found"),
    [
        (("IMAGE=s2.jpg\nID=0", "IMAGE=s4.jpg\nID=1"), ["s2", "s4"]),
        (("IMAGE=s2.jpg\nID=1", "IMAGE=s4.jpg\nID=1"), ["s2", "s4"]),
        (("IMAGE=x\\S-04.JPG\nID=0",), ["s4"]),
        (("IMAGE=view.jpg\nID=s2", "IMAGE=view.jpg\nID=s4"), ["s2", "s4"]),
        (("ID=C:\\data\\s2.ply", "ID=C:\\data\\s4.ply"), ["s2", "s4"]),
        (("ID=S 02", "ID=s_4"), ["s2", "s4"]),
        (("IMAGE=s2.jpg\nID=s2", "IMAGE=s4.jpg\nID=s4"), ["s2", "s4"]),
    ],
)
def test_specimens_of_tps_are_called_by_what_names_shapes(tmp_path, said, found):
    read = read_templates([tps(tmp_path / "all.tps", *said)], ("s1", "s2", "s4"))
    assert sorted(read) == found
    assert [read[name].points[0, 0] for name in found] == [*range(len(found))]


def test_id_and_image_of_different_shapes_are_refused(tmp_path):
    path = tps(tmp_path / "all.tps", "IMAGE=s2.jpg\nID=s4", "IMAGE=s4.jpg\nID=s2")
    with pytest.raises(InputError, match="ID and IMAGE name different shapes"):
        read_templates([path], ("s2", "s4"))
    running = tps(tmp_path / "004.tps", "ID=1")
    assert [*read_templates([running], ("001", "004"))] == ["004"], "the file says more"


def test_folders_tell_files_of_one_name_apart(tmp_path, caplog):
    names, files = ("AMNH 100/skull", "AMNH 101/skull", "AMNH 102"), []
    for folder, stem in (("AMNH 100", "skull"), ("amnh_101", "skull_LM1"), ("AMNH 102", "points")):
        (tmp_path / folder).mkdir()
        files.append(tmp_path / folder / f"{stem}.csv")
        files[-1].write_text("a,0,0,1\n")
    with caplog.at_level(logging.WARNING):
        assert [*read_templates(files, names)] == [*names]
    assert "AMNH 100" not in caplog.text, "it agrees exactly"
    assert "taken as the landmarks of AMNH 101/skull" in caplog.text


def test_specimens_without_any_landmark_are_no_templates(tmp_path, caplog):
    (tmp_path / "all.tps").write_text(
        TPS.format("a") + TPS.replace("0 0 0", "NA NA NA").format("b")
    )
    with caplog.at_level(logging.WARNING):
        assert [*read_templates([tmp_path / "all.tps"], ("a", "b"))] == ["a"]
    assert "all their landmarks are missing: b" in caplog.text
    (tmp_path / "b.csv").write_text("a,,,\nb,NA,NA,NA\n")
    with pytest.raises(InputError, match="all its landmarks are missing"):
        read_templates([tmp_path / "b.csv"], ("a", "b"))


def test_a_request_to_slide_is_one_of_the_criteria():
    assert get_args(Slide) == CRITERIA
    for slide in (None, *CRITERIA):
        assert SemilandmarkRequest(slide=slide).slide == slide
    with pytest.raises(OptionsError, match="slide"):
        SemilandmarkRequest(slide="least")
