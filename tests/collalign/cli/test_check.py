"""What ``align --check`` says of files, and shapes of several folders as one collection."""

import json

import numpy as np
import pytest

from collalign.output.loading import load
from tests.commands import run_command

FLAGS = ["--sampling.num-points", "12", "--sampling.num-dense-points", "0", "--jobs", "1"]


@pytest.fixture
def folder(tmp_path):
    """Five clouds in two folders, two of one name, one in metres among millimetres; and two that are no shapes."""
    rng = np.random.default_rng(0)
    points = 40 * rng.random((40, 3))
    for name, unit in (
        ("left/a", 1.0),
        ("left/b", 1.0),
        ("right/a", 1.0),
        ("right/c", 1.1),
        ("right/metres", 1e-3),
    ):
        path = tmp_path / "in" / f"{name}.xyz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, unit * (points + 0.4 * rng.standard_normal((40, 3))))
    (tmp_path / "in" / "right" / "b.xyz").write_bytes(b"rubbish")
    (tmp_path / "in" / "readme.md").write_text("two sides")
    return tmp_path / "in"


def test_a_check_reads_every_file_and_writes_nothing(folder):
    out = folder.parent / "out"
    told = json.loads(
        run_command(
            "align", folder, "--recursive", "--out", out, *FLAGS, "--check", "--json", ends=3
        ).out
    )
    assert [one["name"] for one in told["shapes"]] == [
        *("left/a", "left/b", "right/a", "right/c", "right/metres"),
    ]
    assert all(one["points"] == 40 and one["triangles"] == 0 for one in told["shapes"])
    assert max(told["shapes"][0]["size"]) > 30
    assert [one["file"] for one in told["left_out"]] == ["right/b.xyz"]
    assert told["skipped"] == ["readme.md"]
    (note,) = told["notes"]
    assert (note["code"], note["shapes"], note["values"]) == (
        "much-smaller",
        ["right/metres"],
        {"times": [pytest.approx(1e3, rel=0.01)]},
    )
    assert not out.exists()
    said = run_command("align", folder / "left", *FLAGS, "--check")
    assert "2 of 2 files can be aligned." in said.out
    run_command("align", folder / "left", *FLAGS, ends=2)
    (folder / "right" / "readme.md").write_text("again")
    said = run_command(
        "align", folder, "--recursive", "--out", out, *FLAGS, "--check", "--json", ends=3
    )
    assert json.loads(said.out)["skipped"] == ["in/readme.md", "right/readme.md"]
    (folder / "left" / "b.xyz").unlink()
    said = run_command("align", folder / "left", "--out", out, *FLAGS, "--check", ends=2)
    assert "at least two are needed" in said.err


def test_several_folders_are_one_collection_and_odd_sizes_are_named_by_a_run(folder):
    out = folder.parent / "out"
    places = folder.parent / "all.txt"
    places.write_text("in/left\nin/right/*.xyz\n")
    said = run_command("align", f"@{places}", "--out", out, *FLAGS, ends=3)
    assert "Much smaller than the median shape: in/right/metres" in said.out
    assert "Left out: in/right/b.xyz: " in said.err
    names = ("in/left/a", "in/left/b", "in/right/a", "in/right/c", "in/right/metres")
    assert load(out).names == names
    assert len({path.name for path in (out / "meshes").iterdir()}) == 5
    places = [str(folder / "right"), str(folder / "left")]
    told = json.loads(
        run_command("align", *places, "--out", out, *FLAGS, "--check", "--json", ends=3).out
    )
    assert {"right/c", "left/a", "right/metres", "right/a"} < {
        one["name"] for one in told["shapes"]
    }
    ended = run_command("align", folder, "--out", out, ends=2)
    assert "its folders do: left (2), right (4)" in ended.err
