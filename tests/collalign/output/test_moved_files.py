"""Original files that are not where they were aligned are found by their names, or asked for."""

import dataclasses
import shutil

import pytest

import collalign
from collalign.output.moved_files import find_files, missing_files
from data_tools.errors import InputError, UnavailableError
from data_tools.io.source import hash_source
from data_tools.options import SamplingOptions
from tests.commands import run_command
from tests.finished_runs import chairs, finished_run


def touched(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("0 0 0\n")
    return folder


def test_files_are_found_by_name_and_by_their_own_folders(tmp_path):
    now = touched(tmp_path / "now", "left/a.xyz", "right/a.xyz", "b.xyz", "saved.ply")
    names, files = (
        ("l", "r", "b", "saved"),
        ("/old/left/a.xyz", r"C:\old\right\a.xyz", "/old/b.xyz", ""),
    )
    found = find_files(names, files, ("",) * 4, now)
    assert found == tuple(
        str(now / one) for one in ("left/a.xyz", "right/a.xyz", "b.xyz", "saved.ply")
    )
    assert missing_files(files) == list(files[:3])
    assert missing_files(found) == []


def test_a_folder_without_the_files_or_with_one_for_two_is_refused(tmp_path):
    now = touched(tmp_path / "now", "a.xyz")
    with pytest.raises(InputError, match=r"holds none of the files that were aligned \(c.xyz\)"):
        find_files(("c",), ("/old/c.xyz",), ("",), now)
    with pytest.raises(InputError, match="would stand for several shapes"):
        find_files(("l", "r"), ("/old/left/a.xyz", "/old/right/a.xyz"), ("", ""), now)
    assert find_files(("a", "c"), ("/old/a.xyz", "/old/c.xyz"), ("", ""), now) == (
        str(now / "a.xyz"),
        "/old/c.xyz",
    )


def test_a_renamed_file_is_found_by_its_content(tmp_path):
    now = touched(tmp_path / "now", "a.xyz", "deep/other.xyz")
    (now / "deep" / "renamed.xyz").write_text("1 2 3\n")
    digest = hash_source(now / "deep" / "renamed.xyz")
    files, digests = ("/old/a.xyz", "/old/b.xyz"), ("0" * 40, digest)
    assert find_files(("a", "b"), files, digests, now) == (
        str(now / "a.xyz"),
        str(now / "deep" / "renamed.xyz"),
    )
    assert find_files(("a", "b"), files, ("0" * 40, "1" * 40), now)[1] == "/old/b.xyz"


def test_commands_go_on_with_the_files_where_they_are_now(tmp_path):
    options = collalign.AlignOptions(
        refine=False, sampling=SamplingOptions(num_points=16, num_dense_points=0)
    )
    out = finished_run(tmp_path, chairs(3), options)
    shutil.move(tmp_path / "shapes", tmp_path / "now")
    run_command("export", out, "--format", "tps", "--to", tmp_path / "tps")  # needs no original
    words = ["export", str(out), "--format", "ply", "--to", str(tmp_path / "ply")]
    assert "say where they are now (--sources FOLDER)" in "".join(run_command(*words, ends=2))
    run_command(*words, "--sources", tmp_path / "now")
    with pytest.raises(UnavailableError, match="not there any more"):
        collalign.maps.dense_correspondence(out, progress=False)
    with pytest.raises(InputError, match="holds none"):
        collalign.load(out, sources=tmp_path / "tps")
    moved = collalign.load(out, sources=tmp_path / "now")
    assert moved.source_files() == tuple(tmp_path / "now" / f"{name}.ply" for name in moved.names)
    assert (
        dataclasses.replace(moved, files=("",) * 3).with_sources(tmp_path / "now").files
        == moved.files
    )
