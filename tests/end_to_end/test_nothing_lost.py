"""No command deletes or overwrites a file that no command wrote, or writes outside of the folder that it is given."""

import dataclasses
import os
import shutil

import pytest

from collalign import RunOptions, align_collection
from collalign.cli import main
from collalign.output.loading import load
from collalign.tools.export.run import FORMATS, export
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape, write_mesh
from tests.commands import run_command
from tests.end_to_end.test_align import FLAGS, OPTIONS
from tests.finished_runs import chairs, finished_run
from tests.view_problems import write_result


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with a result in ``out``, made from ``shapes``."""
    return finished_run(tmp_path_factory.mktemp("finished"), chairs(3), OPTIONS, report=True).parent


@pytest.fixture
def project(finished, tmp_path):
    """A copy of the shapes in ``meshes``."""
    shutil.copytree(finished / "shapes", tmp_path / "project" / "meshes")
    return tmp_path / "project"


def snapshot(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_what_was_aligned_again_is_not_replaced_by_its_own_result(finished, tmp_path):
    again = align_collection(finished / "out" / "meshes", options=OPTIONS, run=RunOptions(jobs=1))
    before = snapshot(finished / "out")
    with pytest.raises(InputError, match="contains"):
        again.save(finished / "out")
    assert snapshot(finished / "out") == before
    links = tmp_path / "links"
    links.mkdir()
    for file in (finished / "out" / "meshes").iterdir():
        (links / file.name).symlink_to(file)
    run_command("align", links, "--out", finished / "out", *FLAGS, ends=2)
    assert snapshot(finished / "out") == before


def test_exports_do_not_overwrite_originals(finished, tmp_path):
    before = snapshot(finished)
    for to in ("shapes", "shapes/to", "."):
        with pytest.raises(InputError, match="name a folder apart"):
            export(finished / "out", "ply", finished / to)
    with pytest.raises(InputError, match=r"meshes/chair1\.ply: .*`align`"):
        export(finished / "out", "shapeworks", finished / "out")
    assert {
        name: data for name, data in snapshot(finished).items() if "staging" not in name
    } == before
    export(finished / "out", "ply", tmp_path)
    export(finished / "out", "tps", tmp_path)
    assert len(export(finished / "out", "ply", tmp_path)) == 3
    assert (tmp_path / "landmarks.tps").exists()


PAIR = ["shapes/chair1.ply", "shapes/chair2.ply"]


@pytest.mark.parametrize("place", ["shapes", "shapes/../shapes", "."])
@pytest.mark.parametrize(
    "command",
    [
        ["align", "shapes", "--out"],
        ["match", *PAIR, "--no-refine", "--out"],
        ["match", *PAIR, "--nonrigid", "--out"],
        ["match", *PAIR, "--partial", "--out"],
        ["variation", "out", "--to"],
        ["transfer", "out", "--landmarks", "chair1.csv", "--to"],
    ],
    ids=["align", "match", "non-rigid match", "partial match", "variation", "transfer"],
)
def test_no_command_writes_among_its_inputs(finished, command, place, monkeypatch):
    monkeypatch.chdir(finished)
    (finished / "chair1.csv").write_text("tip,0,0,0\n")
    before = snapshot(finished)
    run_command(*command, place, ends=2)
    assert snapshot(finished) == before


def test_names_in_forged_evidence_lead_nowhere(finished, tmp_path):
    result, new, out = (
        tmp_path / "a" / "b" / "result",
        tmp_path / "new",
        tmp_path / "a" / "b" / "to",
    )
    shutil.copytree(finished / "out", result)
    names = ("../../../escaped", str(tmp_path / "absolute"), "..")
    write_result(dataclasses.replace(load(result), names=names), result)
    new.mkdir()
    shutil.copy(finished / "shapes" / "chair1.ply", new / "chair9.ply")
    main(["add", str(result), str(new), "--jobs", "1"])
    for format in FORMATS:
        export(result, format, out)
    allowed = {tmp_path / "a", new}
    assert [p for p in tmp_path.iterdir() if p not in allowed] == []
    assert sorted(p.name for p in (tmp_path / "a" / "b").iterdir()) == ["result", "to"]


def test_names_that_are_long_or_no_text_go_through_every_output(tmp_path):
    shapes = tmp_path / "shapes"
    shapes.mkdir()
    names = (b"x" * 251, b"\xff a$1_$2^{ <script> 'd'\nf" * 9, b"=cmd|' C calc'!A0")
    for shape, name in zip(chairs(3).shapes, names, strict=True):
        path = write_mesh(tmp_path / "a.ply", shape)
        os.rename(path, os.fsencode(shapes) + b"/" + name + b".ply")
    out = tmp_path / "out"
    run_command("align", shapes, "--out", out, *FLAGS)
    assert len([read_shape(path) for path in (out / "meshes").iterdir()]) == 3
    for format in FORMATS:
        for path in export(out, format, tmp_path / format):
            assert path.stat().st_size > 0
    tables = [
        out / "pairs.csv",
        *(tmp_path / "csv").glob("*.csv"),
        tmp_path / "tps" / "specimens.csv",
    ]
    for table in tables:
        cells = table.read_text("utf-8").replace("\n", ",").split(",")
        assert not [
            cell for cell in cells if cell.strip('"').startswith(("=", "@", "+", "-cmd"))
        ], table
    assert "'=cmd" in tables[0].read_text("utf-8")
