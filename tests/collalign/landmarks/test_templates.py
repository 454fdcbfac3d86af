"""To which shapes landmark files belong."""

import logging
from pathlib import Path

import pytest

from collalign.landmarks.templates import SemilandmarkRequest, read_templates, with_semilandmarks
from data_tools.errors import InputError

TPS = "LM3=1\n0 0 0\nID={}\n"


def test_files_belong_to_shapes_by_name_by_what_they_say_or_as_told(tmp_path, caplog):
    (tmp_path / "all.tps").write_text("".join(map(TPS.format, ("a", "b.ply", "stranger"))))
    (tmp_path / "c.csv").write_text("0,0,0\n")
    (tmp_path / "one.tps").write_text(TPS.format("a"))
    (tmp_path / "d.tps").write_text(TPS.format("specimen 7"))
    names = ("a", "b", "c", "d", "left/e")
    files = [tmp_path / "all.tps", tmp_path / "c.csv", tmp_path / "d.tps", f"left/e={tmp_path / 'one.tps'}"]
    with caplog.at_level(logging.WARNING):
        assert read_templates(files, names).keys() == set(names)
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
