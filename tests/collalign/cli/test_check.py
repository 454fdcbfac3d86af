"""What ``align --check`` says of files, and shapes of several folders as one collection."""

import json

import numpy as np
import pytest

from collalign.cli import main
from collalign.output.evidence.loading import load

FLAGS = ["--sampling.num-points", "12", "--sampling.num-dense-points", "0", "--jobs", "1"]


@pytest.fixture
def folder(tmp_path):
    """Five clouds in two folders, two of one name, one in metres among millimetres; and two that are no shapes."""
    rng = np.random.default_rng(0)
    points = 40 * rng.random((40, 3))
    for name, unit in (("left/a", 1.0), ("left/b", 1.0), ("right/a", 1.0), ("right/c", 1.1), ("right/metres", 1e-3)):
        path = tmp_path / "in" / f"{name}.xyz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, unit * (points + 0.4 * rng.standard_normal((40, 3))))
    (tmp_path / "in" / "right" / "b.xyz").write_bytes(b"rubbish")
    (tmp_path / "in" / "readme.md").write_text("two sides")
    return tmp_path / "in"


def test_a_check_reads_every_file_and_writes_nothing(folder, capsys):
    out = folder.parent / "out"
    assert main(["align", str(folder), "--recursive", "--out", str(out), *FLAGS, "--check", "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in told["shapes"]] == ["left/a", "left/b", "right/a", "c", "metres"]
    assert all(one["points"] == 40 and one["triangles"] == 0 for one in told["shapes"])
    assert max(told["shapes"][0]["size"]) > 30
    assert [one["file"] for one in told["left_out"]] == ["right/b.xyz"]
    assert told["skipped"] == ["readme.md"]
    assert told["notes"] == ["Much smaller than the median shape, perhaps in another unit: metres (1e+03 times)."]
    assert not out.exists()
    assert main(["align", str(folder / "left"), *FLAGS, "--check"]) == 0
    assert main(["align", str(folder / "left"), *FLAGS]) == 2
    assert "2 of 2 files can be aligned." in capsys.readouterr().out
    (folder / "right" / "readme.md").write_text("again")
    assert main(["align", str(folder), "--recursive", "--out", str(out), *FLAGS, "--check", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["skipped"] == ["in/readme.md", "right/readme.md"]
    (folder / "left" / "b.xyz").unlink()
    assert main(["align", str(folder / "left"), "--out", str(out), "--check"]) == 2
    assert "at least two are needed" in capsys.readouterr().err


def test_a_check_says_who_has_too_few_points(folder, capsys):
    np.savetxt(folder / "left" / "few.xyz", np.eye(3))
    places = [str(folder / "left"), str(folder / "right" / "[ac].xyz")]
    assert main(["align", *places, "--out", str(folder.parent / "out"), "--check"]) == 3
    said = capsys.readouterr().out
    assert "Shapes would be matched at 40 points" in said
    assert "Fewer than 40 points, which a run leaves out: few." in said


def test_several_folders_are_one_collection_and_odd_sizes_are_named_by_a_run(folder, capsys):
    out = folder.parent / "out"
    places = folder.parent / "all.txt"
    places.write_text("in/left\nin/right/*.xyz\n")
    assert main(["align", f"@{places}", "--out", str(out), *FLAGS]) == 3
    said = capsys.readouterr()
    assert "perhaps in another unit: metres" in said.out
    assert "Left out: right/b.xyz: " in said.err
    assert load(out).names == ("c", "left/a", "left/b", "metres", "right/a")
    assert len({path.name for path in (out / "meshes").iterdir()}) == 5
    places = [str(folder / "right"), str(folder / "left")]
    assert main(["align", *places, "--out", str(out), *FLAGS, "--check", "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert {"c", "left/a", "metres", "right/a"} < {one["name"] for one in told["shapes"]}
    assert main(["align", str(folder), "--out", str(out)]) == 2
    assert "its folders do: left (2), right (4)" in capsys.readouterr().err


def test_a_check_reads_in_workers_within_the_limits_of_a_run(tmp_path, capsys):
    for name in "abc":
        np.savetxt(tmp_path / f"{name}.xyz", np.random.default_rng(0).random((40, 3)))
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 90000000\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    with (tmp_path / "huge.ply").open("wb") as file:
        file.write(header.encode())
        file.truncate(len(header) + 12 * 90_000_000)
    assert main(["align", str(tmp_path), "--check", "--memory-limit-gib", "0.5", "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in told["shapes"]] == ["a", "b", "c"]
    assert [(one["file"], one["reason"]) for one in told["left_out"]] == [("huge.ply", "does not fit in memory")]
